"""House rules that tools check: each test fails when its rule is broken."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import pytest
from navloom import ROLES, Registry
from navloom.parts import ALIASES, PARTS
from test_import_circles import import_graph, modules_of

TOP = Path(__file__).resolve().parents[1]
PLUGINS = sorted(path for path in (TOP / "plugins").iterdir() if (path / "pyproject.toml").exists())
DISTRIBUTIONS = PLUGINS + sorted(path.parent for path in TOP.glob("examples/*/pyproject.toml"))


def run(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *command], cwd=TOP, capture_output=True, text=True, timeout=300)


def test_ruff_finds_nothing() -> None:
    done = run("-m", "ruff", "check", ".")
    assert done.returncode == 0, done.stdout


def test_the_code_is_formatted() -> None:
    done = run("-m", "ruff", "format", "--check", ".")
    assert done.returncode == 0, done.stdout


@pytest.mark.once
def test_the_framework_and_every_plugin_type_check_strictly() -> None:
    sources = [
        path
        for part in (*(TOP / "framework").iterdir(), TOP / "benchmarks", *PLUGINS)
        for suffix in ("*.py", "*.pyi")
        for path in (part / "src").rglob(suffix)
    ]
    done = run("-m", "mypy")
    assert done.returncode == 0, done.stdout
    assert f"no issues found in {len(sources)} source files" in done.stdout


def test_houses_import_one_way() -> None:
    done = run("-c", "from importlinter.cli import lint_imports_command as lint; lint()")
    assert done.returncode == 0, done.stdout + done.stderr


class Public(NamedTuple):
    """A row of the table of public packages.

    Attributes:
        modules: Whether its modules are public too.
        users: Who imports it; "any module" if pure modules may.
        names: The names that the row lists; empty if it names a page that does.
    """

    modules: bool
    users: str
    names: set[str]


def public_packages() -> dict[str, Public]:
    """The packages that docs/writing-a-plugin.md lists as public."""
    text = (TOP / "docs" / "writing-a-plugin.md").read_text("utf-8")
    section = text.split("## What a distribution may import\n")[1].split("\n## ")[0]
    found = {}
    for line in section.splitlines():
        if line.startswith("| `"):
            package, modules, users, names = (cell.strip() for cell in line.strip("|").split("|"))
            found[package.strip("`")] = Public(modules == "public", users, set(re.findall(r"`(\w+)`", names)))
    return found


PUBLIC = public_packages()
FRAMEWORK = {"navloom", *PARTS}
PUBLIC_NAME = {part: public for public, part in ALIASES.items()}


def imported(path: Path) -> Iterator[tuple[str, str]]:
    """Each module that a file imports, wherever in the file, and the name from it; no name for `import module`."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield from ((node.module, alias.name) for alias in node.names)


def of_framework(path: Path, own: str) -> Iterator[tuple[str, str]]:
    """The imports of the framework in a file of the package `own`, parts by their public name."""
    for module, name in imported(path):
        top, dot, inner = module.partition(".")
        if top in FRAMEWORK - {own}:
            yield PUBLIC_NAME.get(top, top) + dot + inner, name


def public_package_of(module: str) -> str | None:
    """The public package that a module is, or is in and public with it."""
    if module in PUBLIC:
        return module
    return next((name for name, row in PUBLIC.items() if row.modules and module.startswith(f"{name}.")), None)


def is_public_name(module: str, name: str) -> bool:
    """Whether a module lists a name in `__all__`; without it, every name without an underscore is public."""
    listed = getattr(import_module(module), "__all__", None)
    return not name.startswith("_") if listed is None else name in listed


def private_imports(path: Path, own: str) -> list[str]:
    """What a file imports of the framework that is not public."""
    found = []
    for module, name in of_framework(path, own):
        package = public_package_of(module)
        if package is None:
            found.append(f"{path.name} imports {module}, which is not public")
        elif name and not is_public_name(module, name):
            found.append(f"{path.name} imports {name} of {module}, which is not public")
    return found


