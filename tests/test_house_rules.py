"""House rules that tools check: each test fails when its rule is broken."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parents[1]
PLUGINS = sorted(path for path in (TOP / "plugins").iterdir() if (path / "pyproject.toml").exists())


def run(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *command], cwd=TOP, capture_output=True, text=True, timeout=300)


def test_ruff_finds_nothing() -> None:
    done = run("-m", "ruff", "check", ".")
    assert done.returncode == 0, done.stdout


def test_the_code_is_formatted() -> None:
    done = run("-m", "ruff", "format", "--check", ".")
    assert done.returncode == 0, done.stdout


def test_the_framework_and_every_plugin_type_check_strictly() -> None:
    sources = [
        path
        for part in (*(TOP / "framework").iterdir(), TOP / "benchmarks", *PLUGINS)
        for path in (part / "src").rglob("*.py*")
        if path.suffix in (".py", ".pyi")
    ]
    done = run("-m", "mypy")
    assert done.returncode == 0, done.stdout
    assert f"no issues found in {len(sources)} source files" in done.stdout


def test_houses_import_one_way() -> None:
    done = run("-c", "from importlinter.cli import lint_imports_command as lint; lint()")
    assert done.returncode == 0, done.stdout + done.stderr


COMMANDS = ("avoidance", "carmen", "hoang2013", "maps")
"""Distributions that add commands to `navloom`, and may import its packages."""
READERS = {
    "ros": {"navloom_recording.header", "navloom_recording.reader", "navloom_recording.imported",
            "navloom.inputs.bounds", "navloom.inputs.texts", "navloom_viewer.facts", "navloom_viewer.sweep_classes"}
}  # fmt: skip
"""Waivers: modules that a converter between recordings and other files needs to read and write recordings, and to show
what a mapper kept of a sweep, as the viewer does."""
OF_COMMANDS = {"navloom.cli.command", "navloom.cli.options"}
"""What the file `cli.py` of a distribution may import: its commands take the same options as navloom's own."""
IMPORTERS = {"ros": {"bags.py", "bag_conversion.py", "bag_import.py"}}
"""Modules that make messages from another system's files."""


@pytest.mark.parametrize("plugin", [p for p in PLUGINS if p.name not in COMMANDS], ids=lambda path: path.name)
def test_only_a_plugins_adapter_imports_navloom_and_only_its_door(plugin: Path) -> None:
    adapters = {"__init__.py", "adapter.py", "maps.py", "params.py"} | IMPORTERS.get(plugin.name, set())
    doors = {"navloom", "navloom.testing"} | READERS.get(plugin.name, set())
    for path in (plugin / "src").rglob("*.py"):
        for name in imported(path):
            if name.startswith(("navloom.avoidance", "navloom.drivers")):  # public, and independent of any robot
                continue
            if path.name == "adapter.py" and name == "navloom.geometry.echoes":  # public, and of messages
                continue
            if path.name == "errors.py" and name == "navloom.errors":  # the base class alone, which imports nothing
                continue
            if path.name == "cli.py" and name in OF_COMMANDS:
                continue
            if name == "navloom" or name.startswith("navloom."):
                assert name in doors, f"{path.name} imports {name}"
                assert path.name in adapters, f"{path.name} is a pure module and imports navloom"


FETCHED = {"time", "threading", "socket", "random", "zenoh"}
OF_THE_WIRE = {
    "ros/wire.py": {"time", "zenoh"},
    "ros/node.py": {"threading", "time"},
    "ros/services.py": {"threading"},
    "ros/topics.py": {"threading"},
    "ros/actions.py": {"threading"},
    "ros/joining.py": {"threading"},
    "ros/guardian.py": {"time"},
    "ros/goals.py": {"threading"},
}
"""Waivers: a bridge to another network owns its session, the threads that wait on it, and the clock of its stamps."""


@pytest.mark.parametrize("plugin", PLUGINS, ids=lambda path: path.name)
def test_nothing_is_fetched_that_should_be_handed_in(plugin: Path) -> None:
    for path in (plugin / "src").rglob("*.py"):
        refused = FETCHED - OF_THE_WIRE.get(f"{plugin.name}/{path.name}", set())
        for name in imported(path):
            assert name.split(".")[0] not in refused, f"{path.name}: {name}"
        text = path.read_text("utf-8")
        assert "os.environ" not in text and "np.random.seed" not in text, path.name


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
    return names
