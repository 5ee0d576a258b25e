"""The roll-out of a braking robot, and what its footprint touches, by numbers worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom.navigation.monitor_rollout import MOST_POSES, distance_to_outline, first_touch, stopping_way, within
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PERIOD, DECELERATION, TURN_DECELERATION = 0.05, 0.8, 1.1
STEP = 0.01


def way(
    twist: tuple[float, float] = (0.0, 0.0),
    command: tuple[float, float] = (0.0, 0.0),
    flying: tuple[tuple[float, float, float], ...] = (),
    age: float = 0.0,
    lag: float = 0.0,
    dead_time: float = 0.0,
    radius: float = 0.6,
    motor: tuple[float, float, float] = (PERIOD, DECELERATION, TURN_DECELERATION),
) -> Floats:
    """Poses of a roll-out, from arrays that hold NaN before."""
    poses = np.full((MOST_POSES + 1, 3), math.nan)
    count = stopping_way(
        np.array([*twist, 0.0]), np.array([(*sent, 0.0) for sent in flying]).reshape(-1, 4), age,
        np.array([*command, 0.0]), np.array([*motor, lag, dead_time]),
        radius, poses,
    )  # fmt: skip
    assert np.isnan(poses[count:]).all()
    return poses[:count]


# --- braking ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("v", "motor", "length"),
    [
        (0.7, (0.05, 0.8, 1.1), 0.324),  # 0.70, 0.66, ... 0.02 m/s for 0.05 s each: 18 terms, their sum is 6.48 m/s
        (-0.7, (0.05, 0.8, 1.1), -0.324),
        (0.7, (0.04, 2.5, 1.1), 0.112),  # 0.7, 0.6, ... 0.1 m/s for 0.04 s each: 2.8 m/s
        (0.3, (0.1, 0.5, 1.1), 0.105),  # 0.30, 0.25, ... 0.05 m/s for 0.1 s each: 1.05 m/s
    ],
)
def test_a_command_is_driven_for_one_period_and_falls_by_the_deceleration_in_each(
    v: float, motor: tuple[float, float, float], length: float
) -> None:
    assert way(command=(v, 0.0), motor=motor)[-1] == pytest.approx((length, 0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize(
    ("w", "angle"),
    [(0.9, 0.414), (-0.9, -0.414), (1.0, 0.505)],  # 0.90, 0.79, ... 0.02 rad/s for 0.1 s each; 1.00, 0.89, ... 0.01
)
def test_turning_in_place_falls_by_the_turn_deceleration(w: float, angle: float) -> None:
    last = way(command=(0.0, w), motor=(0.1, 0.8, 1.1))[-1]
    assert last == pytest.approx((0.0, 0.0, angle), abs=1e-12)


@pytest.mark.parametrize(("v", "w"), [(0.7, 0.35), (0.7, -0.35), (-0.7, 0.35)])
def test_braking_keeps_the_curvature(v: float, w: float) -> None:
    """0.324 m, as on a straight way, on a circle of radius 2 m: an angle of 0.162 rad."""
    x, y, heading = way(command=(v, w))[-1]
    assert heading == pytest.approx(math.copysign(0.162, w), abs=1e-12)
    assert x == pytest.approx(math.copysign(2.0 * math.sin(0.162), v), abs=1e-6)
    assert y == pytest.approx(math.copysign(2.0 * (1.0 - math.cos(0.162)), v * w), abs=1e-6)


def test_a_motor_without_lag_has_the_commanded_speed_at_once() -> None:
    assert way(twist=(0.5, 0.4))[-1] == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize(
    ("twist", "steps"),
    [
        ((0.5, 0.0), 125),  # 0.5 exp(-0.05 n) < 0.001: n > ln(500) / 0.05 = 124.3
        ((-0.5, 0.0), 125),
        ((0.0, 0.8), 134),  # ln(800) / 0.05 = 133.7
        ((0.0, -0.8), 134),
        ((0.0057, 0.0), 35),  # ln(5.7) / 0.05 = 34.8; below 0.0013 it would be after 30
        ((0.0, 0.0057), 35),
        ((0.001, 0.0), 1),  # a speed of 0.001 is no standstill yet
        ((0.0, 0.001), 1),
    ],
)
def test_speeds_approach_the_command_with_the_lag_until_the_robot_stands(
    twist: tuple[float, float], steps: int
) -> None:
    """Speeds are 0.95123 of the one before, and their sum that of a geometric series."""
    kept = math.exp(-STEP / 0.2)
    time = STEP * kept * (1.0 - kept**steps) / (1.0 - kept)
    assert way(twist=twist, lag=0.2)[-1] == pytest.approx((twist[0] * time, 0.0, twist[1] * time), abs=1e-12)


def test_speeds_rise_with_the_lag_too() -> None:
    """0.4 m/s, commanded for 0.03 s: with a share of 1 - exp(-0.05) = 0.048771 in each step of 0.01 s."""
    kept = math.exp(-STEP / 0.2)
    rising = [0.4 * (1.0 - kept**n) for n in (1, 2, 3)]
    falling = [rising[-1] * kept**n for n in range(1, 300) if rising[-1] * kept ** (n - 1) >= 1e-3]
    last = way(command=(0.4, 0.0), lag=0.2, motor=(0.03, 100.0, 1.0))[-1]
    assert last[0] == pytest.approx(STEP * (sum(rising) + sum(falling)), abs=1e-12)


def test_a_robot_that_hardly_brakes_is_followed_for_12_s() -> None:
    assert way(command=(0.17, 0.0), motor=(PERIOD, 1e-9, 1.0))[-1][0] == pytest.approx(0.17 * 12.0, abs=0.17 * STEP)


@pytest.mark.parametrize(("late", "length"), [(0.5e-6, 0.0), (1.15e-6, 0.003)])
def test_a_period_ends_a_millionth_of_it_early(late: float, length: float) -> None:
    """With a deceleration of 6 m/s², 0.3 m/s end with the first period, or 0.01 s later."""
    last = way(command=(0.3, 0.0), age=late * PERIOD, flying=((-1.0, 0.3, 0.0),), motor=(PERIOD, 6.0, 1.0))[-1]
    assert last[0] == pytest.approx(0.3 * PERIOD + length, abs=1e-9)


# --- commands in flight -----------------------------------------------------------------------------------------------


def test_without_a_command_in_flight_the_robot_stands_until_the_command_acts() -> None:
    assert way(command=(0.7, 0.35), age=0.03, dead_time=0.06)[-1] == pytest.approx(way(command=(0.7, 0.35))[-1])


def test_the_last_command_in_flight_acts_until_the_dead_time_is_over() -> None:
    """0.3 m/s and 0.12 rad/s for 0.03 + 0.06 s, and then the command: 0.324 m straight on."""
    x, _, heading = way(command=(0.7, 0.0), flying=((-0.1, 0.3, 0.12),), age=0.03, dead_time=0.06)[-1]
    assert heading == pytest.approx(0.12 * 0.09, abs=1e-12)
    assert x == pytest.approx(0.027 + 0.324, abs=4e-5)


def test_each_command_in_flight_acts_a_dead_time_after_it_was_given() -> None:
    """The second begins to act at 0.01 s, the third at 0.05 s, the command at 0.10 s: 1, 4 and 5 steps."""
    flying = ((-0.10, 0.3, 0.11), (-0.05, 0.4, 0.23), (-0.01, 0.6, -0.05))
    x, _, heading = way(flying=flying, age=0.04, dead_time=0.06)[-1]
    assert heading == pytest.approx(0.01 * (0.11 + 4 * 0.23 - 5 * 0.05), abs=1e-12)
    assert x == pytest.approx(0.01 * (0.3 + 4 * 0.4 + 5 * 0.6), abs=1e-5)


def test_commands_that_acted_before_the_odometry_are_passed_over() -> None:
    """The third command acts since 0.01 s before the odometry, and for all of the 0.1 s."""
    flying = ((-0.30, 0.9, 0.0), (-0.20, 0.8, 0.0), (-0.07, 0.35, 0.0))
    assert way(flying=flying, age=0.04, dead_time=0.06)[-1][0] == pytest.approx(0.035, abs=1e-12)


def test_a_command_in_flight_that_acts_just_with_a_step_counts_for_it() -> None:
    """Times are equal but for rounding: -0.09 + 0.1 is a little more than 0.01."""
    flying = ((-0.15, 0.2, 0.0), (-0.09, 0.5, 0.0))
    assert way(flying=flying, dead_time=0.1)[-1][0] == pytest.approx(0.2 * 0.01 + 0.5 * 0.09, abs=1e-12)


@pytest.mark.parametrize(("age", "steps"), [(1e-9, 0), (0.03 + 0.5e-9, 3), (0.03 + 1.15e-9, 4)])
def test_the_command_acts_from_the_step_that_is_nearest(age: float, steps: int) -> None:
    last = way(flying=((-1.0, 0.2, 0.0),), age=age)[-1]
    assert last[0] == pytest.approx(0.2 * 0.01 * steps, abs=1e-12)


@pytest.mark.parametrize(("given", "steps"), [(1e-9, 0), (0.02 + 0.5e-9, 2), (0.02 + 1.15e-9, 3)])
def test_a_command_in_flight_acts_from_the_step_that_is_nearest(given: float, steps: int) -> None:
    last = way(flying=((-1.0, 0.2, 0.0), (given, 0.5, 0.0)), age=0.06)[-1]
    assert last[0] == pytest.approx(0.01 * (0.2 * steps + 0.5 * (6 - steps)), abs=1e-12)


def test_a_command_that_acts_a_little_early_is_no_larger() -> None:
    """After 0.03 s at 0.2 m/s, 0.9 ns early: 0.3 m/s, and each 0.01 s later 19, 39, ... periods of 0.5 ms are over."""
    last = way(command=(0.3, 0.0), flying=((-1.0, 0.2, 0.0),), age=0.03 + 0.9e-9, motor=(0.0005, 6.0, 1.0))[-1]
    speeds = [0.3, 0.243, 0.183, 0.123, 0.063, 0.003]
    assert last[0] == pytest.approx(0.006 + 0.01 * sum(speeds), abs=1e-12)


# --- the poses in between ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "radius", "apart"),
    [
        ((0.7, 0.0), 0.6, 3),  # 0.7 cm a step: 2.1 cm after three
        ((-0.7, 0.0), 0.6, 3),
        ((0.7, 0.35), 2.0, 2),  # 0.7 + 0.7 cm a step
        ((0.7, -0.35), 2.0, 2),
        ((0.7, 0.35), 0.0, 3),
        ((1.9, 0.0), 0.6, 2),  # 1.9 cm a step is less than 2 cm
        ((2.0, 0.0), 0.6, 1),  # and 2.0 cm is enough
    ],
)
def test_no_point_of_the_footprint_moves_more_than_2_cm_and_a_step_between_two_poses(
    command: tuple[float, float], radius: float, apart: int
) -> None:
    poses = way(command=command, radius=radius, motor=(1.0, 1.0, 1.0))
    assert poses[0] == pytest.approx((0.0, 0.0, 0.0), abs=0.0)
    headings = command[1] * STEP * apart * np.array([1.0, 2.0, 3.0])
    lengths = command[0] * STEP * apart * np.array([1.0, 2.0, 3.0])
    assert poses[1:4, 2] == pytest.approx(headings, abs=1e-12)
    assert poses[1:4, 0] == pytest.approx(lengths, abs=1e-4)
    assert poses[1:4, 1] == pytest.approx(0.5 * lengths * headings, abs=1e-6)


def test_the_last_pose_is_where_the_robot_stands() -> None:
    """0.012 m in 5 steps of 0.0024 m are less than 2 cm: only the first and the last pose."""
    assert way(command=(0.24, 0.0), motor=(PERIOD, 10.0, 1.0)) == pytest.approx(np.array([(0, 0, 0), (0.012, 0, 0)]))


def test_a_long_way_has_all_its_poses_and_no_more() -> None:
    """25.2 m in 1201 steps of 2.1 cm: a pose each until the last row, and there the end."""
    poses = way(command=(2.1, 0.0), motor=(PERIOD, 1e-9, 1.0))
    assert len(poses) == MOST_POSES == 512
    assert poses[-2:, 0] == pytest.approx((510 * 0.021, 1201 * 0.021), abs=1e-5)


# --- touching ---------------------------------------------------------------------------------------------------------

TRAPEZOID = np.array([(0.75, 0.25), (-0.5, 0.5), (-0.5, -0.5), (0.75, -0.25)])
"""A footprint that is narrow in front; its left edge falls by 1 in 5."""


@pytest.mark.parametrize(
    ("x", "y", "distance"),
    [
        (1.0, 0.125, 0.25),  # in front
        (-0.8, 0.2, 0.3),  # behind
        (0.25, 0.75, 0.4 * 5 / math.sqrt(26)),  # left: the edge is at y = 0.35 there
        (0.25, -0.75, 0.4 * 5 / math.sqrt(26)),
        (0.0, 0.0, -0.4 * 5 / math.sqrt(26)),  # inside: the edge is at y = 0.4 there
        (0.6, 0.0, -0.15),  # inside, the front is nearest
        (1.05, 0.27, 0.3),  # near a corner: from the line of the front
    ],
)
def test_distance_from_a_footprint(x: float, y: float, distance: float) -> None:
    assert distance_to_outline(x, y, TRAPEZOID) == pytest.approx(distance, abs=1e-12)


SQUARE = np.array([(0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)])
AHEAD = np.array([(0.0, 0.0, 0.0), (0.25, 0.0, 0.0), (0.5, 0.0, 0.0)])


def touch(points: list[tuple[float, float]], margin: float, poses: Floats = AHEAD, count: int = 3) -> int:
    return int(first_touch(poses, count, SQUARE, np.array(points).reshape(-1, 2), np.full(len(points), margin)))


def test_the_first_point_on_the_way_is_touched_and_not_the_first_of_the_list() -> None:
    assert touch([(3.0, 0.0), (0.99, 0.1), (0.74, 0.2)], 0.01) == 2
    assert touch([(0.74, 0.2), (0.99, 0.1)], 0.01) == 0
    assert touch([(3.0, 0.0), (1.02, 0.1)], 0.01) == -1
    assert touch([], 0.01) == -1


def test_a_point_at_the_margin_is_not_touched() -> None:
    assert touch([(1.25, 0.0)], 0.25) == -1
    assert touch([(1.25, 0.0)], 0.2500001) == 0


def test_poses_beyond_the_count_are_not_driven() -> None:
    assert touch([(0.9, 0.0)], 0.01, count=2) == -1


def test_a_point_that_is_too_near_from_the_beginning_counts_if_the_footprint_comes_nearer() -> None:
    assert touch([(0.505, 0.0)], 0.01) == 0
    assert touch([(-0.505, 0.0)], 0.01) == -1
    assert touch([(0.0, 0.505)], 0.01) == -1


@pytest.mark.parametrize(("nearer", "hit"), [(0.7e-5, -1), (1e-5, -1), (1.15e-5, 0), (2e-5, 0)])
def test_less_than_a_hundredth_of_a_millimetre_is_rounding(nearer: float, hit: int) -> None:
    """The front is at x = 0, so that distances have no rounding."""
    poses, outline = np.array([(0.0, 0.0, 0.0), (nearer, 0.0, 0.0)]), SQUARE - (0.5, 0.0)
    assert first_touch(poses, 2, outline, np.array([(nearer, 0.0)]), np.full(1, 0.01)) == hit


def test_a_footprint_turns_with_its_pose() -> None:
    """At (0.3, 0.2), where cos = 0.8 and sin = 0.6, the front is 0.75 m along (0.8, 0.6), the rear 0.5 m."""
    poses = np.array([(-9.0, 7.0, 0.1), (-8.0, 5.0, 0.9), (0.3, 0.2, math.atan2(0.6, 0.8))])
    front = (0.3 + 0.77 * 0.8, 0.2 + 0.77 * 0.6)
    rear = (0.3 - 0.52 * 0.8 - 0.4 * 0.6, 0.2 - 0.52 * 0.6 + 0.4 * 0.8)
    aside = (0.3 + 0.4 * 0.8 - 0.37 * 0.6, 0.2 + 0.4 * 0.6 + 0.37 * 0.8)  # the left edge is at 0.32 there
    for point, distance in ((front, 0.02), (rear, 0.02), (aside, 0.05 * 5 / math.sqrt(26))):
        for margin, hit in ((distance + 1e-9, 1), (distance - 1e-9, -1)):
            assert first_touch(poses, 3, TRAPEZOID, np.array([(5.0, 5.0), point]), np.full(2, margin)) == hit


def test_each_point_has_its_own_margin() -> None:
    """At the end the front is at x = 1.0; the first point is 3 cm before it, the second 2 cm."""
    points = np.array([(1.03, 0.1), (1.02, 0.2)])
    for wide, hit in ((0.031, 0.0), 0), ((0.029, 0.021), 1), ((0.029, 0.019), -1):
        assert first_touch(AHEAD, 3, SQUARE, points, np.array(wide)) == hit


@pytest.mark.parametrize(("slope", "hit"), [(0.0, 0), (0.019, 0), (0.0201, -1), (0.1, -1)])
def test_a_point_may_come_nearer_by_the_slope_of_the_way(slope: float, hit: int) -> None:
    """0.3 m ahead and 0.4 m aside, 0.5 m of way, take the left edge 1 cm nearer to a point beside it: 2 %."""
    poses = np.array([(1.0, 2.0, 0.0), (1.3, 2.4, 0.0)])
    outline = np.array([(9.0, 0.39), (-9.0, 0.39), (-9.0, -0.5), (9.0, -0.5)])
    point = np.array([(1.0, 2.0 + 0.39 + 0.05)])
    turned = np.array([(1.0, 2.0, 0.0), (1.0 + 0.5 * math.cos(0.02), 2.0 + 0.5 * math.sin(0.02), 0.0)])
    assert first_touch(poses, 2, outline, point, np.full(1, 0.06), slope) == 0, "0.4 m nearer"
    assert first_touch(turned, 2, outline, point, np.full(1, 0.06), slope) == hit


def test_the_slope_counts_from_the_first_pose() -> None:
    """Two steps of 0.5 m, each 0.9 cm nearer: 1.8 % after the first and after both; then 3 cm in 0.1 m."""
    poses = np.array([(0.0, 0.0, 0.0), (0.5, 0.009, 0.0), (1.0, 0.018, 0.0), (1.1, 0.048, 0.0)])
    outline = np.array([(9.0, 0.4), (-9.0, 0.4), (-9.0, -0.4), (9.0, -0.4)])
    point = np.array([(0.0, 0.45)])
    assert first_touch(poses, 3, outline, point, np.full(1, 0.06), 0.02) == -1
    assert first_touch(poses, 4, outline, point, np.full(1, 0.06), 0.02) == 0
    assert first_touch(poses, 3, outline, point, np.full(1, 0.06), 0.017) == 0


def test_points_within_their_margin_are_those_nearer_than_it() -> None:
    """Distances of 0.25, 0.3 and -0.15 m, and of 0.25 m that is just the margin."""
    points = np.array([(1.0, 0.125, 7.0), (-0.8, 0.2, 7.0), (0.6, 0.0, 7.0), (1.0, 0.125, 7.0)])
    near = within(points, TRAPEZOID, np.array([0.26, 0.29, 0.0, 0.25]))
    assert near.tolist() == [True, False, True, False]
    assert within(points[:0], TRAPEZOID, np.empty(0)).tolist() == []
