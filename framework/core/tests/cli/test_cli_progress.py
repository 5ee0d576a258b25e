"""Progress of a run: one line, reports of a run that hangs, and of a slow plugin."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import re
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest
from navloom.cli import run_observers
from navloom.cli.output import LOG, paced, stage
from navloom.kernel_cache import _count_compiled
from navloom.messages import PoseEstimate
from navloom.navigation.dead_reckoning import OdometryLocalizer
from navloom.roles import LocalizerInput

Run = Callable[..., tuple[int, str, str]]
MEMBERS = (("a", 0.0), ("b", 2.0))
"""Names, and where they start along x, m."""


@pytest.fixture
def slowed(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Make every step of the localizer wait, or compute, `by` s longer."""
    real = OdometryLocalizer.localize

    def slow(by: float, computes: bool = False) -> None:
        def localize(self: OdometryLocalizer, given: LocalizerInput) -> PoseEstimate:
            until = time.thread_time() + by
            while computes and time.thread_time() < until:
                pass
            time.sleep(0.0 if computes else by)
            return real(self, given)

        monkeypatch.setattr(OdometryLocalizer, "localize", localize)

    return slow


SAYING = """
import sys, time
from navloom.cli.output import say_so, stage
from navloom.logs import Level, set_up_logging

set_up_logging(Level.INFO, as_json=False)

with stage(False) as (_, progress):
    for done in range(3):
        progress(done, 3.0)
        time.sleep(0.15)
        say_so(f"message {done}")
"""


def test_other_output_leaves_no_second_line_of_progress() -> None:
    ours, theirs = pty.openpty()
    process = subprocess.Popen([sys.executable, "-c", SAYING], stderr=theirs, env=os.environ | {"TERM": "xterm"})
    os.close(theirs)
    said = b""
    with contextlib.suppress(OSError):  # which is how a terminal ends
        while data := os.read(ours, 65536):
            said += data
    os.close(ours)
    assert process.wait(60) == 0
    # What remains of each line on the screen after it was last erased.
    lines = [line.rsplit("\x1b[2K", 1)[-1] for line in said.decode().replace("\r", "").split("\n")]
    left = [re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", line).strip() for line in lines]
    assert [line for line in left if line.startswith("navloom: ")] == [f"navloom: message {done}" for done in range(3)]
    assert sum("driving" in line for line in left) <= 1  # the last one, which the next code erases


def test_without_a_terminal_the_first_kernel_is_told_and_then_one_in_ten_seconds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    monkeypatch.setattr("navloom.kernel_progress._expected", 40 * [SimpleNamespace(signatures=[])])
    with stage(quiet=True):
        assert capsys.readouterr().err == ""
        for now[0] in (1.0, 6.0, 11.0, 12.0):
            _count_compiled()
    _count_compiled()
    assert capsys.readouterr().err.splitlines() == [
        "navloom: compiling kernels, which later runs load: kernel 0 of 40",
        "navloom: compiling kernel 0 of 40",
    ]


def test_a_slow_plugin_is_named_with_its_delay(in_process: Run, slowed: Callable[..., None]) -> None:
    slowed(0.003, computes=True)
    words = ("run", "paper", "--set", "run.period=0.001", "--set", "run.stop_after=0.05")
    _, said, errors = in_process(*words, "--json")
    warnings = json.loads(said)["warnings"]
    (found,) = [warning for warning in warnings if (warning["kind"], warning["role"]) == ("slow", "localizer")]
    figures = found["figures"]
    assert figures["late"] == figures["steps"] >= 50 and figures["cpu_p99_ms"] > 3.0 and figures["limit_ms"] == 1.0
    told = f"localizer {found['instance']} is slow: {figures['late']} of its {figures['steps']} steps computed "
    assert told + "for longer than the 1 ms to the next one, p99 " in errors


def test_a_plugin_that_waits_is_late_and_not_slow(in_process: Run, slowed: Callable[..., None]) -> None:
    slowed(0.003)
    words = ("run", "paper", "--set", "run.period=0.001", "--set", "run.stop_after=0.05")
    _, said, _ = in_process(*words, "--json")
    (found,) = [warning for warning in json.loads(said)["warnings"] if warning["role"] == "localizer"]
    figures = found["figures"]
    assert found["kind"] == "late" and figures["cpu_p99_ms"] < 1.0 < 3.0 < figures["p99_ms"]
    assert f"(load {figures['load']:.1f} on " in found["text"] and "a live robot would stop" not in found["text"]


def test_a_plugin_that_keeps_up_is_not_named(in_process: Run) -> None:
    code, said, errors = in_process("run", "paper", "--set", "run.period=1.0", "--set", "run.stop_after=30", "--json")
    assert code == 1 and json.loads(said)["warnings"] == [] and "is slow" not in errors


def impatient(monkeypatch: pytest.MonkeyPatch, patience: float) -> None:
    """Report a run without a tick for this long, s."""
    monkeypatch.setattr(
        run_observers, "watched_for_stalls", partial(run_observers.watched_for_stalls, patience=patience)
    )


def test_a_fleet_that_makes_no_progress_reports_where_it_is(
    in_process: Run, slowed: Callable[[float], None], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    fleet = "[run]\nstop_after = 0.1\n" + "".join(
        f'[[member]]\nname = "{name}"\nconfig = "paper"\nstart = {{ x = {x}, y = 0.0 }}\n' for name, x in MEMBERS
    )
    (tmp_path / "fleet.toml").write_text(fleet)
    slowed(1.0)
    impatient(monkeypatch, 0.2)
    _, _, errors = in_process("run", str(tmp_path / "fleet.toml"), "--json")
    assert "no tick for 0.2 s: the run is at test_cli_progress.py:" in errors


def test_a_run_of_slow_ticks_is_not_reported_as_hanging(
    in_process: Run, slowed: Callable[[float], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    slowed(0.1)
    impatient(monkeypatch, 1.0)
    code, _, errors = in_process("run", "paper", "--set", "run.stop_after=0.75", "--json")
    assert code == 1 and "no tick for 1 s" not in errors  # 17 ticks in 1.7 s


def test_lines_of_progress_come_at_most_every_10_s(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 4.0, 11.0, 11.0, 20.0, 21.5, 21.5])  # at the start, for each text, again if said
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    said: list[str] = []
    monkeypatch.setattr(LOG, "info", said.append)
    say = paced()
    for text in ("at 4", "at 11", "at 20", "at 21.5"):
        say(text)
    assert said == ["at 11", "at 21.5"]
