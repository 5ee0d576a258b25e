"""The public door: each name from its module, parts that are missing, and packages under their public names."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module

import navloom
import pytest
from navloom.names import MODULE_OF
from navloom.parts import ALIASES, PARTS, MissingPartError, has_part, part


@pytest.mark.parametrize("name", sorted(MODULE_OF))
def test_each_public_name_is_one_of_its_module(name: str) -> None:
    module = import_module(MODULE_OF[name])
    assert name in module.__all__
    assert getattr(navloom, name) is getattr(module, name)


def test_each_name_of_a_house_that_is_public_is_in_the_table() -> None:
    houses = {module for module in MODULE_OF.values() if not module.startswith("navloom.runs.")}
    named = {(house, name) for house in houses for name in import_module(house).__all__}
    assert named - {(module, name) for name, module in MODULE_OF.items()} == set()


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
