"""README and docs: the commands that exist, the blocks, the links. tests/live/test_docs_pages.py types the commands."""

from __future__ import annotations

import functools
import re
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import patch

import pytest
import typer.main
from doc_pages import NOT_RUN, PAGES, PROGRAMS, STAND_INS, TOP, Step, listed, steps, words
from navloom.cli.distribution_commands import Commands
from navloom.cli.main import app
from navloom.config import load_config
from navloom.entry_kinds import OTHERS
from navloom.messages import SCHEMAS, Envelope, GateStatus, Message, StepRecord
from navloom.plugins import Registry
from navloom.roles import ROLES
from navloom.runs.episode import run_episode
from navloom.runs.fleet import load_fleet
from navloom.testing import robot
from navloom_study.suites.suite import SuiteTable

STEPS = [step for page in PAGES for step in steps(page)]
TYPED = [step for step in STEPS if step.kind in ("command", "inline")]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)


@functools.cache
def command_line() -> Any:
    """The commands of navloom and of distributions, with their options."""
    return typer.main.get_command(app)


def faults_of(step: Step) -> list[str]:
    """The command name or option of a step that the command line does not know."""
    known: Any = command_line()
    options = {"--help"}
    for word in words(step.text.replace("'", " ")):
        options |= {name for param in known.params for name in (*param.opts, *param.secondary_opts)}
        if word.startswith("--"):
            if word not in options:
                return [f"{step}: no option {word}"]
        elif word.isupper():
            return []  # a placeholder for the command itself
        elif hasattr(known, "commands"):
            commands = known.whole() if isinstance(known, Commands) else known.commands
            if word not in commands:
                return [f"{step}: no command {word}"]
            known = commands[word]
    return []


def test_there_are_commands_to_check() -> None:
    assert len(TYPED) >= 50 and len({step.page for step in TYPED}) >= 7


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_and_option_that_a_page_names_is_known(page: Path) -> None:
    named = [step for step in steps(page) if step.kind in ("command", "inline", "form")]
    assert [fault for step in named if step.text.startswith("navloom ") for fault in faults_of(step)] == []


def test_every_other_program_is_listed_with_a_reason() -> None:
    others = [step for step in TYPED if step.text.split()[0] not in PROGRAMS]
    assert [str(step) for step in others if not listed(NOT_RUN, step)] == []


@pytest.mark.parametrize("table", [NOT_RUN, STAND_INS], ids=["not-run", "stand-ins"])
def test_no_entry_of_a_table_is_left_over(table: dict[tuple[str, str], str]) -> None:
    assert {*table} - {listed(table, step) for step in TYPED} == set()
    assert all(table.values())


def test_the_two_set_up_commands_are_there() -> None:
    set_up = [step.text for step in STEPS if step.kind == "set-up" and step.page == "README.md"]
    assert len(set_up) == 2 and all(text.startswith("python3 uv.py run ") for text in set_up)


def test_the_tours_swap_changes_the_avoider_that_drives(tmp_path: Path) -> None:
    (step,) = [step for step in STEPS if step.kind == "file" and step.page == "tour.md"]
    path = tmp_path / step.name
    path.write_text(step.text, "utf-8")
    drove = Drove()
    assert run_episode(load_config(str(path)), observers=[drove]).summary()["truly_reached"]
    by_avoider = [(since, name) for since, name in drove.since if name in ("improved_vfh", "wary")]
    assert [name for _, name in by_avoider] == ["improved_vfh", "wary"]
    assert by_avoider[1][0] == 6.0


WRITING = TOP / "docs" / "writing-a-plugin.md"
BEYOND = TOP / "docs" / "beyond-roles.md"


class Drove:
    """Observer that keeps which instance drives, and since which run time, s."""

    wants = frozenset({("gate", "status")})
    wants_steps = False

    def __init__(self) -> None:
        self.since: list[tuple[float, str]] = []

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        """Keep each change."""
        assert isinstance(message, GateStatus)
        if not self.since or self.since[-1][1] != message.instance:
            self.since.append((at.stamp_ns * 1e-9, message.instance))

    def on_step(self, record: StepRecord) -> None:
        """Never called: `wants_steps` is False."""


REST = {
    "world": '[world]\nref = "doorway"\n',
    "mapper": '[mapper]\nplugin = "known_map"\n',
    "sensor": '[[sensor]]\nname = "laser"\nkind = "laser_2d"\n',
}
"""Tables that complete a fragment of a config, by name."""
MAP = {
    "map.pgm": b"P5\n80 80\n255\n" + bytes([254]) * 6400,
    "map.yaml": b"image: map.pgm\nresolution: 0.05\norigin: [-2.0, -2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\n"
    b"free_thresh: 0.196\n",
}
"""The map that configs name, an empty floor of 4 m, by file name."""
CONFIGS = [
    pytest.param(page, block, id=f"{page.stem}-{number}")
    for page in PAGES
    for number, block in enumerate(blocks(page, "toml"))
    if (page.stem, number) != ("moving-obstacles", 1)  # appended to a shipped config by its page, which is run
]


