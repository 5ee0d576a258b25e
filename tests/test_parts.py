"""The public door: each name from its module, parts that are missing, and packages under their public names."""

from __future__ import annotations

import ast
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import navloom
import pytest
from navloom.names import NAMES
from navloom.parts import ALIASES, PARTS, MissingPartError, has_part, part
from navloom.plugins import Discovery
from navloom.plugins.shipped_plugins import SHIPPED

LAZY = [
    "navloom",
    "navloom.cli",
    "navloom.engine",
    "navloom.inputs",
    "navloom.runs",
    "navloom.testing",
    "navloom_live",
    "navloom_recording",
    "navloom_study",
    "navloom_study.report",
    "navloom_viewer",
]
"""Packages that import their public names on first use."""


def typed_names(package: str) -> dict[str, str]:
    """Module of each name that a package has for mypy."""
    tree = ast.parse(Path(import_module(package).__file__).read_text("utf-8"))
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                listed = import_module(node.module).__all__ if alias.name == "*" else [alias.asname]
                found.update({name: node.module for name in listed if name is not None})
    return found


@pytest.mark.parametrize("package", LAZY)
def test_a_lazy_package_gives_the_names_that_mypy_knows(package: str) -> None:
    typed = typed_names(package)
    assert set(import_module(package).__all__) <= set(typed)
    if package not in ("navloom", "navloom.testing"):  # whose modules are imported whole for mypy
        assert set(typed) == set(import_module(package).__all__)


@pytest.mark.parametrize("package", LAZY)
def test_each_name_of_a_lazy_package_is_one_of_its_module_even_after_a_module_of_that_name(package: str) -> None:
    typed, made = typed_names(package), import_module(package)
    for name in made.__all__:
        if find_spec(f"{made.__name__}.{name}") is not None:
            import_module(f"{made.__name__}.{name}")
        assert name in import_module(typed[name]).__all__
        assert getattr(made, name) is getattr(import_module(typed[name]), name), f"{package}.{name}"


def test_each_name_of_a_house_that_is_public_is_in_the_table() -> None:
    houses = [module for module in NAMES if not module.startswith(("navloom.runs.", "navloom_"))]
    named = {(house, name) for house in houses for name in import_module(house).__all__}
    assert named - {(module, name) for module, names in NAMES.items() for name in names.split()} == set()


def test_a_misspelt_name_is_told_with_the_nearest() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Avoidr'; did you mean 'Avoider'"):
        navloom.Avoidr  # noqa: B018


@pytest.mark.parametrize("public", sorted(ALIASES))
def test_a_public_package_is_the_part_itself_and_so_are_its_modules(public: str) -> None:
    package = import_module(public)
    assert package is import_module(ALIASES[public]) and package.__spec__.name == ALIASES[public]
    inner = {"navloom.avoidance": "beams", "navloom.testing": "scenes"}[public]
    assert import_module(f"{public}.{inner}") is import_module(f"{ALIASES[public]}.{inner}")


class Without:
    """Finds modules as if a package were not installed."""

    def __init__(self, package: str) -> None:
        self.package = package

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name == self.package:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


@pytest.mark.parametrize(
    ("name", "missing", "said"),
    [
        ("Navigator", "navloom_live", "pip install navloom-live"),
        ("Panel", "navloom_viewer", "pip install navloom-viewer"),
    ],
)
def test_a_name_of_a_part_that_is_not_installed_says_which_to_install(
    name: str, missing: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for loaded in [loaded for loaded in sys.modules if loaded.partition(".")[0] == missing]:
        monkeypatch.delitem(sys.modules, loaded)
    monkeypatch.setattr(sys, "meta_path", [Without(missing), *sys.meta_path])
    with pytest.raises(MissingPartError, match=said):
        getattr(navloom, name)


def test_a_module_that_a_part_lacks_is_no_missing_part() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"navloom_avoidance\.nothing") as raised:
        part("navloom_avoidance.nothing")
    assert not isinstance(raised.value, MissingPartError)


def test_every_part_is_installed_where_the_tests_run() -> None:
    assert [package for package in PARTS if not has_part(package)] == []


@pytest.mark.parametrize(
    ("name", "without"),
    [
        ("Avoider", {"zenoh", "numba", "scipy", "rerun"}),
        ("Metric", {"zenoh", "numba", "scipy", "rerun"}),
        ("Navigator", {"numba", "rerun", "matplotlib"}),
    ],
)
def test_a_public_name_loads_only_what_it_needs(name: str, without: set[str]) -> None:
    code = f"import sys; from navloom import {name}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert without.isdisjoint(loaded)


def test_the_distribution_that_a_message_says_to_install_has_the_plugin() -> None:
    entries = {
        f"{info.role}.{info.name}": info.distribution
        for info in Discovery().infos()
        if info.distribution.startswith("navloom-")
    }
    assert entries == {key: distribution for distribution, keys in SHIPPED.items() for key in keys}
