"""No circle of files: imports in functions and under TYPE_CHECKING count as those at the head of a module do."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import networkx
import pytest

TOP = Path(__file__).resolve().parents[1]
SOURCES = sorted([*TOP.glob("framework/*/src"), *TOP.glob("plugins/*/src")])


def modules_of(sources: list[Path]) -> dict[str, Path]:
    """Files by the dotted names of their modules; a package is its `__init__.py`."""
    found = {}
    for source in sources:
        for path in sorted(source.rglob("*.py")):
            parts = path.relative_to(source).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports_of(module: str, path: Path) -> Iterator[tuple[str, int]]:
    """Every name that a file imports, wherever in the file, and its line."""
    package = module.split(".") if path.name == "__init__.py" else module.split(".")[:-1]
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node.lineno
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                yield f"{base}.{alias.name}", node.lineno


def import_graph(modules: dict[str, Path]) -> networkx.DiGraph:
    """An edge, with its line, from each module to each that it imports."""
    graph = networkx.DiGraph()
    for module, path in modules.items():
        graph.add_node(module)
        for name, line in imports_of(module, path):
            while name and name not in modules:  # a name that is no module is an object in one
                name = name.rpartition(".")[0]
            if name and name != module and not graph.has_edge(module, name):
                graph.add_edge(module, name, line=line)
    return graph


def circles(modules: dict[str, Path], top: Path) -> list[str]:
    """One text for each set of modules that import each other, directly or not: its members and one circle, by edge."""
    graph = import_graph(modules)
    told = []
    for members in sorted(map(sorted, networkx.strongly_connected_components(graph))):
        if len(members) < 2:
            continue
        edges = networkx.find_cycle(graph.subgraph(members), members[0])
        lines = [
            f"  {modules[one].relative_to(top)}:{graph.edges[one, other]['line']}: {one} imports {other}"
            for one, other in edges
        ]
        told.append("\n".join([f"{len(members)} modules import each other: {', '.join(members)}", *lines]))
    return told


def test_no_files_import_each_other_in_a_circle() -> None:
    modules = modules_of(SOURCES)
    assert {"navloom.cli.main", "navloom_astar.search"} <= set(modules)
    assert import_graph(modules).has_edge("navloom_theta_star.search", "navloom_astar.search")
    found = circles(modules, TOP)
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    "back",
    [
        "import toy.inner.a",
        "from toy.inner import a",
        "from . import a",
        "from .a import X",
        "from ..inner.a import X",
        "def late():\n    from toy.inner.a import X",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from toy.inner.a import X",
    ],
)
def test_a_circle_is_found_however_it_is_closed(back: str, tmp_path: Path) -> None:
    inner = tmp_path / "toy" / "inner"
    inner.mkdir(parents=True)
    for path in (inner.parent / "__init__.py", inner / "__init__.py"):
        path.write_text("")
    (inner / "a.py").write_text("import math\nfrom toy.inner import b\n\nX = b.Y\n")
    (inner / "b.py").write_text("from toy.inner.c import Y\n")
    (inner / "c.py").write_text(f"{back}\nY = 1\n")
    (text,) = circles(modules_of([tmp_path]), tmp_path)
    line = len(back.splitlines())
    assert text.splitlines() == [
        "3 modules import each other: toy.inner.a, toy.inner.b, toy.inner.c",
        "  toy/inner/a.py:2: toy.inner.a imports toy.inner.b",
        "  toy/inner/b.py:1: toy.inner.b imports toy.inner.c",
        f"  toy/inner/c.py:{line}: toy.inner.c imports toy.inner.a",
    ]


def test_a_package_that_imports_its_modules_is_no_circle(tmp_path: Path) -> None:
    (tmp_path / "toy").mkdir()
    (tmp_path / "toy" / "__init__.py").write_text("from toy.a import X\n")
    (tmp_path / "toy" / "a.py").write_text("from toy.b import X\n")
    (tmp_path / "toy" / "b.py").write_text("X = 1\n")
    assert circles(modules_of([tmp_path]), tmp_path) == []