@pytest.mark.parametrize("plugin", DISTRIBUTIONS, ids=lambda path: path.name)
def test_a_distribution_imports_only_public_names_of_the_framework(plugin: Path) -> None:
    assert [line for path, own in files_of(plugin) for line in private_imports(path, own)] == []


def files_of(plugin: Path) -> list[tuple[Path, str]]:
    """The Python files of a distribution, and the package that each is in."""
    top = plugin / "src" if (plugin / "src").is_dir() else plugin
    return [(path, path.relative_to(top).parts[0].removesuffix(".py")) for path in sorted(top.rglob("*.py"))]


@pytest.mark.parametrize(
    ("code", "refused"),
    [
        ("from navloom_recording.reader import Recording", "navloom_recording.reader, which"),
        ("def late():\n    import navloom.config.schema", "navloom.config.schema, which"),
        ("from navloom_live.operating.navigator import Navigator", "navloom_live.operating.navigator, which"),
        ("from navloom.runs import measures", "measures of navloom.runs, which"),
        ("from navloom.worlds import corridor", "corridor of navloom.worlds, which"),
        ("from navloom.geometry.grid import _edges", "_edges of navloom.geometry.grid, which"),
        ("from navloom_check.runner import Job", "navloom.testing.runner, which"),
        ("from navloom_recording import Recording\nfrom navloom import Avoider\nimport navloom.config", ""),
        ("from navloom.geometry import angles\nfrom navloom.geometry.angles import wrap", ""),
        ("from navloom_avoidance.beams import Beams\nfrom navloom.avoidance.beams import Beams", ""),
        ("from navloom_toy.inner import thing\nfrom .inner import thing", ""),
    ],
)
def test_a_private_import_is_found(code: str, refused: str, tmp_path: Path) -> None:
    (tmp_path / "toy.py").write_text(code)
    found = private_imports(tmp_path / "toy.py", "navloom_toy")
    assert [refused in line for line in found] == [True] * bool(refused)


@pytest.mark.parametrize("package", [package for package, row in PUBLIC.items() if row.names])
def test_the_table_of_public_packages_has_every_name(package: str) -> None:
    assert PUBLIC[package].names == set(import_module(package).__all__) - {"navloom_register"}


def test_a_package_without_names_in_the_table_is_public_with_its_modules_or_in_the_reference() -> None:
    assert [name for name, row in PUBLIC.items() if not (row.names or row.modules)] == [
        "navloom", "navloom.messages", "navloom.roles", "navloom.plugins",
    ]  # fmt: skip


@pytest.mark.parametrize("package", PUBLIC)
def test_mypy_reads_the_types_of_a_public_package(package: str) -> None:
    top = import_module(ALIASES.get(package, package).partition(".")[0])
    assert top.__file__ and Path(top.__file__).with_name("py.typed").exists()


ADAPTERS = {"__init__.py", "adapter.py", "cli.py", "errors.py", "maps.py", "params.py"}
"""Files in which a plugin meets the framework."""
OF_FILES = {"navloom_recording", "navloom.inputs"}
"""Packages by which a module shows that it reads or writes the files of others."""


def impure_modules(source: Path, own: str) -> list[str]:
    """Pure modules that import the framework.

    All modules are pure but adapters, those that read or write files of others, and what only these use.
    """
    modules = modules_of([source])
    graph = import_graph(modules)
    packages = {
        module: {public_package_of(name) for name, _ in of_framework(path, own)} for module, path in modules.items()
    }
    of_files = {module for module, used in packages.items() if used & OF_FILES}
    found = []
    for module, path in modules.items():
        importers = set(graph.predecessors(module))
        if path.name in ADAPTERS or module in of_files or (importers and importers <= of_files):
            continue
        found += [
            f"{module} is a pure module and imports {name}"
            for name, _ in of_framework(path, own)
            if not PUBLIC.get(public_package_of(name) or "", NOT_PUBLIC).users.startswith("any module")
        ]
    return found


NOT_PUBLIC = Public(False, "", set())


def points_of(plugin: Path) -> dict[str, str]:
    """The entry points of a distribution: module by KIND.NAME."""
    project = tomllib.loads((plugin / "pyproject.toml").read_text("utf-8"))["project"]
    return project.get("entry-points", {}).get("navloom", {})


