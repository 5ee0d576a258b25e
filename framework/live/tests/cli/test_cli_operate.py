"""Requests that are refused before a robot is looked for, `down`, and broken standard output."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from navloom.cli.main import app
from navloom.cli.run_observers import watched_for_stalls
from navloom.runs import episode
from navloom_live.hosting.runtime_folders import DirectoryError
from navloom_live.operating.host_faults import left_running
from typer.testing import CliRunner

NUMBER, SECONDS = "expected a finite number", "expected a number of seconds above 0"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["goal", "nan", "1"], NUMBER),
        (["goal", "0", "inf"], NUMBER),
        (["goal", "0", "1", "nan"], "got nan, expected degrees of -360 to 360"),
        (["goal", "0", "1", "--via", "nan,1"], "--via nan,1: expected two finite numbers"),
        (["goal", "0", "1", "--timeout", "-3"], SECONDS),
        (["goal", "0", "1", "--timeout", "nan"], SECONDS),
        (["goal", "0", "1", "900"], "got 900, expected degrees of -360 to 360"),
        (["place", "0", "1", "-361"], "got -361, expected degrees of -360 to 360"),
        (["swap", "avoider", "idle", "--timeout", "0"], SECONDS),
        (["teleop", "--vx", "nan"], NUMBER),
        (["teleop", "--wz=-inf"], NUMBER),
        (["teleop", "--vx", "0.1", "--for", "-1"], SECONDS),
        (["teleop", "--speed", "nan"], NUMBER),
        (["hz", "gate/command", "--for", "inf"], SECONDS),
        (["params", "set", "controller", "k3"], "'k3': expected NAME=VALUE"),
        (["params", "set", "controller", "k3=1", "k3=2"], "k3 is given twice"),
    ],
    ids=lambda given: "-".join(given) if isinstance(given, list) else "",
)
def test_a_wrong_number_is_refused_before_anything_is_sent(arguments: list[str], text: str) -> None:
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 2 and text in " ".join(done.output.replace("\u2502", " ").split())


@pytest.mark.parametrize("words", [("up",), ("up", "--barrier")])
def test_a_config_that_cannot_drive_is_not_started(
    in_process: Callable[..., tuple[int, str, str]], tmp_path: Path, words: tuple[str, ...]
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text('[world]\nref = "doorway"\n[[sensor]]\nname = "laser"\nkind = "laser_2d"\n', "utf-8")
    code, said, error = in_process(*words, str(path))
    assert (code, said) == (2, "")
    assert error.splitlines()[-1].startswith(f"navloom: {path}: mapper.plugin: ipabd, the default, needs a sensor")


def test_down_for_every_robot_says_that_none_is_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(tmp_path))
    done = CliRunner().invoke(app, ["down", "--all"])
    assert (done.exit_code, done.output) == (0, "no robot of this user is up on this host\n")


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux shows the environment of a process")
@pytest.mark.parametrize("arguments", [[], ["--robot", "lab/r1"], ["--robot", "r1"], ["--all"]])
def test_down_names_and_ends_processes_left_over_by_a_killed_up(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NAVLOOM_RUNTIME_DIR", str(tmp_path))
    gone = subprocess.Popen(["true"])
    gone.wait()
    mark = f"{gone.pid}:{tmp_path / 'lab.r1'}"
    environment = {**os.environ, "NAVLOOM_SUPERVISED": mark, "NAVLOOM_PROCESS": "drive"}
    left = subprocess.Popen(["sleep", "60"], env=environment)
    try:
        what = f"process {left.pid} (sleep 60) of drive"
        limit = time.monotonic() + 10.0
        while not left_running() and time.monotonic() < limit:  # its environment appears a moment after the process
            time.sleep(0.01)
        (found,) = left_running()
        assert found.what == f"{what}: still running, although robot lab/r1 is down"
        assert found.remedy.startswith("`navloom down --robot lab/r1` ends them")
        refused = CliRunner().invoke(app, ["down", "--robot", "lab/r2"])
        assert isinstance(refused.exception, DirectoryError) and left.poll() is None  # another robot's
        done = CliRunner().invoke(app, ["down", *arguments])
        assert (done.exit_code, done.output) == (0, f"lab/r1: ended orphaned processes: {what}\n")
        assert left_running() == []
    finally:
        left.kill()
        left.wait()


def test_down_for_every_robot_continues_after_one_that_cannot_be_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    from navloom_live.cli import up
    from navloom_live.hosting.runtime_folders import DirectoryError, Running

    there = [Running("lab", name, 1, (), False, "paper", False) for name in ("a", "b")]
    ended = []

    def end(running: Running) -> None:
        if running.robot == "a":
            raise DirectoryError("robot lab/a was not brought up by `navloom up`")
        ended.append(running.robot)

    monkeypatch.setattr("navloom_live.hosting.runtime_folders.robots", lambda: iter(there))
    monkeypatch.setattr(up, "_end", end)
    done = CliRunner().invoke(app, ["down", "--all"])
    assert ended == ["b"] and "lab/b is down" in done.output
    assert isinstance(done.exception, DirectoryError) and "lab/a" in str(done.exception)


def test_a_command_works_with_standard_output_closed() -> None:
    command = f"{sys.executable} -c 'from navloom.cli import main; main()' plugins >&-"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_full_disk_behind_standard_output_is_one_message() -> None:
    command = f"{sys.executable} -c 'from navloom.cli import main; main()' plugins --json >/dev/full"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=60, check=False)
    assert done.stderr == "navloom: standard output or a temporary file: No space left on device\n"
    assert done.returncode == 1


def test_output_of_a_plugin_does_not_get_into_the_json(monkeypatch: pytest.MonkeyPatch) -> None:
    inner = episode.run_episode

    def talkative(*given: Any, **named: Any) -> Any:
        print("hello from a plugin")
        return inner(*given, **named)

    monkeypatch.setattr(episode, "run_episode", talkative)
    done = CliRunner().invoke(app, ["run", "paper", "--set", "run.stop_after=1.0", "--json"])
    assert json.loads(done.stdout)["outcome"] == "timeout" and "hello from a plugin" in done.stderr


def test_a_run_that_compiles_is_not_reported_as_hanging_but_one_that_never_begins_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    said: list[str] = []
    monkeypatch.setattr("navloom.cli.run_observers.LOG.warning", said.append)
    limit = time.monotonic() + 20.0
    with watched_for_stalls(lambda done, total: None, patience=0.05):
        while not said and time.monotonic() < limit:
            pass
    assert said[0].startswith("no tick for 0.6 s: the run is at test_cli_operate.py:")


def test_a_run_that_makes_no_progress_reports_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr("navloom.cli.run_observers.LOG.warning", said.append)
    limit = time.monotonic() + 20.0
    with watched_for_stalls(lambda done, total: None, patience=0.05) as tell:
        tell(0.0, 1.0)
        while not said and time.monotonic() < limit:
            pass
    (text,) = said
    assert text.startswith("no tick for 0.05 s: the run is at test_cli_operate.py:")
    assert text.endswith(", in test_a_run_that_makes_no_progress_reports_where_it_is; Ctrl-C ends it")


def test_the_compilation_of_a_kernel_is_not_reported_as_hanging(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr("navloom.cli.run_observers.LOG.warning", said.append)
    compiler: dict[str, Any] = {"__name__": "numba.core.compiler", "time": time}
    exec("def compiled(said, limit):\n    while not said and time.monotonic() < limit: pass", compiler)
    with watched_for_stalls(lambda done, total: None, patience=0.05) as tell:
        tell(0.0, 1.0)
        compiler["compiled"](said, time.monotonic() + 20.0)
    assert said[0].startswith("no tick for 0.05 s: a kernel is being compiled for test_cli_operate.py:")
