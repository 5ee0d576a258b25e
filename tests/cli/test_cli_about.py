"""Information of the command line about itself: versions, shipped configs, the help."""

from __future__ import annotations

import json
import platform
import re
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import pytest
from navloom.cli.distribution_commands import AddedCommand
from navloom.commands import COMMANDS
from navloom.config import shipped_configs
from navloom.entry_kinds import CommandPoint, added_commands
from navloom.installed import shipped_names
from navloom.parts import OF_FRAMEWORK

InProcess = Callable[..., tuple[int, str, str]]


def test_version_names_the_framework_python_and_every_plugin_distribution(in_process: InProcess) -> None:
    code, out, _ = in_process("--version")
    assert code == 0
    first, python, *plugins = out.splitlines()
    assert first == f"navloom {version('navloom')}" and python == f"Python {platform.python_version()}"
    assert f"navloom-astar {version('navloom-astar')}" in plugins
    assert len({line.split()[0] for line in plugins}) == len(plugins) and "navloom" not in plugins


def test_version_as_json_holds_the_same(in_process: InProcess) -> None:
    code, out, _ = in_process("--version", "--json")
    found = json.loads(out)
    assert (code, found["navloom"], found["python"]) == (0, version("navloom"), platform.python_version())
    assert found["plugins"]["navloom-astar"] == version("navloom-astar")


def test_json_before_a_command_is_refused_with_the_place_it_belongs_to(in_process: InProcess) -> None:
    code, out, err = in_process("--json", "worlds")
    assert (code, out) == (2, "") and "navloom worlds … --json" in err


def test_version_imports_nothing_heavy() -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "navloom", "--version"],
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert imported.isdisjoint({"typer", "numpy", "numba", "pydantic", "scipy", "zenoh"})


def test_the_names_of_shipped_configs_are_those_that_load() -> None:
    assert shipped_names() == list(shipped_configs()) and len(shipped_names()) >= 3


@pytest.mark.parametrize(
    "command", ["run", "up", "compare", "graph", "node", "config show", "config check", "export systemd"]
)
def test_the_help_of_a_command_that_takes_a_config_names_every_shipped_one(
    command: str, every_command: dict[str, Any]
) -> None:
    (argument,) = [param for param in every_command[command].params if param.name == "config"]
    assert f"a shipped name: {', '.join(shipped_configs())}." in argument.help


def test_the_help_shows_the_first_sentence_of_every_command_whole(in_process: InProcess) -> None:
    code, out, _ = in_process("--help")
    rows = [line for line in out.partition("Commands:")[2].splitlines() if line]
    assert code == 0 and len(rows) > 30
    assert [row for row in rows if not re.fullmatch(r"  \S+ +\S.*[^.]\.", row)] == []


OWN = [point for point in added_commands() if point.distribution in OF_FRAMEWORK or point.name == "import"]


@pytest.mark.parametrize("point", OWN, ids=lambda point: point.name)
def test_the_help_lists_a_command_with_the_first_sentence_of_its_own_help(point: CommandPoint) -> None:
    listed = AddedCommand([point])
    real = listed.made()
    assert point.summary == listed.get_short_help_str(200) == real.get_short_help_str(200)
    assert (real.name, real.hidden, real.deprecated) == (point.name, False, False)


@pytest.mark.parametrize(
    ("words", "used"), [(["--help"], set()), (["worlds", "--help"], {"navloom.cli.describing.worlds"})]
)
def test_the_module_of_a_command_is_imported_when_the_command_is_used(words: list[str], used: set[str]) -> None:
    code = "import atexit, sys; atexit.register(lambda: print(*sys.modules)); from navloom.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, timeout=60, check=True)
    imported = set(done.stdout.splitlines()[-1].split())
    modules = {reference.partition(":")[0] for reference in COMMANDS.values()}
    assert "navloom.cli.distribution_commands" in imported
    assert modules & imported == used


def test_the_help_lists_what_distributions_add_without_importlib_metadata() -> None:
    assert {"bench", "paper"} <= {command.name for command in added_commands()}
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "navloom", "--help"],
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "navloom.cli" in imported
    assert imported.isdisjoint({"importlib.metadata", "numpy", "pydantic", "zenoh", "navloom.plugins", "pluggy"})


def test_every_command_that_may_need_a_plugin_takes_files(every_command: dict[str, Any]) -> None:
    taking = {name for name, command in every_command.items() for param in command.params if "--plugin" in param.opts}
    assert taking == {
        "run", "compare", "check", "up", "node", "replay", "plugins", "config show", "config check",
        "plan", "map", "report", "graph", "worlds", "messages", "echo", "record", "view",
        "results add",
    }  # fmt: skip
