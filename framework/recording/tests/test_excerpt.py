"""Replay of one node or one step of a recording: the repeated steps, where a debugger stops, and refusals."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from navloom.config import ConfigError
from navloom.engine.build import assemble
from navloom.entry_kinds import TRACEBACK
from navloom.plugins.error_origin import traceback_of
from navloom.runs.episode import Episode, run_episode
from navloom_recording.excerpt import DebuggerLeft, Excerpt, excerpt_of, repeating
from navloom_recording.lockstep_recorder import LockstepRecorder
from navloom_recording.reader import Recording
from navloom_recording.recording_header import header_of
from navloom_recording.replay_check import NodeCheck, check
from navloom_recording.step_replay import Replayer
from navloom_recording.writer import RecordingWriter
from toys import discovery, toy_config

FAILS = ("controller.fails_at_ns=1_000_000_000", "run.stop_after=3.0")
"""The controller raises at 1 s, in tick 20."""
ALTERNATIVE = """
[[alternative]]
name = "strong"
role = "controller"
plugin = "toy_chaser"
gain = 2.0
"""


def record(folder: Path, more: str, *changes: str) -> tuple[Path, Episode]:
    """Record a run of the toys; gives the recording and the episode."""
    loaded, path = toy_config(folder, *changes, more=more), folder / "run.mcap"
    with LockstepRecorder(RecordingWriter(path, header_of(loaded, "lockstep", {})), print) as recorder:
        return path, run_episode(loaded, discovery=discovery(), observers=[recorder])


def part(path: Path, only: str | None = None, until: int | None = None, pdb: bool = False) -> list[NodeCheck]:
    recording = Recording(path)
    excerpt = excerpt_of(recording, only, until, pdb)
    return check(Replayer(recording, assemble(recording.header.loaded(), discovery()), excerpt=excerpt))


@pytest.fixture(scope="module")
def failed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("failed"), "", *FAILS)[0]


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[[str], Callable[[], str]]:
    """Types into the debugger; gives its output."""

    def type_in(text: str) -> Callable[[], str]:
        monkeypatch.setattr(sys, "stdin", io.StringIO(text))
        return lambda: capsys.readouterr().out

    return type_in


def test_the_command_of_a_fault_repeats_that_step_alone(failed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(TRACEBACK, "1")
    (found,) = part(failed, "controller", 20)
    assert (found.node, found.differing, found.faults) == ("controller toy_chaser", 0, 1)
    fault = found.last_fault
    assert fault is not None and (fault.tick, fault.is_recorded) == (20, True)
    assert fault.text.startswith("RuntimeError: broke (toys.py:")
    assert 'raise RuntimeError("broke")' in traceback_of(fault.text)


def test_no_step_after_the_given_tick_is_repeated(failed: Path) -> None:
    found = {node_check.node: node_check for node_check in part(failed, None, 10)}
    assert found["goal main"].steps == 11 and all(one.faults == 0 for one in found.values())


def test_a_run_names_the_tick_that_its_command_needs(tmp_path: Path) -> None:
    _, episode = record(tmp_path, "", *FAILS)
    assert episode.log.failed == [("controller", "toy_chaser", 20)]
    command = repeating(Path("my runs/f.mcap"), *episode.log.failed[0], is_only=True)
    assert command == "navloom replay 'my runs/f.mcap' --only controller --until 20 --traceback"


def test_the_debugger_stops_in_the_first_line_of_the_verb(
    failed: Path, typed: Callable[[str], Callable[[], str]]
) -> None:
    printed = typed("p given.stamp_ns\np self.params.fails_at_ns\nc\n")
    (found,) = part(failed, "controller", 20, pdb=True)
    said = printed()
    assert "toys.py(" in said and "control()\n" in said and said.count("1000000000") == 2
    assert found.faults == 1


def test_the_debugger_needs_no_node_where_one_failed(failed: Path, typed: Callable[[str], Callable[[], str]]) -> None:
    printed = typed("c\n")
    part(failed, None, 20, pdb=True)
    assert "control()\n" in printed()


def test_the_debugger_stops_in_a_node_of_the_framework(failed: Path, typed: Callable[[str], Callable[[], str]]) -> None:
    printed = typed("c\n")
    part(failed, "reference", 5, pdb=True)
    assert "step()\n" in printed()


def test_leaving_the_debugger_ends_the_replay(failed: Path, typed: Callable[[str], Callable[[], str]]) -> None:
    typed("q\n")
    with pytest.raises(DebuggerLeft):
        part(failed, "controller", 19, pdb=True)


@pytest.mark.parametrize(
    ("only", "until", "pdb", "message"),
    [
        ("controler", None, False, "--only controler: no such node stepped; did you mean 'controller'?"),
        (
            "controller",
            21,
            False,
            "--until 21: controller.toy_chaser made no step in that tick; the step before was in",
        ),
        ("platform", None, False, "--only platform: what the platform said is the input of a replay"),
        (None, None, True, "--pdb: expected --until TICK too"),
        (None, 5, True, "--pdb: choose a node by --only; those that stepped in tick 5: localizer.odometry, "),
    ],
)
def test_a_node_or_tick_that_does_not_exist_is_refused(
    failed: Path, only: str | None, until: int | None, pdb: bool, message: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        excerpt_of(Recording(failed), only, until, pdb)
    assert str(refused.value).startswith(message)


def test_with_several_instances_one_must_be_named(tmp_path: Path) -> None:
    path, _ = record(tmp_path, ALTERNATIVE, "run.stop_after=1.0")
    recording = Recording(path)
    with pytest.raises(ConfigError, match=r"there are controller.strong and controller.toy_chaser; choose one"):
        excerpt_of(recording, "controller", None, False)
    assert excerpt_of(recording, "controller.strong", 3, False) == Excerpt(("controller", "strong"), 3)
    (found,) = part(path, "controller.strong")
    assert found.differing == 0 and found.messages > 5