@pytest.mark.once
@pytest.mark.parametrize(("page", "block"), CONFIGS)
def test_every_config_of_a_page_fits_with_the_plugins_of_the_page(
    page: Path,
    block: str,
    tmp_path: Path,
    in_process: Callable[..., tuple[int, str, str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tree = tomllib.loads(block)
    if "project" in tree:
        points = tree["project"]["entry-points"]["navloom"]
        assert {name.partition(".")[0] for name in points} <= {*ROLES, *OTHERS}
        return
    for name, data in MAP.items():
        (tmp_path / name).write_bytes(data)
    if "member" in tree:
        (tmp_path / "fleet.toml").write_text(block, "utf-8")
        count = sum(table.get("count", 1) for table in tree["member"])
        assert len(load_fleet(str(tmp_path / "fleet.toml"))) == count
        return
    if "part" in tree:
        SuiteTable.model_validate(tree)
        return
    config = tmp_path / "robot.toml"
    config.write_text(block + "\n" + "".join(text for key, text in REST.items() if key not in tree), "utf-8")
    options: list[str] = []
    for number, source in enumerate(blocks(page, "python")):
        if re.search(r"registry\.(add|node)|^class \w+\((Platform|Avoider)\b", source, re.MULTILINE):
            plugin = tmp_path / f"{tmp_path.name}_{number}.py"  # a module's name is taken once per process
            plugin.write_text(source, "utf-8")
            options += ["--plugin", str(plugin)]
    monkeypatch.setenv("NAVLOOM_PLUGIN_FILES", "[]")  # what the command sets is undone
    with patch.dict(SCHEMAS):
        code, said, complained = in_process("config", "check", str(config), *options)
    assert code == 0, said + complained


def test_the_plugin_of_the_docs_registers_and_steers() -> None:
    _in_one_file, controller, derived, echoes, _test, _checks = blocks(WRITING, "python")
    node, avoider, observer, command = blocks(BEYOND, "python")
    executed(echoes, "my_echoes")  # with its own asserts
    stopping = executed(derived, "my_stopping")["Stopping"]
    # 0.5 m/s and 1 m/s² by default: v² / 2b.
    assert stopping.derived(stopping.Params(), robot(), 0.05)["slow_within"].value == 0.125
    registry = Registry()
    scopes = [executed(source, "my_plugins") for source in (controller, observer, command)]
    for source in (node, avoider):
        executed(source, "my_node")["navloom_register"](registry)
    del SCHEMAS["my_node.Echoes"]
    assert list(registry.nodes) == ["listener"] and ("avoider", "shy") in registry.roles
    scopes[0]["navloom_register"](registry)
    scopes[2]["navloom_register"](registry)
    assert ("controller", "proportional") in registry.roles and list(registry.commands) == ["greet"]
    stops = scopes[1]["navloom_observe"](run=None)
    for stopped in (True, False, True):
        status = SimpleNamespace(stopped=stopped)
        stops.on_message("gate", "main", True, "status", status, Envelope("k", 1, 0, 0, 0, 0))
    assert stops.count == 2


def test_the_message_of_the_docs_is_registered_under_its_package() -> None:
    (source,) = blocks(TOP / "docs" / "messages.md", "python")
    registry = Registry()
    executed(source, "navloom_people")["navloom_register"](registry)
    cls = registry.messages["Beacons"]
    assert cls.schema_name == "navloom_people.Beacons"
    del SCHEMAS[cls.schema_name]


def test_the_unit_test_of_the_docs_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    avoider, _controller, _derived, _echoes, test, checks = blocks(WRITING, "python")
    module = ModuleType("my_avoider")
    vars(module).update(executed(avoider, "my_avoider"))
    monkeypatch.setitem(sys.modules, "my_avoider", module)
    executed(test, "test_my_avoider")["test_it_stops_where_there_is_no_way"]()
    (mark,) = executed(checks, "test_checks")["test_it_passes"].pytestmark
    assert (mark.name, mark.args) == ("navloom_plugin", ("avoider.gap",))


def executed(source: str, module: str) -> dict[str, Any]:
    """Names that a block of code declares when it runs as the module of a plugin."""
    scope: dict[str, Any] = {"__name__": module}
    exec(compile(source, module, "exec", dont_inherit=True), scope)
    return scope


def test_each_message_that_troubleshooting_quotes_is_one_of_the_code() -> None:
    files = [path for part in ("framework", "plugins") for path in (TOP / part).glob("*/src/**/*.py")]
    code = "".join(path.read_text("utf-8") for path in files)
    code = re.sub(r'"\s*\n\s*f?"', "", code)  # literals that a line's end parts
    rows = re.findall(r"^\|([^|]+)\|", (TOP / "docs" / "troubleshooting.md").read_text("utf-8"), re.MULTILINE)
    quoted = [text for row in rows for text in re.findall(r"`([^`]+)`", row)]
    # What differs from case to case.
    given = r"…|[:,;] |\d[\d.]*|%|\b(?:NAME|SIGSEGV.*)|/\S+|geometry_msgs|jazzy|true|\bm away\b"
    parts = {part.strip() for text in quoted for part in re.split(given, text) if len(part.strip()) >= 10}
    assert len(parts) > 40
    assert sorted(part for part in parts if part not in code) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    text = page.read_text("utf-8")
    for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", text) + re.findall(r'src="([^"]+)"', text):
        is_generated = target.startswith("reference/")  # tests/test_site.py checks it
        assert is_generated or (page.parent / target).exists(), target
