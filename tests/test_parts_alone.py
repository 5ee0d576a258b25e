"""Each distribution alone: it imports only what it declares, and its tests pass with only that and their own group."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parents[1]
HOUSES = [
    path.parent
    for place in ("framework/*", "plugins/*", "benchmarks")
    for path in sorted(TOP.glob(f"{place}/pyproject.toml"))
]
PROJECTS = {house: tomllib.loads((house / "pyproject.toml").read_text("utf-8"))["project"] for house in HOUSES}
HOUSE_OF = {project["name"]: house for house, project in PROJECTS.items()}
OURS = {package.name: name for name, house in HOUSE_OF.items() for package in (house / "src").iterdir()}
"""Distribution of each package of the project: an editable one lists no packages."""
SCRIPT = re.compile(r"^(?:from|import) (\w+)", re.MULTILINE)
INSTALLED = packages_distributions()


def declared_in(house: Path, extra: str = "") -> set[str]:
    """Names of the distributions that a project declares, of all its extras or of one, with extras of our own."""
    project = PROJECTS[house]
    extras = project.get("optional-dependencies", {})
    entries = (
        extras[extra] if extra else [*project["dependencies"], *(entry for group in extras.values() for entry in group)]
    )
    declared = set()
    for entry in entries:
        name, inner = re.fullmatch(r"([\w-]+)(?:\[([\w,]+)\])?.*", entry).groups()
        declared.add(name)
        for further in inner.split(",") if inner else ():
            declared |= declared_in(HOUSE_OF[name], further)
    return declared


def imports_of(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Top package and line of every absolute import, in functions and scripts too; not under TYPE_CHECKING."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        if isinstance(node, ast.Import):
            yield from ((alias.name.partition(".")[0], node.lineno) for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):  # a script for another process
            yield from ((package, node.lineno) for package in SCRIPT.findall(node.value) if package in OURS)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield str(node.module).partition(".")[0], node.lineno
        else:
            yield from imports_of(node)


def undeclared(source: Path, declared: set[str]) -> list[str]:
    """Imports in a folder, with lines, of what is neither standard, nor its own, nor of a declared distribution."""
    known = sys.stdlib_module_names | {path.name.removesuffix(".py") for path in source.iterdir()}
    return [
        f"{path.relative_to(source)}:{line}: {package}"
        for path in sorted(source.rglob("*.py"))
        for package, line in imports_of(ast.parse(path.read_text("utf-8")))
        if package not in known
        and declared.isdisjoint(
            {OURS.get(package, package), *(name.lower().replace("_", "-") for name in INSTALLED.get(package, ()))}
        )
    ]


@pytest.mark.parametrize("house", HOUSES, ids=lambda house: house.name)
def test_a_distribution_imports_only_what_it_declares(house: Path) -> None:
    assert undeclared(house / "src", declared_in(house)) == []


def test_an_import_that_nothing_declares_is_named_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(
        "from typing import TYPE_CHECKING\nimport numpy\nimport navloom.roles\nif TYPE_CHECKING:\n    import rich\n"
        "def later():\n    import yaml\n    from navloom_live.live import cell\n    import mine\n"
        "SCRIPT = 'import navloom_study.episode_rows\\n'\n",
        "utf-8",
    )
    assert undeclared(tmp_path, {"navloom", "numpy"}) == [
        "mine.py:7: yaml",
        "mine.py:8: navloom_live",
        "mine.py:10: navloom_study",
    ]
    assert undeclared(tmp_path, {"navloom", "navloom-live", "navloom-study", "numpy", "pyyaml"}) == []


@pytest.mark.slow
@pytest.mark.parametrize("house", HOUSES, ids=lambda house: house.name)
def test_the_tests_of_a_part_need_only_what_it_declares(house: Path) -> None:
    """Each in an environment of its own, which uv makes from links to the files in its cache."""
    uv = [sys.executable, str(TOP / "uv.py")]
    alone = [
        "run",
        "--isolated",
        "--quiet",
        "--package",
        PROJECTS[house]["name"],
        "--group",
        "test",
        "--no-default-groups",
    ]
    tests = ["python", "-m", "pytest", "-q", "-p", "no:cacheprovider", str(house / "tests")]
    count = "from importlib.metadata import distributions; print(len(list(distributions())))"
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}

    def run(*words: str) -> str:
        done = subprocess.run([*uv, *alone, *words], cwd=TOP, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
        return done.stdout

    begun = time.monotonic()
    passed = run(*tests).splitlines()[-1]
    installed = int(run("python", "-c", count))
    print(f"\n| {PROJECTS[house]['name']} | {installed} | {passed} | {time.monotonic() - begun:.0f} s |")
