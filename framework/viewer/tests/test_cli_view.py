"""`navloom run --rerun`, `compare --rerun` and `view`: what they write, and what they refuse."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib import import_module
from multiprocessing import active_children
from pathlib import Path
from urllib.request import urlopen

import pytest
from navloom_viewer import viewer_errors
from navloom_viewer.program import Program, is_up

rerun = pytest.importorskip("rerun", reason="the extra `view` is not installed")
CONFIG = """
[run]
stop_after = 20.0

[robot]
footprint = { length = 0.8, width = 0.8 }

[world]
ref = "empty"

[mapper]
plugin = "known_map"

[controller]
plugin = "kanayama"
k_y = 20.0

[navigation]
start = { x = 0.0, y = 0.0, heading_deg = 90.0 }
goal = { x = 0.0, y = 1.0 }

[[sensor]]
name = "sonars"
kind = "sonar_ring"
layout = "p3dx"

[[alternative]]
name = "forces"
role = "avoider"
plugin = "vff"
shadow = true
"""
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def config(tmp_path: Path) -> str:
    path = tmp_path / "robot.toml"
    path.write_text(CONFIG, "utf-8")
    return str(path)


def entities(path: Path) -> set[str]:
    """Entities of an .rrd file except its layout, as the viewer's own program reads it."""
    binary = Path(str(import_module("rerun_cli").__file__)).parent / "rerun"
    done = subprocess.run([binary, "rrd", "print", path], capture_output=True, text=True, check=True)
    ours = ("/run/", "/world/", "/metrics/", "/goal", "/driver", "/avoider", "/histogram/", "/log/", "/legend", "/tf/")
    return {word for line in done.stdout.splitlines() for word in line.split() if word.startswith(ours)}


def test_a_run_that_is_written_for_the_viewer_has_the_same_trace(config: str, in_process: Run, tmp_path: Path) -> None:
    code, out, _ = in_process("run", config, "--json")
    file = tmp_path / "kept" / "run.rrd"
    same, shown, err = in_process("run", config, "--json", "--rerun", str(file))
    assert (code, same) == (0, 0), err
    assert json.loads(shown)["trace_sha256"] == json.loads(out)["trace_sha256"]
    assert {"/run/r1/driven", "/run/r1/trajectory", "/run/forces/base/command", "/log/r1/goal"} <= entities(file)


FLEET = """
[run]
stop_after = 0.5

[world]
ref = "oncoming"

[[member]]
name = "a"
config = "explore"
start = { x = -0.5, y = 0.0, heading_deg = 90.0 }

[[member]]
name = "b"
config = "explore"
start = { x = 0.5, y = 0.0, heading_deg = 90.0 }
"""


def test_a_fleet_and_who_walks_in_its_world_are_in_one_picture(in_process: Run, tmp_path: Path) -> None:
    config, file = tmp_path / "fleet.toml", tmp_path / "fleet.rrd"
    config.write_text(FLEET, "utf-8")
    code, out, err = in_process("run", str(config), "--json", "--rerun", str(file))
    assert code == 1, err  # not there after 0.5 s
    (told,) = json.loads(out)["written"]["rerun"]
    assert told["file"] == str(file) and told["complete"]
    found = entities(file)
    assert {"/run/a/driven", "/run/b/driven"} <= found
    assert len([path for path in found if path.endswith("/body_names")]) == 1  # the person is drawn once


@pytest.mark.slow  # two further child processes
def test_a_recording_shows_what_the_run_showed(config: str, in_process: Run, tmp_path: Path) -> None:
    file, recording, again = tmp_path / "run.rrd", tmp_path / "run.mcap", tmp_path / "again.rrd"
    code, _, err = in_process("run", config, "--rerun", str(file), "--record", str(recording))
    assert code == 0, err
    code, out, err = in_process("view", str(recording), "--rerun", str(again), "--json")
    assert (code, err) == (0, "")
    counts = json.loads(out)
    assert counts["is_complete"]
    assert (counts["dropped"], counts["dropped_live"], counts["notes"]) == (0, 0, [])
    assert entities(again) == entities(file)


@pytest.mark.slow  # a child process and two further runs
def test_methods_side_by_side_end_in_one_file_and_one_table(config: str, in_process: Run, tmp_path: Path) -> None:
    file = tmp_path / "both.rrd"
    words = ("compare", config, "--vary", "controller=kanayama,pure_pursuit", "--rerun", str(file))
    code, out, err = in_process(*words, "--json")
    assert code == 0, err
    found = json.loads(out)
    assert {name: method["outcome"] for name, method in found["methods"].items()} == dict.fromkeys(
        ("kanayama", "pure_pursuit"), "succeeded"
    )
    assert {"/run/kanayama/driven", "/run/pure_pursuit/driven", "/legend"} <= entities(file)


