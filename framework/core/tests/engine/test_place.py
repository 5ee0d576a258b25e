"""An operator tells the robot where it is: the event `place` in lockstep."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from navloom.config import ConfigError
from navloom.engine.trace import TraceEntry, read_trace
from navloom.messages import Drive, PlanRequest, PoseEstimate
from navloom.roles.base import InputError
from navloom.runs.episode import run_episode
from toys import discovery, toy_config

PLACE = """
[[event]]
do = "place"
at = 2.0
x = 0.5
y = -0.75
heading_deg = 30.0
"""
TICK = 40
"""2.0 s at 0.05 s."""


def traced(tmp_path: Path, *overrides: str, more: str = PLACE) -> list[TraceEntry]:
    file = tmp_path / "trace.bin"
    with file.open("wb") as out:
        run_episode(toy_config(tmp_path, *overrides, more=more), discovery=discovery(), trace=out)
    return list(read_trace(file))


def test_the_pose_is_the_one_given_from_that_tick_on(tmp_path: Path) -> None:
    poses = {
        entry.envelope.tick: entry.message for entry in traced(tmp_path) if isinstance(entry.message, PoseEstimate)
    }
    before, at = poses[TICK - 1].pose, poses[TICK].pose
    assert before.y == pytest.approx(0.0, abs=0.05)
    assert (at.x, at.y) == (pytest.approx(0.5, abs=0.05), pytest.approx(-0.75, abs=0.05))
    assert at.heading == pytest.approx(0.5236, abs=0.01)


def test_the_drive_stops_and_the_goal_is_planned_again_from_there(tmp_path: Path) -> None:
    entries = [entry for entry in traced(tmp_path) if entry.envelope.tick == TICK]
    (drive,) = [entry.message for entry in entries if isinstance(entry.message, Drive)]
    assert drive.path_id == 0
    (plan,) = [entry.message for entry in entries if isinstance(entry.message, PlanRequest)]
    assert (plan.start.x, plan.start.y) == (pytest.approx(0.5, abs=0.05), pytest.approx(-0.75, abs=0.05))


def test_with_a_late_localizer_the_plan_waits_for_a_pose_from_then_on(tmp_path: Path) -> None:
    entries = traced(tmp_path, "localizer.latency=0.15", "gate.stop_deadline=0.5")
    plans = [(entry.envelope.tick, entry.message) for entry in entries if isinstance(entry.message, PlanRequest)]
    tick, plan = plans[1]
    assert tick == TICK + 3 and plan.start.y == pytest.approx(-0.75, abs=0.05)


def test_a_localizer_that_accepts_no_pose_refuses_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from navloom.navigation.dead_reckoning import OdometryLocalizer
    from navloom.roles import Localizer

    def refuse(self: Localizer, pose: object) -> None:
        raise InputError("localizer odometry does not accept a pose")

    run = toy_config(tmp_path, more=PLACE)
    original = OdometryLocalizer.__init__

    def made(self: OdometryLocalizer, params: object, context: object) -> None:
        original(self, params, context)  # type: ignore[arg-type]
        monkeypatch.setattr(OdometryLocalizer, "place", refuse)

    monkeypatch.setattr(OdometryLocalizer, "__init__", made)
    with pytest.raises(InputError, match="localizer odometry does not accept a pose"):
        run_episode(run, discovery=discovery())


@pytest.mark.parametrize("lacking", ["x", "y", "heading_deg"])
def test_it_needs_a_whole_pose(lacking: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=f'do = "place" also needs {lacking}'):
        toy_config(tmp_path, more=re.sub(rf"(?m)^{lacking} = .*\n", "", PLACE))
