"""What operating commands load, and `navloom stop`."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer
from navloom.cli.distribution_commands import AddedCommand
from navloom.engine.catalogue import FRAMEWORK
from navloom.engine.streams import FRAMEWORK_PORTS
from navloom.entry_kinds import added_commands
from navloom_live.hosting.runtime_folders import DirectoryError, Running
from navloom_live.operating import stop_command
from navloom_live.operating.client import ClientError
from navloom_live.operating.stop_command import STOPPED, read_options, stop_robots

OPERATING = [
    ["goal", "1", "2"], ["cancel"], ["place", "1", "-2", "90"], ["relocalise"], ["swap", "avoider", "vff"], ["resume"],
    ["teleop", "--vx", "0.1"], ["list"], ["status"], ["echo", "gate/status"], ["hz", "gate/status"], ["doctor"],
    ["params", "get", "avoider"], ["params", "set", "avoider", "reach=1"], ["down"], ["stop", "--log-json"],
]  # fmt: skip
"""Commands that act on a running robot, or look at it."""


def loaded_by(arguments: list[str], folder: Path) -> set[str]:
    """Modules that a command has loaded when it finds no robot."""
    code = "import atexit, sys; atexit.register(lambda: print(*sys.modules)); from navloom.__main__ import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env={**os.environ, "NAVLOOM_RUNTIME_DIR": str(folder)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert "no robot of this user is up" in done.stderr + done.stdout
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("arguments", OPERATING, ids=lambda given: " ".join(given))
def test_an_operating_command_loads_neither_kernels_nor_the_config(arguments: list[str], tmp_path: Path) -> None:
    found = loaded_by(arguments, tmp_path)
    assert {"numba", "scipy", "navloom.config", "navloom.engine.catalogue"} & found == set()


def test_a_stop_does_not_wait_for_the_command_line_or_arrays(tmp_path: Path) -> None:
    found = loaded_by(["stop"], tmp_path)
    assert {"typer", "pydantic", "numpy", "rich", "navloom.messages"} & found == set() and "zenoh" in found


def test_the_ports_that_tools_know_are_those_of_the_nodes() -> None:
    def told(ports: Any) -> list[tuple[Any, ...]]:
        return [(p.role, p.name, p.carries, p.retained) for p in ports.ports()]

    assert told(FRAMEWORK_PORTS) == told(FRAMEWORK)


@pytest.mark.parametrize(
    ("words", "options"),
    [
        ([], {}),
        (["--all"], {"every": True}),
        (["--robot", "lab/r1", "--insecure"], {"robot": "lab/r1", "insecure": True}),
        (["--connect=tcp/h:1", "--keys", "k"], {"connect": "tcp/h:1", "keys": "k"}),
        (["--help"], None),
        (["--robot"], None),
        (["--robot", "--all"], None),
        (["--robots", "r1"], None),
        (["--log-json"], None),
        (["r1"], None),
    ],
)
def test_plain_options_of_a_stop_are_read_at_once(words: list[str], options: dict[str, Any] | None) -> None:
    assert read_options(words) == options


def test_every_option_that_a_stop_reads_at_once_is_one_of_the_command() -> None:
    command = AddedCommand([point for point in added_commands() if point.name == "stop"]).made()
    own = {
        name: param.name for param in command.params for name in param.opts if param.name in stop_robots.__annotations__
    }
    assert own == stop_command.VALUES | stop_command.FLAGS


class Robots:
    """Robots that are up, of which some do not answer; `stopped` names those that got a stop."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *names: str, silent: str = "") -> None:
        self.stopped: list[str] = []
        there = [Running("lab", name, 1, (), False, "paper", False) for name in names]

        @contextmanager
        def join(robot: str, *_: object, **__: object) -> Iterator[SimpleNamespace]:
            yield SimpleNamespace(stop=lambda: stop(robot))

        def stop(robot: str) -> None:
            if robot == silent:
                raise ClientError("gate main does not answer")
            self.stopped.append(robot)

        monkeypatch.setattr(stop_command, "robots", lambda: iter(there))
        monkeypatch.setattr(stop_command, "elsewhere", dict)
        monkeypatch.setattr(stop_command, "join", join)


def test_stop_for_all_stops_every_robot(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    there = Robots(monkeypatch, "a", "b")
    assert stop_robots(every=True) == 0 and sorted(there.stopped) == ["lab/a", "lab/b"]
    assert capsys.readouterr().out == f"lab/a: {STOPPED}\nlab/b: {STOPPED}\n"


def test_stop_for_all_continues_after_one_that_fails_and_then_fails_itself(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    there = Robots(monkeypatch, "a", "b", silent="lab/a")
    assert stop_robots(every=True) == 1 and there.stopped == ["lab/b"]
    assert capsys.readouterr().out == f"lab/a: not stopped: gate main does not answer\nlab/b: {STOPPED}\n"


@pytest.mark.parametrize("given", [{"robot": "lab/a"}, {"connect": "tcp/h:1"}])
def test_stop_for_all_with_one_robot_named_is_refused(given: dict[str, str]) -> None:
    with pytest.raises(DirectoryError, match="leave --robot and --connect out"):
        stop_robots(every=True, **given)


def test_a_stop_on_the_command_line_ends_with_the_same_code(monkeypatch: pytest.MonkeyPatch) -> None:
    from navloom.cli.options import RobotOptions
    from navloom_live.cli.operate import stop

    Robots(monkeypatch, "a", silent="lab/a")
    with pytest.raises(typer.Exit) as ended:
        stop(True, robot=RobotOptions())
    assert ended.value.exit_code == 1
