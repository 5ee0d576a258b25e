"""The goal of a robot whose localizer is unsure: it stops and waits, and ends lost if that lasts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from navloom.messages import (
    Feedback,
    GateStatus,
    Goal,
    GoalResult,
    MapUpdate,
    Message,
    OccupancyGrid,
    Path,
    Pose2D,
    PoseEstimate,
    RecoveryRequest,
    RecoveryStep,
    StopReason,
    Twist2D,
)
from navloom.navigation.braking import Braking
from navloom.navigation.goal_machine import GoalMachine
from navloom.navigation.goal_rules import GoalRules, GoalView
from navloom.testing import robot

RULES = GoalRules(
    tolerance=0.2, heading_tolerance=0.1, stuck_after=5.0, max_recoveries=1, map_timeout=10.0, plan_timeout=2.0,
    localizer_timeout=5.0,
    deadline=60.0, scans_on_request=False, feedback_ticks=10, braking=Braking(robot(), 0.05), fastest=0.4, cruise=0.4,
)  # fmt: skip
MAP = MapUpdate(0, OccupancyGrid(np.zeros((2, 2), dtype=np.int8), 1.0, Pose2D(0.0, 0.0, 0.0)), np.empty((0, 4)), ())
REASON = "24% of the echoes fit the map, less than 40%"


def seen(time: float, state: str = "tracking", x: float = 0.0, **more: object) -> GoalView:
    estimate = PoseEstimate(
        0, Pose2D(x, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)), state,  # type: ignore[arg-type]
        "" if state == "tracking" else REASON,
    )  # fmt: skip
    base = GoalView(round(time * 20), time, round(time * 1e9), estimate=estimate, map=MAP, selected=("known", "astar"))
    return replace(base, **more)  # type: ignore[arg-type]


def driving(rules: GoalRules = RULES) -> GoalMachine:
    """A state machine that follows path 1 to (4, 0), at 1 s."""
    machine = GoalMachine(rules)
    machine.submit(Goal(1, 4.0, 0.0, None, ()), seen(0.5))
    machine.step(seen(0.5))
    machine.step(seen(1.0, answer=Path(1, np.array([(0.0, 0.0), (4.0, 0.0)]), 4.0, None)))
    assert machine.state == "driving"
    return machine


def ports(out: list[tuple[str, Message]]) -> list[str]:
    return [port for port, _ in out if port != "feedback"]


def results(out: list[tuple[str, Message]]) -> list[GoalResult]:
    return [message for _, message in out if isinstance(message, GoalResult)]


@pytest.mark.parametrize("state", ["searching", "lost"])
def test_the_drive_stops_as_soon_as_the_localizer_is_unsure(state: str) -> None:
    machine = driving()
    out = machine.step(seen(2.0, state))
    assert machine.state == "searching" and [m.path_id for p, m in out if p == "drive"] == [0]  # type: ignore[attr-defined]
    (feedback,) = [message for _, message in out if isinstance(message, Feedback)]
    assert (feedback.state, feedback.localizer) == ("searching", f"{state}: {REASON}")


def test_it_plans_again_from_its_place_once_the_localizer_is_sure() -> None:
    machine = driving()
    machine.step(seen(2.0, "searching"))
    assert ports(machine.step(seen(6.0, "lost"))) == []
    out = machine.step(seen(6.5, x=0.7))
    (request,) = [m for p, m in out if p == "plan"]
    assert request.start.x == 0.7 and machine.state == "planning"  # type: ignore[attr-defined]
    assert not any(m.localizer for _, m in out if isinstance(m, Feedback))


def test_it_ends_lost_with_the_reason_and_the_place_after_five_seconds() -> None:
    machine = driving()
    machine.step(seen(2.0, "searching", x=1.0))
    assert results(machine.step(seen(7.0, "lost", x=1.0))) == []
    (result,) = results(machine.step(seen(7.05, "lost", x=1.0)))
    assert (result.outcome, result.place.x) == ("lost", 1.0)
    assert result.reason == f"the localizer has not been tracking for 5 s: {REASON}"
    assert machine.is_idle


def test_how_long_it_waits_for_a_localizer_that_is_not_tracking_is_a_rule() -> None:
    machine = driving(replace(RULES, localizer_timeout=20.0))
    machine.step(seen(2.0, "searching", x=1.0))
    assert results(machine.step(seen(22.0, "lost", x=1.0))) == []
    (result,) = results(machine.step(seen(22.05, "lost", x=1.0)))
    assert result.reason == f"the localizer has not been tracking for 20 s: {REASON}"


def test_it_never_succeeds_while_the_localizer_is_unsure() -> None:
    machine = driving()
    out = [*machine.step(seen(3.0, "searching", x=4.0)), *machine.step(seen(4.0, "lost", x=4.0))]
    assert results(out) == []
    (result,) = results(machine.step(seen(9.0, "lost", x=4.0)))
    assert result.outcome == "lost"


def test_a_recovery_is_cancelled() -> None:
    machine = driving()
    held = GateStatus("controller", "law", True, False, StopReason("obstacle"), ())
    for time in (1.5, 2.0, 4.0):
        machine.step(seen(time, gate=held))
    assert machine.state == "recovering"
    out = machine.step(seen(4.5, "searching"))
    assert [m.active for p, m in out if p == "recovery"] == [False]  # type: ignore[attr-defined]


@pytest.mark.parametrize(("reason", "why"), [("obstacle", "blocked"), ("no room to turn", "blocked: no room to turn")])
def test_a_recovery_is_told_whether_the_robot_has_no_room_to_turn(reason: str, why: str) -> None:
    machine = driving()
    held = GateStatus("controller", "law", True, False, StopReason.parse(reason), ())
    out = [pair for time in (1.5, 2.0, 4.0) for pair in machine.step(seen(time, gate=held))]
    assert [m.reason for p, m in out if p == "recovery"] == [why]  # type: ignore[attr-defined]


def test_without_a_goal_the_state_is_published_when_it_changes() -> None:
    machine = GoalMachine(RULES)
    told = [
        message.localizer
        for tick, state in enumerate(("tracking", "searching", "searching", "lost", "tracking"))
        for _, message in machine.step(seen(tick * 0.05, state))
        if isinstance(message, Feedback)
    ]
    assert told == [f"searching: {REASON}", f"lost: {REASON}", ""]


LOOKS = {"looks_around": True}


def looks(out: list[tuple[str, Message]]) -> list[tuple[bool, int, str]]:
    return [(m.active, m.attempt, m.reason) for _, m in out if isinstance(m, RecoveryRequest)]


def test_where_the_robot_can_look_around_the_recovery_is_asked_until_the_localizer_is_sure() -> None:
    machine = driving()
    machine.step(seen(2.0, "searching"))
    assert looks(machine.step(seen(2.05, "searching", **LOOKS))) == [(True, 1, "searching")]
    running = RecoveryStep(Twist2D(0.0, 0.0, 0.5), "running", False)
    assert looks(machine.step(seen(2.1, "searching", recovery=running, **LOOKS))) == []
    assert machine.state == "searching"
    out = machine.step(seen(3.0, recovery=running, **LOOKS))
    assert looks(out) == [(False, 0, "")] and machine.state == "planning"


def test_it_looks_around_again_where_an_attempt_has_ended_or_fallen_silent() -> None:
    machine = driving(replace(RULES, localizer_timeout=50.0))
    machine.step(seen(2.0, "searching"))
    machine.step(seen(2.05, "searching", **LOOKS))
    failed = RecoveryStep(Twist2D(0.0, 0.0, 0.0), "failed", False)
    assert looks(machine.step(seen(4.0, "lost", recovery=failed, **LOOKS))) == [(True, 2, "searching")]
    assert looks(machine.step(seen(14.0, "lost", **LOOKS))) == []
    assert looks(machine.step(seen(14.05, "lost", **LOOKS))) == [(True, 3, "searching")]


def test_looking_around_ends_with_the_goal_and_is_none_of_its_recoveries() -> None:
    machine = driving(replace(RULES, max_recoveries=0))
    machine.step(seen(2.0, "searching"))
    machine.step(seen(2.05, "searching", **LOOKS))
    out = machine.step(seen(7.05, "lost", **LOOKS))
    assert looks(out) == [(False, 0, "")] and [result.outcome for result in results(out)] == ["lost"]


@pytest.mark.parametrize(
    ("looks_around", "tracks", "ends"), [(True, 2.0, True), (True, 11.0, False), (False, 2.0, False)]
)
def test_a_moment_of_tracking_gives_a_robot_that_looks_around_no_more_time(
    looks_around: bool, tracks: float, ends: bool
) -> None:
    machine = driving()
    more = {"looks_around": looks_around}
    machine.step(seen(2.0, "searching", **more))
    machine.step(seen(6.0, **more))
    machine.step(seen(6.0 + tracks, "searching", **more))
    # 4 s before and 1.05 s now are more than 5 s.
    out = machine.step(seen(7.05 + tracks, "searching", **more))
    assert bool(results(out)) == ends
