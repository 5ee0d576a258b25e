"""When a robot begins to stop at its goal, and when it and the run are at rest."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from navloom.messages import Drive, Goal, HandOver, Point2D, Pose2D, PoseEstimate, Reference, Twist2D
from navloom.navigation.active_goal import ActiveGoal, GoalEnd
from navloom.navigation.arrival import Arrival, Move
from navloom.navigation.braking import Braking, Ending, Standstill
from navloom.navigation.goal_rules import GoalRules, GoalView
from navloom.navigation.time_left import TimeLeft
from navloom.testing import robot

SOFT = Braking(robot(max_deceleration=0.5, motor_lag=0.1, dead_time=0.05, max_linear=1.0), 0.05)
"""From 1 m/s it needs 0.2 m + 1 m, from 0.4 m/s 0.08 m + 0.16 m to stop."""
RULES = GoalRules(
    tolerance=0.2, heading_tolerance=0.1, stuck_after=5.0, max_recoveries=1, map_timeout=10.0, plan_timeout=2.0,
    localizer_timeout=5.0,
    deadline=60.0, scans_on_request=False, feedback_ticks=10, braking=SOFT, fastest=0.4, cruise=0.4,
)  # fmt: skip
BEGAN = 0.0, 60.0, TimeLeft(RULES)
FOLLOWS = Drive(1, 2, None, False)
TURNS = Drive(1, 2, 0.0, True)


def at(x: float, y: float = 0.0, heading: float = 0.0, turn: float = 0.0) -> PoseEstimate:
    return PoseEstimate(0, Pose2D(x, y, heading), Twist2D(0.0, 0.0, turn), np.zeros((3, 3)))


def due(
    estimate: PoseEstimate, speed: float, remaining: float = 0.0, engaged: bool = True, via: tuple[Point2D, ...] = ()
) -> bool:
    """Whether the stop at the goal (4, 0) begins."""
    left = remaining or 4.0 - estimate.pose.x
    reference = Reference(2, 0.0, left, estimate.pose, 0.4, 0.0, 0.0, Point2D(4.0, 0.0), np.zeros((1, 2)), 0.5)
    seen = GoalView(1, 1.0, 10**9, estimate, handover=HandOver(engaged, math.inf), reference=reference, speed=speed)
    active = ActiveGoal(Goal(1, 4.0, 0.0, None, via), [*via, Point2D(4.0, 0.0)], *BEGAN)
    return Arrival(RULES).is_due(active, FOLLOWS, seen)


def test_an_avoider_that_comes_too_fast_is_stopped_where_the_robot_needs_to_brake() -> None:
    assert due(at(2.81), 1.0) and not due(at(2.79), 1.0)  # 1.2 m before the goal


@pytest.mark.parametrize("other", [
    {"engaged": False},  # the reference is slow enough
    {"remaining": 1.5},  # the trajectory takes another way
    {"via": (Point2D(4.0, 0.0),)},  # passed at speed
    {"speed": 0.4},  # 0.24 m is less than 1.5 tolerances
    {"estimate": at(3.0, 0.3)},  # it drives past the goal
])  # fmt: skip
def test_other_robots_are_stopped_within_the_tolerance(other: dict[str, object]) -> None:
    assert not due(**{"estimate": at(3.0), "speed": 1.0, **other})  # type: ignore[arg-type]
    assert due(at(3.81), 0.4, engaged=False)


def moves(estimate: PoseEstimate, speed: float, drive: Drive) -> Drive | None:
    seen = GoalView(1, 1.0, 10**9, estimate, speed=speed)
    active = ActiveGoal(Goal(1, 4.0, 0.0, 0.0, ()), [Point2D(4.0, 0.0)], *BEGAN)
    return Arrival(RULES).step(active, estimate.pose, drive, seen).drive


def test_a_robot_turns_to_the_heading_at_once_unless_it_is_too_fast() -> None:
    assert moves(at(3.9, heading=1.0), 0.4, FOLLOWS) == TURNS
    assert moves(at(3.9, heading=1.0), 1.0, FOLLOWS) == Drive(0, 0, None, False)


def test_a_turn_ends_where_the_robot_needs_to_slow_down() -> None:
    """At 1 rad/s it turns 0.2 rad further, more than 1.5 tolerances; at 0.5 rad/s 0.1 rad."""
    assert moves(at(3.9, heading=-0.19, turn=1.0), 0.0, TURNS) == Drive(0, 0, None, False)
    assert moves(at(3.9, heading=-0.21, turn=1.0), 0.0, TURNS) is None
    assert moves(at(3.9, heading=-0.11, turn=0.5), 0.0, TURNS) is None
    assert moves(at(3.9, heading=-0.09, turn=0.5), 0.0, TURNS) == Drive(0, 0, None, False)


def test_a_path_with_headings_is_driven_to_its_end_where_it_passes_the_goal() -> None:
    """A cusp may lie beyond the goal: the robot comes by it, and back to it."""
    active = ActiveGoal(Goal(1, 4.0, 0.0, None, ()), [Point2D(4.0, 0.0)], *BEGAN, is_headed=True)

    def is_due(remaining: float) -> bool:
        reference = Reference(2, 0.0, remaining, at(4.0).pose, 0.4, 0.0, 0.0, Point2D(4.0, 0.0), np.zeros((1, 2)), 0.5)
        return Arrival(RULES).is_due(active, FOLLOWS, GoalView(1, 1.0, 10**9, at(4.0), reference=reference))

    assert not is_due(1.0) and is_due(0.2)


def test_near_the_end_of_a_path_with_headings_a_heading_that_is_missing_is_driven_to() -> None:
    active = ActiveGoal(Goal(1, 4.0, 0.0, 0.0, ()), [Point2D(4.0, 0.0)], *BEGAN, is_headed=True)

    def is_due(remaining: float, heading: float) -> bool:
        here = at(3.9, heading=heading)
        reference = Reference(2, 0.0, remaining, here.pose, 0.4, 0.0, 0.0, Point2D(4.0, 0.0), np.zeros((1, 2)), 0.5)
        return Arrival(RULES).is_due(active, FOLLOWS, GoalView(1, 1.0, 10**9, here, reference=reference))

    assert not is_due(0.1, 0.06) and is_due(0.1, 0.04) and is_due(0.005, 0.06), "half of 0.1 rad, or 1 cm"


STEERED = replace(RULES, braking=replace(SOFT, robot=replace(
    SOFT.robot, drive="ackermann", wheelbase=0.5, max_steering=0.6)))  # fmt: skip


def steered_end(heading: float, is_headed: bool) -> Move:
    """The move of a robot with steered wheels that has come to rest at its goal, which has the heading 0."""
    active = ActiveGoal(Goal(1, 4.0, 0.0, 0.0, ()), [Point2D(4.0, 0.0)], *BEGAN, is_headed=is_headed)
    arrival, there = Arrival(STEERED), at(4.0, heading=heading)
    assert arrival.step(active, there.pose, FOLLOWS, GoalView(1, 1.0, 10**9, there)).drive == Drive(0, 0, None, False)
    later = GoalView(40, 30.0, 30 * 10**9, there)
    return arrival.step(active, there.pose, FOLLOWS, later)


def test_a_robot_that_cannot_turn_in_place_ends_at_its_place_and_says_so() -> None:
    end = steered_end(0.5, False).end
    assert end is not None and (end.outcome, end.code) == ("stuck", "heading_missed")
    assert (
        end.reason == "0.000 m and 28.6° off, but this robot cannot turn in place: take a planner that plans headings"
    )


def test_a_robot_that_cannot_turn_in_place_asks_a_planner_of_headings_again() -> None:
    assert steered_end(0.5, True) == Move(plans=True)


def test_a_robot_that_cannot_turn_in_place_is_there_with_the_heading_asked_for() -> None:
    end = steered_end(0.05, False).end
    assert end is not None and end.outcome == "succeeded"


def test_a_robot_stands_when_it_is_measured_so_and_no_command_is_on_its_way() -> None:
    """A dead time of 0.05 s and a tick of 0.05 s after the last command that was not zero."""
    standstill = Standstill(SOFT)
    assert standstill.stands(Twist2D(0.0, 0.0, 0.0), 0.0)
    standstill.note(True, 1.0)
    assert not standstill.stands(Twist2D(0.0, 0.0, 0.0), 1.09)
    assert standstill.stands(Twist2D(0.004, 0.0, -0.004), 1.101)
    assert not standstill.stands(Twist2D(0.006, 0.0, 0.0), 2.0) and not standstill.stands(Twist2D(0.0, 0.0, 0.006), 2.0)


def test_a_run_ends_after_its_goals_and_requests_when_the_robot_stands() -> None:
    ending, still = Ending(SOFT, 3), Twist2D(0.0, 0.0, 0.0)
    assert [ending.is_over(number, number > 4, number < 6, still) for number in range(8)] == [False] * 7 + [True]


def test_a_run_does_not_wait_for_ever() -> None:
    """Ramp 2 s, delay 0.2 s, five lags 0.5 s, and 1 s."""
    ending, slides = Ending(SOFT, 0), Twist2D(0.1, 0.0, 0.0)
    assert SOFT.patience == pytest.approx(3.7)
    ends = next(number for number in range(1, 200) if ending.is_over(number, True, False, slides))
    assert ends * 0.05 == pytest.approx(3.75)


def arriving(misses: int = 0, path_id: int = 2) -> tuple[Arrival, ActiveGoal]:
    """A robot that stops at its goal, (4, 0) and heading 0, since 1.0 s."""
    arrival, active = (
        Arrival(RULES),
        ActiveGoal(Goal(1, 4.0, 0.0, 0.0, ()), [Point2D(4.0, 0.0)], *BEGAN),
    )
    active.misses = misses
    seen = GoalView(1, 1.0, 10**9, at(3.9), speed=0.0)
    assert arrival.step(active, Pose2D(3.9, 0.0, 0.0), Drive(1, path_id, 0.0, True), seen).drive == Drive(
        0, 0, None, False
    )
    assert arrival.since == 1.0
    return arrival, active


def rests(arrival: Arrival, active: ActiveGoal, x: float, heading: float = 0.0, time: float = 3.0) -> Move:
    estimate = PoseEstimate(round(time * 1e9), Pose2D(x, 0.0, heading), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)))
    view = GoalView(40, time, round(time * 1e9), estimate)
    return arrival.step(active, estimate.pose, Drive(0, 0, None, False), view)


def test_at_rest_within_both_tolerances_the_goal_was_reached() -> None:
    assert rests(*arriving(), 3.81, 0.09) == Move(end=GoalEnd("succeeded", "reached", "the goal was reached"))


def test_at_rest_out_of_the_tolerance_the_robot_drives_on() -> None:
    arrival, active = arriving()
    assert rests(arrival, active, 3.79) == Move(plans=True)
    assert arrival.since is None and active.misses == 1


def test_at_rest_with_another_heading_the_robot_turns_again_on_the_same_path() -> None:
    arrival, active = arriving(path_id=7)
    assert rests(arrival, active, 3.9, 0.11) == Move(Drive(1, 7, 0.0, True))
    assert arrival.since is None and active.misses == 1 and active.moved_at == 3.0


def test_after_four_misses_the_goal_ends_stuck() -> None:
    assert rests(*arriving(misses=2), 3.5).plans
    move = rests(*arriving(misses=3), 3.5)
    assert move.end is not None and move.end[:2] == ("stuck", "missed")
    assert move.end.reason.startswith("missed the goal 4 times, the last time by ")


def test_a_robot_that_may_still_move_is_waited_for() -> None:
    """The command before the stop acts for 0.1 s more."""
    arrival, active = arriving()
    assert rests(arrival, active, 3.9, time=1.09) == Move() and arrival.since == 1.0
    end = rests(arrival, active, 3.9, time=1.11).end
    assert end is not None and end.outcome == "succeeded"


def test_a_turn_that_does_not_end_is_stuck_after_a_while() -> None:
    arrival, active = (
        Arrival(RULES),
        ActiveGoal(Goal(1, 4.0, 0.0, 0.0, ()), [Point2D(4.0, 0.0)], *BEGAN),
    )
    active.moved_at = 1.0
    for time, code in ((6.0, ""), (6.1, "heading_missed")):
        view = GoalView(1, time, round(time * 1e9), at(3.9, heading=0.5))
        end = arrival.step(active, Pose2D(3.9, 0.0, 0.5), TURNS, view).end
        assert (end.code if end is not None else "") == code