def has_role(plugin: Path) -> bool:
    return any(point.partition(".")[0] in ROLES for point in points_of(plugin))


@pytest.mark.parametrize("plugin", filter(has_role, PLUGINS), ids=lambda path: path.name)
def test_the_pure_modules_of_a_plugin_import_no_framework(plugin: Path) -> None:
    (own,) = {package for _, package in files_of(plugin)}
    assert impure_modules(plugin / "src", own) == []


@pytest.mark.parametrize(
    ("code", "users", "is_impure"),
    [
        ("from navloom import Pose2D", "adapter.py", True),
        ("def late():\n    import navloom.geometry.angles", "adapter.py", True),
        ("from navloom_recording.reader import Recording", "adapter.py", True),  # not by its public name
        ("from navloom_avoidance.beams import Beams\nfrom navloom.drivers import ports", "adapter.py", False),
        ("from navloom_recording import Recording\nfrom navloom import Pose2D", "adapter.py", False),
        ("from navloom.inputs import read_file\nfrom navloom import Pose2D", "adapter.py", False),
        ("from navloom import Pose2D", "bags.py", False),
        ("from navloom import Pose2D", "adapter.py bags.py", True),
    ],
)
def test_an_impure_module_is_found(code: str, users: str, is_impure: bool, tmp_path: Path) -> None:
    package = tmp_path / "navloom_toy"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "maths.py").write_text(code)
    for user in users.split():
        first = "import navloom_recording\n" if user == "bags.py" else ""
        (package / user).write_text(f"{first}from navloom_toy.maths import thing\n")
    found = impure_modules(tmp_path, "navloom_toy")
    assert all("navloom_toy.maths is a pure module" in line for line in found) and bool(found) == is_impure


FETCHED = {"time", "threading", "socket", "random", "zenoh"}
OWNED = FETCHED - {"random"}
"""What the driver of a real robot owns: its session, the threads that wait on it, and the clock of its stamps."""


def is_driver(plugin: Path) -> bool:
    """Whether a platform of the distribution moves a real robot."""
    registry = Registry()
    for point, module in points_of(plugin).items():
        if point.startswith("platform."):
            import_module(module).navloom_register(registry)
    return not all(cls.is_simulated for (role, _), cls in registry.roles.items() if role == "platform")


def fetched(path: Path, refused: set[str]) -> list[str]:
    """What a file fetches that should be handed in."""
    found = [f"{path.name} imports {name}" for name, _ in imported(path) if name.partition(".")[0] in refused]
    text = path.read_text("utf-8")
    return found + [f"{path.name} uses {word}" for word in ("os.environ", "np.random.seed") if word in text]


@pytest.mark.parametrize("plugin", PLUGINS, ids=lambda path: path.name)
def test_nothing_is_fetched_that_should_be_handed_in(plugin: Path) -> None:
    refused = FETCHED - OWNED if is_driver(plugin) else FETCHED
    assert [line for path, _ in files_of(plugin) for line in fetched(path, refused)] == []


@pytest.mark.parametrize("code", ["import time", "def late():\n    from threading import Lock", "x = os.environ['X']"])
def test_what_is_fetched_is_found(code: str, tmp_path: Path) -> None:
    (tmp_path / "toy.py").write_text(code)
    assert len(fetched(tmp_path / "toy.py", FETCHED)) == 1


@pytest.mark.parametrize("is_simulated", [True, False])
def test_a_driver_is_known_by_its_platform(is_simulated: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = f"navloom_toy_{is_simulated}".lower()
    (tmp_path / f"{module}.py").write_text(f"""
from navloom import Platform, hookimpl
class Toy(Platform):
    name = "toy"
    is_simulated = {is_simulated}
    def advance(self, given): ...
@hookimpl
def navloom_register(registry):
    registry.add(Toy)
""")
    (tmp_path / "pyproject.toml").write_text(f'[project.entry-points.navloom]\n"platform.toy" = "{module}"\n')
    monkeypatch.syspath_prepend(tmp_path)
    assert is_driver(tmp_path) is not is_simulated
