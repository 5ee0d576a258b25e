"""Runs of toys in lockstep, recorded and replayed: the same bit for bit, or the difference is named."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.wiring import runs
from navloom.messages import Command, Envelope, Pose2D, PoseEstimate, StepReport, Twist2D
from navloom.messages.codec import decode, encode
from navloom.plugins import PluginError
from navloom.runs.episode import run_episode
from navloom.runs.shadow_comparison import shadow_table
from navloom_recording.localizer_track import LocalizerTrack
from navloom_recording.lockstep_recorder import LockstepRecorder
from navloom_recording.message_comparison import first_difference
from navloom_recording.missing_plugins import refuse_missing
from navloom_recording.reader import Recording
from navloom_recording.recording_header import header_of
from navloom_recording.replay_check import NodeCheck, check
from navloom_recording.step_replay import Replayer
from navloom_recording.substitutes import substitute_config
from navloom_recording.writer import RecordingWriter
from toys import discovery, toy_config

MORE = """
[[alternative]]
name = "strong"
role = "controller"
plugin = "toy_chaser"
gain = 2.0
[[alternative]]
name = "shy"
role = "avoider"
plugin = "toy_bystander"
shadow = false
[[event]]
at = 1.0
do = "set"
role = "controller"
values = { gain = 1.5 }
[[event]]
at = 1.5
do = "swap"
role = "avoider"
name = "shy"
[[event]]
at = 2.0
do = "stop"
[[event]]
at = 2.5
do = "resume"
"""


def record(folder: Path, more: str = "", *changes: str) -> tuple[Path, Any]:
    """Record a run of the toys; gives the recording and the episode."""
    loaded = toy_config(folder, *changes, more=more)
    path = folder / "run.mcap"
    said: list[str] = []
    writer = RecordingWriter(path, header_of(loaded, "lockstep", {}))
    with LockstepRecorder(writer, said.append) as recorder:
        episode = run_episode(loaded, discovery=discovery(), observers=[recorder])
    assert not said
    return path, episode


def replayed(path: Path) -> dict[str, NodeCheck]:
    recording = Recording(path)
    return {one.node: one for one in check(Replayer(recording, assemble(recording.header.loaded(), discovery())))}


def rewritten(path: Path, change: Any) -> Path:
    """A copy of a recording with messages changed by `change`; those for which it gives None are left out."""
    recording = Recording(path)
    out = path.with_name("changed.mcap")
    with RecordingWriter(out, recording.header) as writer:
        for raw in recording.raw():
            message, at = decode(raw.data, raw.label)
            changed = change(message, at)
            if changed is not None:
                writer.add(raw.key, raw.label, encode(changed, at), raw.received_ns, at.stamp_ns, at.sequence)
    return out


def test_recording_changes_nothing_and_a_replay_is_the_same_bit_for_bit(tmp_path: Path) -> None:
    path, episode = record(tmp_path, MORE)
    plain = run_episode(toy_config(tmp_path, more=MORE), discovery=discovery())
    assert episode.log.trace_sha256 == plain.log.trace_sha256 and episode.log.swaps == 1
    found = replayed(path)
    assert {name: node_check.first for name, node_check in found.items()} == dict.fromkeys(found)
    assert found["controller strong"].messages > 20 and found["avoider shy"].messages > 20
    assert found["gate main"].messages > 20 and found["goal main"].messages > 5
    assert all(not node_check.caveats() for node_check in found.values())
    assert not any(name.startswith(("platform", "operator")) for name in found)


def test_a_replay_with_latency_and_slower_nodes_is_the_same(tmp_path: Path) -> None:
    path, _ = record(tmp_path, "", "planner.latency=0.12", "controller.rate_hz=10.0")
    found = replayed(path)
    assert found["planner toy_straight"].messages == 1 and found["controller toy_chaser"].messages > 5
    assert not any(node_check.differing or node_check.unrecorded for node_check in found.values())


def test_every_step_is_recorded_with_what_it_published(tmp_path: Path) -> None:
    path, episode = record(tmp_path)
    reports = [
        message for message in Recording(path).messages(["localizer/*/step"]) if isinstance(message.message, StepReport)
    ]
    assert [report.envelope.sequence for report in reports] == list(range(1, episode.log.ticks + 1))
    last = reports[-1].message
    assert isinstance(last, StepReport)
    assert {mark.port: mark.sequence for mark in last.published} == {"pose": episode.log.ticks}
    assert {one.input: one.sequences for one in last.read}["odometry"] == (episode.log.ticks,)


def test_the_first_difference_is_named_with_tick_node_port_field_and_values(tmp_path: Path) -> None:
    path, _ = record(tmp_path)

    def change(message: Any, at: Envelope) -> Any:
        is_it = at.key.endswith("avoider/toy_bystander/command") and at.tick >= 12
        return Command(Twist2D(message.twist.vx + 0.25, 0.0, 0.0)) if is_it else message

    found = replayed(rewritten(path, change))
    first = found["avoider toy_bystander"].first
    assert first is not None
    assert (first.tick, first.node, first.port, first.field) == (12, "avoider toy_bystander", "command", "twist.vx")
    assert float(first.recorded) - float(first.replayed) == pytest.approx(0.25)
    assert str(first).startswith("tick 12, avoider toy_bystander, command.twist.vx: recorded ")


def test_a_missing_input_message_or_step_record_is_named(tmp_path: Path) -> None:
    path, _ = record(tmp_path)

    def change(message: Any, at: Envelope) -> Any:
        lost = at.key.endswith("localizer/odometry/pose") and at.tick == 7
        return None if lost or (at.key.endswith("avoider/toy_bystander/step") and at.tick == 9) else message

    found = replayed(rewritten(path, change))
    assert found["localizer odometry"].unrecorded == 1
    assert found["goal main"].not_fed == 1
    assert found["goal main"].first_not_fed == "tick 7 lacks pose (localizer.pose number 8)"
    assert found["avoider toy_bystander"].notes == ["1 step records before tick 10 are missing"]


def test_a_full_disk_ends_the_recording_and_not_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from navloom_recording import lockstep_recorder, writer

    monkeypatch.setattr(lockstep_recorder, "CLOSE_EVERY", 0.0)
    path = tmp_path / "run.mcap"
    loaded = toy_config(tmp_path)
    target = writer.RecordingWriter(path, header_of(loaded, "lockstep", {}))
    said: list[str] = []
    real = writer.os.write

    def full(descriptor: int, data: bytes) -> int:
        if target.size > 20_000:
            raise OSError(28, "No space left on device")
        return real(descriptor, data)

    monkeypatch.setattr(writer.os, "write", full)
    with LockstepRecorder(target, said.append) as recorder:
        episode = run_episode(loaded, discovery=discovery(), observers=[recorder])
    monkeypatch.undo()
    assert episode.summary()["truly_reached"] and len(said) == 1 and "No space left on device" in said[0]
    recording = Recording(path)
    assert not recording.is_complete and len(list(recording.messages())) > 10


def test_another_plugin_takes_the_place_of_the_recorded_one_in_the_config(tmp_path: Path) -> None:
    path, _ = record(tmp_path, MORE)
    loaded = Recording(path).header.loaded()
    chosen = substitute_config(loaded, "controller", "strong", ["controller.gain=3.0"]).config.controller
    assert (chosen.plugin, chosen.instance, chosen.params) == ("toy_chaser", "strong", {"gain": 3.0})
    other = substitute_config(loaded, "controller", "lyapunov_tracker").config.controller
    assert (other.plugin, other.instance, other.params) == ("lyapunov_tracker", "lyapunov_tracker", {})


def test_a_substitute_is_compared_tick_by_tick_with_the_active_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from navloom_recording import substitutes

    path, _ = record(tmp_path, "", "navigation.goal.y=1.0")
    monkeypatch.setattr(substitutes, "assemble", lambda loaded: assemble(loaded, discovery()))
    recording = Recording(path)
    loaded = recording.header.loaded()
    same = substitutes.substitute(recording, substitute_config(loaded, "controller", "toy_chaser"), "controller")
    assert same.found.ticks and not any(same.found.differing) and same.summary()["unanswered"] == 0
    faster = substitute_config(loaded, "controller", "toy_chaser", ["controller.gain=2.0"])
    found = substitutes.substitute(recording, faster, "controller")
    assert found.steps == same.steps and any(found.found.differing) and found.not_fed == []
    assert len(found.way) > len(found.found.ticks) > 0
    assert shadow_table([found.found]).splitlines()[0].startswith("time_s,tick,role,instance,quantity")


def test_missing_plugins_are_one_message_with_what_brings_them(tmp_path: Path) -> None:
    lacking = substitute_config(load_config("paper"), "controller", "winding").config
    versions = {"python": "3.11.2", "navloom": "0.1.0", "navloom-astar": "0.1.0"}
    recording: Any = SimpleNamespace(path=Path("run.mcap"), header=SimpleNamespace(versions=versions))
    refuse_missing(recording, load_config("paper").config)
    refuse_missing(recording, lacking, "controller")  # another one is tried in its place
    ways = {
        "": "install the distribution",
        "winding-ways": "pip install winding-ways==1.2",
        "/gone/x.py": "FILE.py, which",
    }
    for name, way in ways.items():
        recording.header.versions = versions | ({name: "1.2"} if name else {})
        with pytest.raises(PluginError) as raised:
            refuse_missing(recording, lacking)
        said = str(raised.value)
        assert said.startswith("run.mcap: the recorded config has controller.winding, not installed here: ")
        assert way in said and name in said and "`--controller NAME`" in said and "navloom-astar" not in said


def test_runs_of_consecutive_numbers() -> None:
    assert runs([]) == () and runs([4]) == (4, 4)
    assert runs([1, 2, 3, 7, 8, 2]) == (1, 3, 7, 8, 2, 2)


def test_the_first_differing_field_of_two_values_is_found() -> None:
    at = Twist2D(0.1, 0.0, 0.2)
    assert first_difference(Command(at), Command(at)) is None
    assert first_difference(Command(at), Command(Twist2D(0.1, 0.0, 0.3))) == ("twist.wz", "0.2", "0.3")
    assert first_difference(Command(Twist2D(0.0, 0.0, 0.0)), Command(Twist2D(-0.0, 0.0, 0.0))) == (
        "twist.vx", "0.0", "-0.0",
    )  # fmt: skip
    assert first_difference((1, 2), (1,)) == ("", "2 entries", "1 entries")
    assert first_difference(Command(at), at) == ("", "Command", "Twist2D")


def test_a_localizer_that_is_lost_is_told_with_its_times_and_its_covariance() -> None:
    states = ["tracking", "searching", "tracking", "searching", "lost", "lost"]
    covariance = np.diag([0.04, 0.09, 0.01])
    here, still = Pose2D(1.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0)
    estimates = [PoseEstimate(number, here, still, covariance, state) for number, state in enumerate(states)]
    poses = np.zeros((6, 7))
    poses[:, 0], poses[:, 4] = np.arange(6.0), 1.0
    track = LocalizerTrack(poses, estimates)
    found = track.summary()
    assert (found["searching_s"], found["lost_s"], found["not_tracking_from_s"]) == (2.0, 1.0, 3.0)
    row = track.table().splitlines()[5].split(",")
    assert row[-1] == "lost" and [float(value) for value in row[7:13]] == [0.04, 0.0, 0.0, 0.09, 0.0, 0.01]


def test_a_recording_that_joined_a_running_robot_does_not_differ_at_what_was_published_before(tmp_path: Path) -> None:
    """The mapper published its map in tick 0 only; a recorder that joins at tick 10 receives that map."""
    path, _ = record(tmp_path)

    def change(message: Any, at: Envelope) -> Any:
        return message if at.tick >= 10 or at.key.endswith("mapper/toy_blank/map") else None

    late = rewritten(path, change)
    assert [one.envelope.tick for one in Recording(late).messages(["mapper/*/map"])] == [0]
    mapper = replayed(late)["mapper toy_blank"]
    assert (mapper.steps, mapper.messages, mapper.differing, mapper.unrecorded) == (149, 0, 0, 0)


@pytest.mark.parametrize("is_live", [False, True])
def test_differences_of_a_node_whose_state_is_not_known_are_not_held_against_it(tmp_path: Path, is_live: bool) -> None:
    """A recorder joins a live robot at tick 10; one recorded command was changed."""
    path, _ = record(tmp_path)

    def change(message: Any, at: Envelope) -> Any:
        is_changed = at.tick == 20 and at.key.startswith("controller/") and isinstance(message, Command)
        return None if at.tick < 10 else Command(Twist2D(0.123, 0.0, 0.0)) if is_changed else message

    recording = Recording(rewritten(path, change))
    replayer = Replayer(recording, assemble(recording.header.loaded(), discovery()))
    replayer.is_live = is_live
    (controller,) = [one for one in check(replayer) if one.node.startswith("controller")]
    assert (controller.differing > 0, controller.unverified > 0) == (not is_live, is_live)
