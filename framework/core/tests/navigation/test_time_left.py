"""The estimate of the remaining time, with numbers that can be checked by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from navloom.messages import Goal, Point2D, Pose2D, PoseEstimate, Reference, Trajectory, Twist2D
from navloom.navigation.braking import Braking
from navloom.navigation.goal_rules import GoalRules, GoalView
from navloom.navigation.time_left import TimeLeft
from navloom.testing import robot

RULES = GoalRules(
    tolerance=0.2, heading_tolerance=0.1, stuck_after=5.0, max_recoveries=1, map_timeout=10.0, plan_timeout=2.0,
    localizer_timeout=5.0, deadline=60.0, scans_on_request=False, feedback_ticks=10,
    braking=Braking(robot(max_angular=0.5), 0.05), fastest=0.4, cruise=0.4,
)  # fmt: skip
GOAL, LEGS = Goal(1, 4.0, 0.0, None, ()), [Point2D(4.0, 0.0)]


def follows(done: float, speed: float = 0.4) -> Reference:
    """A reference on the way from (0, 0) to (4, 0), m, with a speed, m/s, that is not that of the trajectory."""
    return Reference(2, done, 4.0 - done, Pose2D(done, 0.0, 0.0), speed, 0.0, 0.0, Point2D(4.0, 0.0), np.zeros((1, 2)),
                     0.5)  # fmt: skip


def seen(time: float, done: float = 0.0, heading: float = 0.0, v: float = 0.4) -> GoalView:
    """A tick on a straight trajectory that is driven at `v`, m/s, throughout."""
    estimate = PoseEstimate(0, Pose2D(done, 0.0, heading), Twist2D(0.0, 0.0, 0.0), np.zeros((3, 3)))
    samples = np.array([[s, s, 0.0, 0.0, 0.0, v] for s in (0.0, 2.0, 4.0)])
    return GoalView(0, time, 0, estimate=estimate, reference=follows(done), trajectory=Trajectory(2, samples))


def left(view: GoalView, rules: GoalRules = RULES, goal: Goal = GOAL, legs: list[Point2D] = LEGS) -> float:
    return TimeLeft(rules).estimate(goal, legs, view, view.reference)


def test_a_slow_reference_at_the_start_does_not_stretch_it() -> None:
    view = seen(0.0)
    assert TimeLeft(RULES).estimate(GOAL, LEGS, view, follows(0.0, speed=0.04)) == pytest.approx(4.0 / 0.4)


def test_the_slow_parts_of_the_trajectory_count_at_their_speed() -> None:
    assert left(seen(0.0, done=2.0, v=0.1)) == pytest.approx(2.0 / 0.1)


def test_before_a_path_it_is_the_straight_way_through_all_points() -> None:
    view = replace(seen(0.0), reference=None)
    assert left(view, legs=[Point2D(4.0, 0.0), Point2D(4.0, 2.0)]) == pytest.approx(6.0 / 0.4)


def test_the_legs_behind_the_trajectory_count_too() -> None:
    assert left(seen(0.0, done=3.0), legs=[Point2D(4.0, 0.0), Point2D(4.0, 2.0)]) == pytest.approx(3.0 / 0.4)


def test_a_robot_that_follows_no_reference_is_expected_at_its_own_speed() -> None:
    assert left(seen(0.0), replace(RULES, cruise=0.8)) == pytest.approx(4.0 / 0.8)


def test_turns_at_the_start_and_at_the_goal_are_added() -> None:
    goal = replace(GOAL, heading=math.pi)
    assert left(seen(0.0, heading=math.pi / 2), goal=goal) == pytest.approx(4.0 / 0.4 + 1.5 * math.pi / 0.5)


def test_at_the_goal_only_the_rest_of_its_turn_is_left() -> None:
    view = seen(0.0, done=4.0, heading=1.0)
    assert TimeLeft(RULES).estimate(GOAL, LEGS, view, replace(follows(4.0), turn_to=2.0)) == pytest.approx(1.0 / 0.5)


def drive(speed: float, until: float) -> tuple[TimeLeft, GoalView]:
    """After a drive at a speed, m/s, for a time, s."""
    estimator, view = TimeLeft(RULES), seen(0.0)
    for tick in range(round(until / 0.05) + 1):
        view = seen(0.05 * tick, speed * 0.05 * tick)
        estimator.look(view, view.reference)
    return estimator, view


def test_a_robot_at_half_the_speed_needs_longer() -> None:
    estimator, view = drive(0.2, 10.0)
    # 10 s for what the reference drives in 5 s, beside 30 s that count as expected: 40 s for 35 s, and 2 m are left.
    assert estimator.estimate(GOAL, LEGS, view, view.reference) == pytest.approx(40.0 / 35.0 * 2.0 / 0.4)


def test_another_trajectory_is_no_progress() -> None:
    estimator, view = drive(0.4, 5.0)
    assert view.trajectory is not None
    other = replace(view, time=9.0, reference=replace(follows(0.0), path_id=3),
                    trajectory=replace(view.trajectory, path_id=3))  # fmt: skip
    estimator.look(other, other.reference)
    # Had the 4 s counted, the robot would seem slower than its reference, which it follows exactly.
    assert estimator.estimate(GOAL, LEGS, other, other.reference) == pytest.approx(4.0 / 0.4)


def test_a_stopped_robot_keeps_a_finite_estimate() -> None:
    estimator, view = drive(0.0, 60.0)
    assert estimator.estimate(GOAL, LEGS, view, view.reference) == pytest.approx(90.0 / 30.0 * 10.0)


def test_a_lost_trajectory_counts_at_the_largest_speed() -> None:
    assert left(replace(seen(0.0, done=2.0), trajectory=None)) == pytest.approx(2.0 / 0.4)


def test_a_way_back_takes_its_time_too() -> None:
    """2 m at 0.4 m/s and 1 m back at 0.1 m/s: 15 s."""
    rows = [(0.0, 0.0, 0.4), (2.0, 2.0, 0.4), (2.0, 2.0, -0.1), (3.0, 1.0, -0.1)]
    samples = np.array([[s, x, 0.0, 0.0, 0.0, v] for s, x, v in rows])
    view = replace(seen(0.0), trajectory=Trajectory(2, samples))
    assert left(view) == pytest.approx(15.0)
