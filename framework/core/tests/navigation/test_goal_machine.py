"""The state machine of goals, with its inputs tick by tick."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from navloom.messages import (
    AvoiderDiagnostics,
    AvoiderStatus,
    Feedback,
    GateStatus,
    Goal,
    GoalResult,
    GoalState,
    HandOver,
    MapUpdate,
    Message,
    OccupancyGrid,
    Path,
    PlanFailure,
    PlanRequest,
    Point2D,
    Pose2D,
    PoseEstimate,
    RecoveryStep,
    Reference,
    StopReason,
    Trajectory,
    Twist2D,
)
from navloom.navigation.braking import Braking
from navloom.navigation.goal_machine import GoalMachine
from navloom.navigation.goal_rules import GoalRules, GoalView
from navloom.navigation.replanning import ReplanRules
from navloom.testing import robot

RULES = GoalRules(
    tolerance=0.2, heading_tolerance=0.1, stuck_after=5.0, max_recoveries=1, map_timeout=10.0, plan_timeout=2.0,
    localizer_timeout=5.0,
    deadline=60.0, scans_on_request=True, feedback_ticks=10, braking=Braking(robot(), 0.05), fastest=0.4, cruise=0.4,
)  # fmt: skip
STILL = Twist2D(0.0, 0.0, 0.0)
GOAL = Goal(1, 4.0, 0.0, None, ())


def pose(x: float = 0.0, heading: float = 0.0) -> PoseEstimate:
    return PoseEstimate(0, Pose2D(x, 0.0, heading), STILL, np.zeros((3, 3)))


def seen(time: float, **more: object) -> GoalView:
    base = GoalView(round(time * 20), time, round(time * 1e9), estimate=pose(), selected=("ipabd", "astar"))
    view = replace(base, **more)  # type: ignore[arg-type]
    return view if view.estimate is None else replace(view, estimate=replace(view.estimate, stamp_ns=view.time_ns))


def a_map(stamp: float) -> MapUpdate:
    grid = OccupancyGrid(np.zeros((2, 2), dtype=np.int8), 1.0, Pose2D(0.0, 0.0, 0.0))
    return MapUpdate(round(stamp * 1e9), grid, np.empty((0, 4)), ())


def path(request_id: int) -> Path:
    return Path(request_id, np.array([(0.0, 0.0), (4.0, 0.0)]), 4.0, None)


def reference(path_id: int, remaining: float) -> Reference:
    return Reference(path_id, 4.0 - remaining, remaining, Pose2D(0.0, 0.0, 0.0), 0.4, 0.0, 0.0, Point2D(1.0, 0.0),
                     np.zeros((1, 2)), 0.5)  # fmt: skip


def status(word: str) -> AvoiderStatus:
    none = AvoiderDiagnostics(
        np.empty((0, 0), dtype=np.uint8), 0.0, 0.0, 0.0, np.empty(0), 0.0, np.empty((0, 2)), None, ""
    )
    return AvoiderStatus(word, none)  # type: ignore[arg-type]


def ports(out: list[tuple[str, Message]]) -> list[str]:
    return [port for port, _ in out if port != "feedback"]


def result(out: list[tuple[str, Message]]) -> tuple[str, str]:
    (found,) = [message for _, message in out if isinstance(message, GoalResult)]
    return found.outcome, found.reason


def code(out: list[tuple[str, Message]]) -> str:
    (found,) = [message for _, message in out if isinstance(message, GoalResult)]
    return found.code


def why(out: list[tuple[str, Message]]) -> tuple[str, str]:
    """State and code of the feedback."""
    (found,) = [message for _, message in out if isinstance(message, Feedback)]
    return found.state, found.code


def driving(rules: GoalRules = RULES, goal: Goal = GOAL) -> GoalMachine:
    """A state machine that follows path 2, at 2 s."""
    machine = GoalMachine(rules)
    machine.submit(goal, seen(0.0))
    machine.step(seen(0.0))
    machine.step(seen(1.5, map=a_map(1.4)))
    machine.step(seen(2.0, map=a_map(1.4), answer=path(2)))
    assert machine.state == "driving"
    return machine


def test_it_scans_waits_for_a_newer_map_plans_and_drives() -> None:
    machine = GoalMachine(RULES)
    machine.submit(GOAL, seen(0.5, map=a_map(0.1)))
    assert ports(machine.step(seen(0.5, map=a_map(0.1)))) == ["sweep"]
    assert ports(machine.step(seen(1.0, map=a_map(0.1)))) == []
    assert ports(machine.step(seen(2.0, map=a_map(1.8)))) == ["plan"]
    assert ports(machine.step(seen(2.1))) == []
    out = machine.step(seen(2.2, answer=path(2)))
    assert ports(out) == ["drive"] and out[0][1].path_id == 2  # type: ignore[attr-defined]


def test_without_sweeps_on_request_any_map_will_do() -> None:
    machine = GoalMachine(replace(RULES, scans_on_request=False))
    machine.submit(GOAL, seen(0.5, map=a_map(0.1)))
    assert ports(machine.step(seen(0.5, map=a_map(0.1)))) == ["plan"]


DRIVES = GateStatus("controller", "a", False, False, None, ())
BRAKES = GateStatus("none", "", False, False, StopReason("no_trajectory"), ())
STANDS = GateStatus("none", "", True, False, StopReason("no_trajectory"), ())


def rolling(x: float, speed: float, heading: float = 0.0) -> PoseEstimate:
    return replace(pose(x, heading), twist=Twist2D(speed, 0.0, 0.0))


def test_within_the_tolerance_it_stops_and_decides_at_rest() -> None:
    machine = driving()
    assert ports(machine.step(seen(3.0, estimate=rolling(3.79, 0.4), gate=DRIVES))) == []
    assert ports(machine.step(seen(3.05, estimate=rolling(3.81, 0.4), gate=DRIVES))) == ["drive"]
    assert ports(machine.step(seen(3.1, estimate=rolling(3.83, 0.4), gate=BRAKES))) == []
    assert ports(machine.step(seen(3.5, estimate=rolling(3.9, 0.01), gate=STANDS))) == []  # it still rolls
    out = machine.step(seen(3.55, estimate=rolling(3.9, 0.0), gate=STANDS))
    assert result(out)[0] == "succeeded" and machine.is_idle


def stopped_at(machine: GoalMachine, time: float, x: float, heading: float = 0.0) -> list[tuple[str, Message]]:
    """The step at rest, after one within the tolerance."""
    machine.step(seen(time, estimate=rolling(3.9, 0.4, heading), gate=DRIVES))
    return machine.step(seen(time + 0.5, estimate=pose(x, heading), gate=STANDS))


def test_a_robot_that_rolled_past_the_goal_drives_on() -> None:
    machine = driving()
    assert ports(stopped_at(machine, 3.0, 4.21)) == ["plan"]  # 0.21 m past it, the tolerance is 0.2 m
    machine.step(seen(3.6, estimate=pose(4.21), answer=path(3), gate=STANDS))
    assert result(stopped_at(machine, 4.0, 4.19))[0] == "succeeded"


def test_a_goal_that_is_missed_four_times_ends_stuck_with_the_distance() -> None:
    machine = driving()
    for number in range(3, 6):
        assert ports(stopped_at(machine, float(number), 4.25)) == ["plan"]
        machine.step(seen(number + 0.6, estimate=pose(4.25), answer=path(number), gate=STANDS))
    assert result(stopped_at(machine, 6.0, 4.25)) == (
        "stuck", "missed the goal 4 times, the last time by 0.250 m",
    )  # fmt: skip


def test_a_platform_that_never_comes_to_rest_does_not_hold_the_goal() -> None:
    """The ramp from 0.5 m/s at 1 m/s² takes 0.5 s, a tick 0.05 s; after 1 s more the goal is decided as it is."""
    machine = driving()
    machine.step(seen(3.0, estimate=rolling(3.9, 0.4), gate=DRIVES))
    assert ports(machine.step(seen(4.5, estimate=rolling(3.9, 0.1), gate=STANDS))) == []
    assert result(machine.step(seen(4.6, estimate=rolling(3.9, 0.1), gate=STANDS)))[0] == "succeeded"


def test_a_goal_reached_at_its_deadline_is_decided_at_rest() -> None:
    machine = driving(replace(RULES, deadline=3.2))
    assert result(stopped_at(machine, 3.1, 3.9))[0] == "succeeded"


def test_a_heading_is_turned_to_at_the_end_and_looked_at_at_rest() -> None:
    """The tolerance is 0.1 rad: the turn ends at 0.95 rad, and overshoots to 1.11 rad, so the robot turns back."""
    machine = driving(goal=replace(GOAL, heading=1.0))
    (drive,) = [m for p, m in machine.step(seen(3.0, estimate=pose(3.9), gate=DRIVES)) if p == "drive"]
    assert drive.turn_to == 1.0 and drive.stop_here  # type: ignore[attr-defined]
    assert ports(machine.step(seen(3.1, estimate=pose(3.9, heading=0.8), gate=DRIVES))) == []
    (ended,) = [m for p, m in machine.step(seen(3.2, estimate=pose(3.9, heading=0.95), gate=DRIVES)) if p == "drive"]
    assert ended.path_id == 0  # type: ignore[attr-defined]
    (back,) = [m for p, m in machine.step(seen(3.7, estimate=pose(3.9, heading=1.11), gate=STANDS)) if p == "drive"]
    assert back == drive
    machine.step(seen(3.8, estimate=pose(3.9, heading=1.05), gate=DRIVES))
    assert result(machine.step(seen(4.3, estimate=pose(3.9, heading=1.02), gate=STANDS)))[0] == "succeeded"


@pytest.mark.parametrize(
    ("kind", "outcome"),
    [
        ("goal_occupied", "rejected"),
        ("start_occupied", "rejected"),
        ("outside_map", "rejected"),
        ("no_path", "no_path"),
    ],
)
def test_a_planners_failure_is_a_typed_result_with_the_place(kind: str, outcome: str) -> None:
    machine = driving()
    machine.submit(Goal(2, 9.0, 0.0, None, ()), seen(3.0, map=a_map(1.4)))
    machine.step(seen(3.0, map=a_map(1.4)))
    failure = PlanFailure(3, kind, Point2D(9.0, 0.0), "why")  # type: ignore[arg-type]
    out = machine.step(seen(3.1, answer=failure))
    assert result(out) == (outcome, "why" if kind == outcome else f"{kind}: why")
    assert [m.place for p, m in out if p == "result"] == [Point2D(9.0, 0.0)]  # type: ignore[attr-defined]


def test_pre_emption_keeps_the_old_trajectory_until_the_new_plan() -> None:
    machine = driving()
    machine.submit(Goal(2, 9.0, 0.0, None, ()), seen(3.0, map=a_map(1.4)))
    out = machine.step(seen(3.0, map=a_map(1.4), answer=path(2)))
    assert result(out) == ("cancelled", "pre-empted by goal 2")
    drives = [m.path_id for p, m in out if p == "drive"]  # type: ignore[attr-defined]
    assert drives[-1] == 2 and machine.state == "planning"
    (drive,) = [m for p, m in machine.step(seen(3.1, answer=path(3))) if p == "drive"]
    assert drive.path_id == 3 and drive.goal_id == 2  # type: ignore[attr-defined]


def test_pre_emption_without_a_new_plan_stops() -> None:
    machine = driving()
    machine.submit(Goal(2, 9.0, 0.0, None, ()), seen(3.0, map=a_map(1.4)))
    machine.step(seen(3.0, map=a_map(1.4), answer=path(2)))
    out = machine.step(seen(5.1, answer=path(2)))
    assert result(out)[0] == "no_path" and [m.path_id for p, m in out if p == "drive"] == [0]  # type: ignore[attr-defined]


def test_cancel_ends_it() -> None:
    machine = driving()
    machine.cancel(seen(3.0))
    assert result(machine.step(seen(3.0))) == ("cancelled", "by the operator")


def test_without_progress_it_recovers_and_then_ends_stuck() -> None:
    machine = driving()
    held = reference(2, 3.0)
    machine.step(seen(3.0, reference=held))
    out = machine.step(seen(8.1, reference=held))
    assert ports(out) == ["drive", "recovery"] and machine.state == "recovering"
    done = RecoveryStep(STILL, "done", True)
    assert ports(machine.step(seen(9.0, recovery=done, map=a_map(1.4)))) == ["recovery", "clear", "sweep"]
    machine.step(seen(10.5, map=a_map(10.4)))
    machine.step(seen(10.6, map=a_map(10.4), answer=path(5)))
    assert machine.state == "driving"
    held = reference(5, 3.0)
    machine.step(seen(11.0, reference=held))
    assert result(machine.step(seen(16.1, reference=held))) == ("stuck", "no_progress")


def test_a_path_that_is_not_followed_counts_as_lost_and_is_requested_again() -> None:
    machine = driving()
    assert ports(machine.step(seen(3.0, reference=reference(2, 3.0)))) == []
    assert ports(machine.step(seen(4.9, reference=reference(1, 3.0)))) == []
    assert ports(machine.step(seen(5.1, reference=reference(1, 3.0)))) == ["plan"]
    assert ports(machine.step(seen(5.2, answer=path(3), reference=reference(1, 3.0)))) == ["drive"]
    assert ports(machine.step(seen(7.0, reference=reference(1, 3.0)))) == []
    assert ports(machine.step(seen(7.3, reference=None))) == ["plan"]


def test_an_operators_stop_is_not_lack_of_progress() -> None:
    machine = driving()
    held, latched = reference(2, 3.0), GateStatus("none", "", True, True, StopReason("operator"), ())
    for time in (3.0, 9.0, 15.0):
        assert ports(machine.step(seen(time, reference=held, gate=latched))) == []
    assert machine.state == "driving"


def test_trapped_counts_only_while_the_avoider_drives() -> None:
    machine = driving()
    idle = seen(3.0, avoider=status("trapped"), handover=HandOver(False, 9.0))
    assert ports(machine.step(idle)) == []
    assert "recovery" in ports(machine.step(replace(idle, handover=HandOver(True, 1.0))))


def test_exhausted_recovery_ends_stuck_for_being_trapped() -> None:
    machine = driving(replace(RULES, max_recoveries=0))
    out = machine.step(seen(3.0, avoider=status("trapped"), handover=HandOver(True, 1.0)))
    assert result(out) == ("stuck", "trapped")


BLOCKED = GateStatus("controller", "law", True, False, StopReason("obstacle"), ())
CRAMPED = replace(BLOCKED, why=StopReason("no_room"))


@pytest.mark.parametrize(
    ("views", "expected"),
    [
        ([seen(3.0, gate=GateStatus("none", "", True, True, StopReason("contact"), ()))], "contact"),
        ([seen(60.0)], "overdue"),
        ([seen(60.0, gate=GateStatus("none", "", True, True, StopReason("operator"), ()))], "not_resumed"),
        ([seen(3.0, reference=reference(2, 3.0)), seen(8.1, reference=reference(2, 3.0))], "no_progress"),
        ([seen(3.0, avoider=status("trapped"), handover=HandOver(True, 1.0))], "trapped"),
        ([seen(3.0, gate=BLOCKED), seen(5.1, gate=BLOCKED)], "blocked"),
        ([seen(3.0, gate=CRAMPED), seen(5.1, gate=CRAMPED)], "no_room"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_result_has_the_code_of_its_reason(views: list[GoalView], expected: str) -> None:
    machine = driving(replace(RULES, max_recoveries=0))
    assert code([pair for view in views for pair in machine.step(view)]) == expected


@pytest.mark.parametrize("kind", ["start_occupied", "goal_occupied", "outside_map", "no_path"])
def test_a_planners_failure_is_a_code(kind: str) -> None:
    machine = driving()
    machine.submit(Goal(2, 9.0, 0.0, None, ()), seen(3.0, map=a_map(1.4)))
    machine.step(seen(3.0, map=a_map(1.4)))
    failure = PlanFailure(3, kind, Point2D(9.0, 0.0), "why")  # type: ignore[arg-type]
    assert code(machine.step(seen(3.1, answer=failure))) == kind


def test_requests_and_restarts_have_codes() -> None:
    machine = driving()
    machine.submit(replace(GOAL, goal_id=2), seen(3.0, map=a_map(1.4)))
    assert code(machine.step(seen(3.0, map=a_map(1.4)))) == "preempted"
    machine.cancel(seen(3.1))
    assert code(machine.step(seen(3.1))) == "by_operator"
    machine.begin(100, unfinished=2)
    assert code(machine.step(seen(5.0))) == "node_restarted"


def test_the_feedback_says_why_the_goal_does_not_go_on() -> None:
    machine = driving()
    assert why(machine.step(seen(3.0, avoider=status("trapped"), handover=HandOver(True, 1.0)))) == (
        "recovering", "trapped",
    )  # fmt: skip
    machine.hold(seen(3.1))
    assert why(machine.step(seen(3.1))) == ("waiting", "platform_silent")
    machine.go_on(seen(3.2))
    assert why(machine.step(seen(3.2))) == ("mapping", "")


def test_an_operator_who_places_the_robot_is_why_it_searches() -> None:
    machine = driving()
    machine.place(seen(3.0))
    assert why(machine.step(replace(seen(3.0), estimate=replace(pose(), stamp_ns=0)))) == ("searching", "placed")


def test_every_state_of_an_active_goal_has_its_step() -> None:
    assert set(GoalMachine.steps) == set(get_args(GoalState)) - {"idle"}


def test_contact_is_a_collision() -> None:
    out = driving().step(seen(3.0, gate=GateStatus("none", "", True, True, StopReason("contact"), ())))
    assert result(out)[0] == "collision"


def test_the_deadline_is_a_timeout_or_a_stop_that_was_not_resumed() -> None:
    assert result(driving().step(seen(60.0)))[0] == "timeout"
    latched = GateStatus("none", "", True, True, StopReason("operator"), ())
    assert result(driving().step(seen(60.0, gate=latched)))[0] == "stopped"


def test_no_map_in_time_is_an_error() -> None:
    machine = GoalMachine(RULES)
    machine.submit(GOAL, seen(0.0))
    machine.step(seen(0.0))
    assert result(machine.step(seen(10.1))) == ("error", "no map within 10 s")


def asked(out: list[tuple[str, Message]], port: str) -> list[int]:
    return [message.request_id for found, message in out if found == port]  # type: ignore[attr-defined]


def test_a_goal_after_one_without_a_map_requests_a_sweep_again() -> None:
    machine = GoalMachine(RULES)
    machine.submit(GOAL, seen(0.0))
    first = asked(machine.step(seen(0.0)), "sweep")
    machine.step(seen(10.1))
    machine.submit(replace(GOAL, goal_id=2), seen(11.0))
    assert asked(machine.step(seen(11.0)), "sweep") == first
    assert "plan" in ports(machine.step(seen(12.0, map=a_map(12.0))))


@pytest.mark.parametrize("is_live", [True, False])
def test_live_a_sweep_or_plan_that_may_be_lost_is_requested_again_with_its_number(is_live: bool) -> None:
    machine = GoalMachine(replace(RULES, is_live=is_live))
    machine.submit(GOAL, seen(0.0))
    times = 1 + 2 * is_live
    assert [n for tick in range(199) for n in asked(machine.step(seen(tick / 20)), "sweep")] == [1] * times
    assert asked(machine.step(seen(10.0, map=a_map(10.0))), "plan") == [2]
    repeated = [n for tick in range(201, 239) for n in asked(machine.step(seen(tick / 20)), "plan")]
    assert repeated == [2] * (times - 1)
    machine.step(seen(12.0, answer=path(2)))
    assert machine.state == "driving"


def test_live_a_plan_requested_while_driving_that_gets_no_answer_is_requested_again() -> None:
    machine = driving(replace(RULES, is_live=True, replan=ReplanRules(period=1.0)))
    follow = [seen(tick / 20, reference=reference(2, 3.0)) for tick in range(60, 160)]
    plans = [asked(machine.step(now), "plan") for now in follow]
    numbers = [number for plan in plans for number in plan]
    assert len(numbers) > 3 and set(numbers) == {3}


def test_a_platform_that_fell_silent_in_a_sweep_gets_the_request_again() -> None:
    machine = GoalMachine(RULES)
    machine.submit(GOAL, seen(0.0))
    first = asked(machine.step(seen(0.0)), "sweep")
    machine.hold(seen(1.0))
    machine.step(seen(1.0))
    machine.go_on(seen(3.0))
    assert asked(machine.step(seen(3.0)), "sweep") == first
    assert machine.state == "mapping"


def test_points_on_the_way_are_passed_in_order() -> None:
    machine = driving(goal=replace(GOAL, via=(Point2D(1.0, 0.0),)))
    (plan,) = [m for p, m in machine.step(seen(3.0, estimate=pose(0.9))) if p == "plan"]
    assert plan.goal == Pose2D(4.0, 0.0, 0.0)  # type: ignore[attr-defined]


def test_a_swapped_in_mapper_or_planner_means_a_new_plan() -> None:
    machine = driving()
    assert "plan" in ports(machine.step(seen(3.0, selected=("other", "astar"))))


def test_a_waiting_mapper_gets_a_sweep() -> None:
    machine = driving()
    waiting = GateStatus("controller", "a", False, False, None, ("mapper other",))
    out = machine.step(seen(3.0, gate=waiting, estimate=rolling(1.0, 0.4)))
    assert ports(out) == ["drive"] and machine.state == "mapping"
    assert ports(machine.step(seen(3.2, gate=waiting, estimate=rolling(1.1, 0.2)))) == []  # it still brakes
    stands = replace(waiting, source="none", stopped=True, why=StopReason("no_trajectory"))
    assert ports(machine.step(seen(3.6, gate=stands, estimate=pose(1.2)))) == ["sweep"]


@pytest.mark.parametrize("state", ["idle", "recovering", "waiting"])
def test_a_restarted_mapper_gets_a_sweep_before_the_next_plan(state: str) -> None:
    machine = driving()
    trapped = {"avoider": status("trapped"), "handover": HandOver(True, 1.0)}
    if state == "idle":
        machine.cancel(seen(3.0))
    elif state == "waiting":
        machine.hold(seen(3.0))
    else:
        machine.step(seen(3.0, **trapped))
    assert machine.state == state
    machine.restart_of("mapper", seen(3.5))
    assert machine.state == state
    now = seen(4.0, map=a_map(1.4), recovery=RecoveryStep(STILL, "done", False))
    if state == "idle":
        machine.submit(replace(GOAL, goal_id=2), now)
    elif state == "waiting":
        machine.go_on(now)
    assert "sweep" in ports(machine.step(now)) and machine.state == "mapping"


def test_feedback_comes_with_each_change_and_at_its_rate() -> None:
    machine = driving()
    quiet = [port for tick in range(41, 50) for port, _ in machine.step(seen(tick / 20))]
    assert quiet == []
    (feedback,) = [m for p, m in machine.step(seen(2.5, reference=reference(2, 2.0))) if p == "feedback"]
    assert (feedback.distance, feedback.time_left) == (2.0, 5.0)  # type: ignore[attr-defined]


def walled_map(stamp: float, x: float) -> MapUpdate:
    """5 x 2 m in cells of 0.5 m, with one occupied cell on the x axis."""
    cells = np.zeros((4, 10), dtype=np.int8)
    cells[2, int(x / 0.5)] = 100
    return MapUpdate(round(stamp * 1e9), OccupancyGrid(cells, 0.5, Pose2D(0.0, -1.0, 0.0)), np.empty((0, 4)), ())


def straight(path_id: int) -> Trajectory:
    samples = np.zeros((41, 6))
    samples[:, 0] = samples[:, 1] = np.linspace(0.0, 4.0, 41)
    samples[:, 5] = 0.4
    return Trajectory(path_id, samples)


def drives(machine: GoalMachine, time: float, path_id: int = 2, remaining: float = 3.0, **more: object) -> list[str]:
    """Run one tick on a straight trajectory; gives the published ports."""
    given = {"map": a_map(1.4), "trajectory": straight(path_id), "reference": reference(path_id, remaining), **more}
    return ports(machine.step(seen(time, **given)))


FREELY = replace(RULES, replan=ReplanRules(radius=0.3), max_recoveries=2)


def test_a_map_that_blocks_the_trajectory_ahead_triggers_a_plan_while_it_drives_on() -> None:
    machine = driving(FREELY)
    behind, ahead = walled_map(2.1, 0.5), walled_map(2.2, 3.0)
    assert drives(machine, 2.1, map=behind) == []
    assert drives(machine, 2.2, map=ahead) == ["plan"] and machine.state == "driving"
    assert drives(machine, 2.3, map=ahead) == []
    machine.step(seen(2.4, map=ahead, trajectory=straight(2), reference=reference(2, 2.5), answer=path(3)))
    assert drives(machine, 2.5, 3, 4.0, map=a_map(2.4), answer=path(3)) == []  # it follows path 3, which is free


def test_a_path_through_what_is_seen_is_taken_at_first_but_replaces_no_trajectory() -> None:
    """Else a robot before a closed door would get another such path with each map, and never be stuck."""
    machine, ahead = driving(FREELY), walled_map(2.2, 3.0)
    assert drives(machine, 2.2, map=ahead) == ["plan"]
    assert drives(machine, 2.3, map=ahead, answer=path(3), is_through_seen=True) == []
    assert machine.state == "driving"
    assert drives(machine, 2.4, map=walled_map(2.4, 3.0)) == ["plan"]
    assert drives(machine, 2.5, map=walled_map(2.4, 3.0), answer=path(4)) == ["drive"]


def test_obstacles_beside_the_disc_or_with_replanning_off_trigger_no_plan() -> None:
    machine = driving(replace(FREELY, replan=ReplanRules(radius=0.2)))
    assert drives(machine, 2.1, map=walled_map(2.1, 3.0)) == []  # its centre is 0.25 m beside
    machine = driving(replace(FREELY, replan=ReplanRules(when_blocked=False, radius=0.3)))
    assert drives(machine, 2.1, map=walled_map(2.1, 3.0)) == []


def test_without_a_way_round_it_recovers_and_ends_with_the_planners_reason() -> None:
    machine, wall = driving(FREELY), walled_map(2.1, 3.0)
    none = PlanFailure(3, "no_path", Point2D(2.0, 0.0), "closed")
    assert drives(machine, 2.1, map=wall) == ["plan"]
    assert drives(machine, 2.2, map=wall, answer=none) == ["drive", "recovery"]
    done = RecoveryStep(STILL, "done", True)
    assert ports(machine.step(seen(2.3, map=wall, recovery=done))) == ["recovery", "clear", "sweep"]
    assert ports(machine.step(seen(2.5, map=walled_map(2.4, 3.0)))) == ["plan"]
    again = PlanFailure(6, "no_path", Point2D(2.0, 0.0), "closed")
    assert ports(machine.step(seen(2.6, answer=again))) == ["recovery"]
    machine.step(seen(2.7, map=wall, recovery=done))
    machine.step(seen(2.9, map=walled_map(2.8, 3.0)))
    out = machine.step(seen(3.0, answer=PlanFailure(9, "no_path", Point2D(2.0, 0.0), "closed")))
    assert result(out) == ("no_path", "closed")


def test_at_a_rate_a_shorter_path_is_taken_and_one_that_is_not_is_not() -> None:
    machine = driving(replace(RULES, replan=ReplanRules(period=1.0, gain=0.1)))
    assert drives(machine, 2.1) == ["plan"]
    longer = replace(path(3), length=2.8)
    assert drives(machine, 2.2, answer=longer) == []
    assert drives(machine, 3.0) == [] and drives(machine, 3.1) == ["plan"]
    assert drives(machine, 3.2, answer=replace(path(4), length=2.6)) == ["drive"]


def test_changing_paths_do_not_hide_a_lack_of_progress() -> None:
    machine = driving(replace(RULES, replan=ReplanRules(period=1.0)))
    time, newest, ended = 2.0, 2, []
    while not ended and time < 10.0:
        time = round(time + 0.1, 6)
        out = machine.step(seen(time, map=a_map(1.4), trajectory=straight(newest), reference=reference(newest, 3.0),
                                answer=replace(path(newest + 1), length=1.0)))  # fmt: skip
        newest = max([newest, *(message.path_id for port, message in out if port == "drive")])  # type: ignore[attr-defined]
        ended = [message for port, message in out if port == "recovery"]
    assert newest > 4 and time == pytest.approx(7.1, abs=0.3)


def test_after_a_clear_it_waits_for_the_next_map() -> None:
    machine = GoalMachine(replace(RULES, scans_on_request=False))
    machine.submit(GOAL, seen(0.0, map=a_map(0.0)))
    machine.step(seen(0.0, map=a_map(0.0)))
    machine.step(seen(0.1, map=a_map(0.0), answer=path(1)))
    out = machine.step(seen(6.0, map=a_map(0.0), reference=reference(1, 4.0)))
    out += machine.step(seen(12.0, map=a_map(0.0), reference=reference(1, 4.0)))
    assert "recovery" in ports(out)
    out = machine.step(seen(12.1, map=a_map(0.0), recovery=RecoveryStep(STILL, "done", True)))
    assert ports(out) == ["recovery", "clear"]
    assert ports(machine.step(seen(12.2, map=a_map(0.0)))) == []
    assert ports(machine.step(seen(12.3, map=a_map(12.25)))) == ["plan"]


def test_a_goal_that_was_being_driven_to_is_no_longer_rejected() -> None:
    machine, wall = driving(replace(FREELY, max_recoveries=0)), walled_map(2.1, 3.0)
    drives(machine, 2.1, map=wall)
    outside = PlanFailure(3, "outside_map", Point2D(0.0, 0.0), "the start is outside")
    given = {"map": wall, "trajectory": straight(2), "reference": reference(2, 3.0)}
    out = machine.step(seen(2.2, answer=outside, **given))
    assert result(out) == ("no_path", "outside_map: the start is outside")


def feedback(out: list[tuple[str, Message]]) -> Feedback:
    (found,) = [message for _, message in out if isinstance(message, Feedback)]
    return found


def test_the_first_estimate_of_a_goal_uses_its_own_path() -> None:
    machine = driving()
    machine.submit(Goal(2, 2.0, 0.0, None, ()), seen(3.0, map=a_map(1.4), reference=reference(2, 3.0)))
    planning = feedback(machine.step(seen(3.0, map=a_map(1.4), reference=reference(2, 3.0))))
    assert (planning.goal_id, planning.state, planning.distance) == (2, "planning", 0.0)
    first = feedback(machine.step(seen(3.05, answer=path(3), reference=reference(2, 2.9))))
    assert (first.state, first.distance, first.time_left) == ("driving", 0.0, 5.0)  # 2 m straight at 0.4 m/s
    assert feedback(machine.step(seen(3.5, reference=reference(3, 1.0)))).distance == 1.0


def test_a_new_path_keeps_the_estimate_of_the_old_one_until_it_is_followed() -> None:
    machine = driving(replace(RULES, replan=ReplanRules(period=1.0)))
    assert ports(machine.step(seen(3.1, reference=reference(2, 3.0)))) == ["plan"]
    shorter = replace(path(3), length=1.0)
    assert ports(machine.step(seen(3.2, answer=shorter, reference=reference(2, 2.9)))) == ["drive"]
    assert feedback(machine.step(seen(3.5, answer=shorter, reference=reference(2, 2.8)))).distance == 2.8


def beside_the_goal(machine: GoalMachine, time: float, path_id: int) -> list[str]:
    """State at the end of a path, 0.3 m from the goal."""
    return ports(machine.step(seen(time, estimate=pose(3.7), reference=reference(path_id, 0.0), answer=path(path_id))))


def test_at_the_end_of_its_path_beside_the_goal_it_plans_again_at_once() -> None:
    machine = driving()
    assert beside_the_goal(machine, 3.0, 2) == []
    assert beside_the_goal(machine, 3.9, 2) == []
    assert beside_the_goal(machine, 4.0, 2) == ["plan"]
    out = machine.step(seen(4.1, estimate=pose(3.7), answer=path(3)))
    assert ports(out) == ["drive"] and machine.state == "driving"
    machine.step(seen(5.0, estimate=pose(3.9), reference=reference(3, 0.1)))
    assert result(machine.step(seen(5.2, estimate=pose(3.9), reference=reference(3, 0.1))))[0] == "succeeded"


def test_a_robot_that_passes_the_end_of_its_path_or_is_stopped_there_has_not_missed_its_goal() -> None:
    machine = driving()
    assert beside_the_goal(machine, 3.0, 2) == []
    machine.step(seen(3.5, estimate=pose(3.7), reference=reference(2, 0.2)))
    assert beside_the_goal(machine, 4.2, 2) == []
    stopped = GateStatus("none", "", True, True, StopReason("operator"), ())
    at_end = seen(5.3, estimate=pose(3.7), reference=reference(2, 0.0), gate=stopped)
    assert ports(machine.step(at_end)) == []


def test_a_patient_goal_without_a_way_clears_the_map_and_plans_again_until_its_patience_is_over() -> None:
    """With 2.5 s of patience from the first answer at 0.05 s on, it plans again after 1 s and 2 s, and then ends."""
    machine = GoalMachine(replace(RULES, patience=2.5, scans_on_request=False))
    machine.submit(GOAL, seen(0.0, map=a_map(0.0)))
    plans, clears, out, time = list[int](), list[float](), machine.step(seen(0.0, map=a_map(0.0))), 0.0
    while "result" not in ports(out):
        plans += [message.request_id for _, message in out if isinstance(message, PlanRequest)]
        clears += [time] * ("clear" in ports(out))
        time += 0.05
        answer = PlanFailure(plans[-1], "no_path", Point2D(2.0, 0.0), "closed")
        out = machine.step(seen(time, map=a_map(time), answer=answer))
    assert clears == pytest.approx([1.05, 2.15], abs=0.11) and len(plans) == 3
    assert result(out) == ("no_path", "closed") and time < 2.5


def test_a_goal_that_no_path_reaches_ends_stuck() -> None:
    machine, time, asked = driving(), 3.0, 0
    while machine.state in ("driving", "planning") and time < 40.0:
        time += 0.5
        newest = 2 + asked
        answer = path(newest) if machine.state == "planning" or asked else path(2)
        out = machine.step(seen(time, estimate=pose(3.7), reference=reference(newest, 0.0), answer=answer))
        asked += ports(out).count("plan")
    assert asked == 3 and machine.state == "recovering"


def test_a_status_of_the_avoider_from_before_a_recovery_does_not_count_as_trapped() -> None:
    machine = driving(replace(RULES, max_recoveries=3))
    trapped, engaged = status("trapped"), HandOver(True, 0.5)
    old = {"avoider": trapped, "handover": engaged, "map": a_map(1.4)}
    assert ports(machine.step(seen(3.0, **old))) == ["drive", "recovery"]
    done = RecoveryStep(STILL, "done", False)
    assert ports(machine.step(seen(3.1, recovery=done, **old))) == ["recovery", "plan"]
    assert ports(machine.step(seen(3.2, answer=path(3), **old))) == ["drive"]
    assert ports(machine.step(seen(3.3, **old))) == []
    assert machine.state == "driving"
    assert ports(machine.step(seen(3.4, **{**old, "avoider": status("trapped")}))) == ["drive", "recovery"]
