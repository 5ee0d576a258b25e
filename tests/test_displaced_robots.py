"""Robots that are displaced or whose wheels slip, by the events of a config, in whole runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from navloom.config import ConfigError, load_config
from navloom.engine.build import assemble
from navloom.engine.plugin_factory import make_plugins
from navloom.plugins import Discovery
from navloom.runs.episode import Episode, run_episode
from navloom_recording.lockstep_recorder import LockstepRecorder
from navloom_recording.reader import Recording
from navloom_recording.recording_header import header_of
from navloom_recording.replay_check import check
from navloom_recording.step_replay import Replayer
from navloom_recording.writer import RecordingWriter
from navloom_sensors_sim.adapter import SensorsSim

CORRIDOR = ["world.ref=corridor", "localizer.plugin=odometry"]
AT_THE_END = "event=[{at=3.0,do='displace',by={x=0.5,y=0.1}},{at=4.0,do='slip',over=0.5}]"


def drive(*overrides: str, seconds: float = 10.0) -> Episode:
    """The robot of the config `building` in the corridor, for a time; it believes its wheels."""
    return run_episode(load_config("building", [*CORRIDOR, f"run.stop_after={seconds}", *overrides]))


def test_a_displacement_is_no_way_and_no_contact() -> None:
    plain = drive(seconds=5.0).summary()
    moved = drive("event=[{at=4.0,do='displace',by={x=1.5}}]", seconds=5.0)
    assert moved.summary()["path_length_m"] == pytest.approx(plain["path_length_m"], abs=0.06)
    assert moved.trail.y[-1] > plain["path_length_m"] + 1.4
    assert moved.trail.path_length_to_goal == pytest.approx(moved.trail.path_length)
    assert moved.summary()["collisions"] == 0


def test_a_robot_that_is_carried_through_a_wall_collides_with_nothing() -> None:
    episode = drive("event=[{at=4.0,do='displace',over=1.0,x=3.0,y=3.0,heading_deg=90}]", seconds=5.0)
    assert (episode.trail.x[-1], episode.summary()["collisions"]) == (pytest.approx(3.0), 0)
    assert episode.summary()["min_clearance_m"] == pytest.approx(0.75, abs=0.01)


def test_a_place_in_a_wall_ends_the_run_and_says_so() -> None:
    result = drive("event=[{at=4.0,do='displace',x=1.1,y=3.0,heading_deg=0}]").result
    assert result.outcome == "error"
    assert "displace at 4 s: at (1.10, 3.00), 0°, the robot touches right wall" in result.reason


def test_a_run_does_not_end_before_its_last_disturbance() -> None:
    episode = drive("navigation.goal={x=0,y=0.5}", "event=[{at=8.0,do='displace',over=1.0,by={x=0.5}}]", seconds=20.0)
    assert episode.trail.time[-1] >= 9.0
    assert episode.trail.carried.sum() == 21


def test_the_same_run_gives_the_same_trace() -> None:
    assert drive(AT_THE_END).log.trace_sha256 == drive(AT_THE_END).log.trace_sha256


def test_only_the_platform_is_told() -> None:
    system = assemble(load_config("building", [*CORRIDOR, AT_THE_END]), Discovery())
    make_plugins(system)
    told = {role for (role, _), part in system.parts.items() if part.plugin.context.disturbances}
    assert told == {"platform"}


def test_a_replay_is_the_same_bit_for_bit(tmp_path: Path) -> None:
    loaded = load_config("building", [*CORRIDOR, "run.stop_after=6", AT_THE_END])
    path = tmp_path / "run.mcap"
    with LockstepRecorder(RecordingWriter(path, header_of(loaded, "lockstep", {})), print) as recorder:
        run_episode(loaded, observers=[recorder])
    recording = Recording(path)
    found = list(check(Replayer(recording, assemble(recording.header.loaded(), Discovery()))))
    assert found and all(one.first is None and not one.unrecorded for one in found)


REFUSED = [
    ("{at=1,do='displace'}", "also needs x and y and heading_deg"),
    ("{at=1,do='displace',x=1,y=1}", "also needs heading_deg"),
    ("{at=1,do='displace',x=1,by={x=1}}", "has no use for x"),
    ("{at=1,do='displace',x=1,y=1,heading_deg=0,over=-1}", "expected at least 0"),
    ("{at=1,do='displace',by={z=1}}", "unknown key"),
    ("{at=1,do='slip'}", "also needs over or by"),
    ("{at=1,do='slip',over=1,x=2}", "has no use for x"),
    ("{at=1,do='stop',over=1}", "has no use for over"),
]


@pytest.mark.parametrize(("event", "message"), REFUSED)
def test_an_event_that_lacks_something_is_refused(event: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_config("building", [f"event=[{event}]"])


@pytest.mark.parametrize("event", ["{at=1,do='slip',over=1}", "{at=1,do='displace',by={x=1}}"])
def test_a_real_robot_refuses_to_be_disturbed(event: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SensorsSim, "is_simulated", False)
    monkeypatch.setattr(SensorsSim, "takes_disturbances", False)
    with pytest.raises(ConfigError, match=r"event.0.do: the platform sensors_sim, a real robot, cannot"):
        assemble(load_config("building", [f"event=[{event}]"]), Discovery())