@pytest.mark.slow  # at the speed of the clock
def test_methods_drive_side_by_side_for_a_viewer_that_runs(config: str, in_process: Run, tmp_path: Path) -> None:
    server = Program(options=("--serve-grpc",))
    try:
        file = tmp_path / "both.rrd"
        words = ("compare", config, "--vary", "controller=kanayama,pure_pursuit", "--rerun", str(file))
        code, out, err = in_process(*words, "--viewer", server.url, "--json")
    finally:
        server.end()
    assert code == 0, err
    assert len(json.loads(out)["methods"]) == 2
    assert "did not reach" not in err
    assert "were dropped" not in err
    assert {"/run/kanayama/driven", "/run/pure_pursuit/driven"} <= entities(file)


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGKILL, marks=pytest.mark.slow)])
def test_a_browser_is_served_until_the_command_ends(number: signal.Signals, tmp_path: Path) -> None:
    kept = tmp_path / "kept.rrd"
    stream = rerun.RecordingStream("navloom")
    stream.save(kept)
    stream.disconnect()
    words = [sys.executable, "-m", "navloom", "view", str(kept), "--web"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as command:
        try:
            assert command.stderr is not None
            line = command.stderr.readline()
            found = re.search(r"the viewer is served at (http://127.0.0.1:(\d+))\?url=\S+ until Ctrl-C", line)
            assert found is not None, line
            with urlopen(found[1], timeout=10.0) as page:
                assert b"<canvas" in page.read()
            command.send_signal(number)
            assert command.wait(20.0) == (0 if number == signal.SIGINT else -number)
        finally:
            command.terminate()  # bounded, in case the server does not answer
    limit = time.monotonic() + 10.0
    while is_up("127.0.0.1", int(found[2])):
        assert time.monotonic() < limit, "the server outlives its command"
        time.sleep(0.02)


# --- no display -----------------------------------------------------------------------------------------------------


@pytest.fixture
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    """Removes the display, as on a robot's computer or over SSH."""
    if sys.platform != "linux":
        pytest.skip("only Linux tells by the environment whether there is a display")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("no_display")
@pytest.mark.parametrize("command", ["run", "compare", "view rrd", "view mcap", "view"])
def test_without_a_display_nothing_runs_and_the_message_says_what_to_do(
    command: str, config: str, in_process: Run, tmp_path: Path
) -> None:
    file, out = tmp_path / "some.rrd", tmp_path / "out"
    words = {
        "run": ("run", config, "--view", "--out", str(out), "--record", str(tmp_path / "run.mcap")),
        "compare": ("compare", config, "--vary", "controller=kanayama,pure_pursuit", "--view"),
        "view rrd": ("view", str(file)),
        "view mcap": ("view", str(file.with_suffix(".mcap"))),
        "view": ("view",),
    }[command]
    for kept in (file, file.with_suffix(".mcap")):
        kept.touch()
    before = set(tmp_path.iterdir())
    code, said, err = in_process(*words)
    assert (code, said) == (2, "")
    ways = "--web serves the viewer to a browser"
    if command != "view rrd":
        ways += ", --rerun F.rrd keeps what it would show in a file"
    last = f"navloom: there is no display here, neither DISPLAY nor WAYLAND_DISPLAY is set: {ways}"
    assert err.splitlines()[-1] == last
    assert set(tmp_path.iterdir()) == before


@pytest.mark.usefixtures("no_display")
def test_a_display_that_does_not_answer_is_reported_before_anything_runs(
    config: str, in_process: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":98765")  # no X server can have this number: its port would be above 65535
    code, said, err = in_process("run", config, "--view", "--out", str(tmp_path / "out"))
    assert (code, said) == (2, "")
    assert re.fullmatch(r"navloom: the viewer opens no window: [^/]+; --web serves .*, --rerun F.rrd keeps .*\n", err)
    assert not (tmp_path / "out").exists()
    assert not [child for child in active_children() if "viewer" in child.name]


def test_a_viewer_that_fails_later_is_reported_after_the_result_with_exit_code_1(
    config: str, in_process: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Failing(Program):
        """A server in place of a window, killed once it has received data."""

        def __init__(self, web: bool = False, files: tuple[Path, ...] = (), options: tuple[str, ...] = ()) -> None:
            super().__init__(web, files, ("--serve-grpc",))

        def await_window(self) -> None:
            self.process.kill()
            self.process.wait()

    monkeypatch.setattr("navloom_viewer.viewer_session.Program", Failing)
    monkeypatch.setenv("DISPLAY", ":0")
    code, out, err = in_process("run", config, "--view")
    assert code == 1
    assert out.startswith("succeeded: the goal was reached")
    assert err.splitlines()[-1].startswith("navloom: the viewer ended: ")


@pytest.mark.parametrize("command", ["run", "view", "compare"])
def test_without_the_extra_one_message_says_what_to_install(
    command: str, config: str, in_process: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(viewer_errors, "import_module", missing)
    file = tmp_path / "some.rrd"
    file.touch()
    words = {
        "run": ("run", config, "--rerun", str(tmp_path / "x.rrd")),
        "view": ("view", str(file)),
        "compare": ("compare", config, "--vary", "controller=kanayama,pure_pursuit", "--view"),
    }[command]
    code, out, err = in_process(*words)
    assert (code, out) == (2, "")
    assert err.splitlines()[-1] == (
        "navloom: the viewer needs the extra `view`: uv sync --group view, or pip install 'navloom[view]'"
    )


def test_a_file_that_is_no_recording_is_refused(in_process: Run, tmp_path: Path) -> None:
    code, _, err = in_process("view", str(tmp_path / "gone.mcap"))
    assert code == 2
    why = "there is no such file; expected a recording, as `navloom record` writes it"
    assert err == f"navloom: {tmp_path}/gone.mcap: {why}\n"
    notes = tmp_path / "notes.mcap"
    notes.write_text("not a recording", "utf-8")
    code, _, err = in_process("view", str(notes), "--rerun", str(tmp_path / "x.rrd"))
    assert code == 2
    assert "not a recording" in err


def test_contradicting_options_are_refused(in_process: Run) -> None:
    code, _, err = in_process("view", "--viewer", "127.0.0.1:9876", "--web")
    assert code == 2
    assert err == "navloom: --viewer and --web: choose the viewer that runs, or a new one\n"
