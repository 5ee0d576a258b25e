"""Drive, odometry and contact."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from navloom import Box, Cylinder, Place
from navloom_sensors_sim.motion import STATE, arc

QUIET = {"noise": False}
WALL = Box("wall", (1.0, 1.2), (-2.0, 2.0))


def test_straight_on(bench):
    pose = bench(QUIET).step(0.4, count=20).truth.pose
    assert (pose.x, pose.y, pose.heading) == (pytest.approx(0.4, abs=1e-12), 0.0, 0.0)


def test_quarter_circle(bench):
    """0.4 m/s at 0.2 rad/s is a circle of 2 m; 157 ticks turn 1.57 rad."""
    pose = bench(QUIET).step(0.4, 0.2, count=157).truth.pose
    assert (pose.x, pose.y) == pytest.approx((2.0 * math.sin(1.57), 2.0 - 2.0 * math.cos(1.57)), abs=1e-12)
    assert pose.heading == pytest.approx(1.57, abs=1e-12)


def test_heading_wraps_to_half_open_interval(bench):
    heading = bench(QUIET, start=Place(0.0, 0.0, 3.1)).step(0.0, 0.4, count=10).truth.pose.heading
    assert heading == pytest.approx(3.3 - 2.0 * math.pi, abs=1e-12)


@given(st.floats(-1, 1), st.floats(-2, 2), st.floats(-3, 3))
def test_arc_is_the_sum_of_its_halves(v, w, heading):
    whole, half = arc(0.3, -0.2, heading, v, w, 1.0), arc(0.3, -0.2, heading, v, w, 0.5)
    assert arc(*half, v, w, 0.5)[:2] == pytest.approx(whole[:2], abs=1e-9)


def test_wheel_speeds_are_those_of_eq_2(bench):
    """v = 0.3, w = 0.2, r = 0.05, R = 0.3: (0.3 ± 0.06) / 0.05 = 7.2 and 4.8 rad/s."""
    robot = bench(QUIET)
    robot.step(0.3, 0.2)
    state = robot.platform._robot.state
    assert (state[STATE["right"]], state[STATE["left"]]) == pytest.approx((7.2, 4.8), abs=1e-12)


def test_wheel_limit_keeps_the_curvature(bench):
    """(0.5 ± 0.6) / 0.05 = 22 and -2 rad/s; scaled by 20 / 22."""
    twist = bench(QUIET | {"max_wheel_speed": 20.0}).step(0.5, 2.0).truth.twist
    assert (twist.vx, twist.wz) == pytest.approx((0.5 / 1.1, 2.0 / 1.1), abs=1e-12)


def test_motor_lag_in_closed_form(bench):
    """x = v (t - T (1 - exp(-t/T))), exact whatever the sub-step."""
    out = bench(QUIET | {"motor_time_constant": 0.5}).step(0.3, count=20)
    assert out.truth.pose.x == pytest.approx(0.3 * (1.0 - 0.5 * (1.0 - math.exp(-2.0))), abs=1e-12)
    assert out.truth.twist.vx == pytest.approx(0.3 * (1.0 - math.exp(-2.0)), abs=1e-12)
    assert out.odometry.pose.x == pytest.approx(out.truth.pose.x, abs=1e-12)


def test_wheel_acceleration_is_limited(bench):
    """2 rad/s² for 1 s: 2 rad/s, 1 rad, 0.05 m."""
    out = bench(QUIET | {"max_wheel_acceleration": 2.0}).step(0.3, count=20)
    assert (out.truth.pose.x, out.truth.twist.vx) == pytest.approx((0.05, 0.1), abs=1e-12)


def test_larger_wheels_go_further_than_odometry_measures(bench):
    out = bench(QUIET | {"wheel_radius_error": 0.05}).step(0.4, count=20)
    assert (out.truth.pose.x, out.odometry.pose.x) == pytest.approx((0.42, 0.40), abs=1e-12)


def test_true_twist_is_that_of_the_true_wheels_and_track(bench):
    """Wheels 5 % larger and a track 20 % wider: v = 1.05 * 0.4, w = 1.05 / 1.2 * 0.2."""
    twist = bench(QUIET | {"wheel_radius_error": 0.05, "half_track_error": 0.2}).step(0.4, 0.2).truth.twist
    assert (twist.vx, twist.wz) == pytest.approx((0.42, 0.175), abs=1e-12)


def test_a_wider_track_turns_less_than_odometry_measures(bench):
    out = bench(QUIET | {"half_track_error": 0.05}).step(0.0, 0.2, count=20)
    assert (out.truth.pose.heading, out.odometry.pose.heading) == pytest.approx((0.2 / 1.05, 0.2), abs=1e-12)


def test_right_wheel_believed_larger_makes_odometry_turn_left(bench):
    """1 m straight on: the right wheel seems to go 1.01 m, so the heading grows by 0.01 / 0.6."""
    pose = bench(QUIET | {"odometry_right_radius_error": 0.01}).step(0.4, count=50).odometry.pose
    assert pose.heading == pytest.approx(0.01 / 0.6, abs=1e-12)
    assert pose.y > 0.0


def test_left_wheel_believed_larger_makes_odometry_turn_right(bench):
    pose = bench(QUIET | {"odometry_left_radius_error": 0.01}).step(0.4, count=50).odometry.pose
    assert pose.heading == pytest.approx(-0.01 / 0.6, abs=1e-12)


def test_track_believed_wider_makes_odometry_turn_less(bench):
    out = bench(QUIET | {"odometry_half_track_error": 0.05}).step(0.0, 0.2, count=20)
    assert out.odometry.pose.heading == pytest.approx(0.2 / 1.05, abs=1e-12)


def test_calibrated_odometry_of_a_wrong_robot_is_right(bench):
    """With the true radius and track, odometry follows the truth."""
    wrong = {"wheel_radius_error": 0.05, "half_track_error": 0.05}
    known = {"odometry_" + k: 0.05 for k in ("right_radius_error", "left_radius_error", "half_track_error")}
    out = bench(QUIET | wrong | known).step(0.4, 0.2, count=60)
    assert out.odometry.pose.x == pytest.approx(out.truth.pose.x, abs=1e-12)
    assert out.odometry.pose.y == pytest.approx(out.truth.pose.y, abs=1e-12)


def test_odometry_starts_at_zero_in_its_own_frame(bench):
    out = bench(QUIET, start=Place(3.0, -2.0, 1.0)).step(0.4, count=20)
    assert (out.odometry.pose.x, out.odometry.pose.y) == pytest.approx((0.4, 0.0), abs=1e-12)
    assert out.truth.pose.x == pytest.approx(3.0 + 0.4 * math.cos(1.0), abs=1e-12)


def test_encoders_lose_less_than_a_count(bench):
    """100 counts per turn are 2π 0.05 / 100 = 3.14 mm; fractions are not lost."""
    robot = bench(QUIET | {"encoder_counts": 100})
    behind = []
    for _ in range(60):
        out = robot.step(0.11)
        behind.append(out.truth.pose.x - out.odometry.pose.x)
    assert min(behind) >= -1e-12
    assert 0.001 < max(behind) < 0.1 * math.pi / 100 + 1e-12


def test_slip_spreads_with_the_root_of_the_way(bench):
    """2 m at 0.01 m/sqrt(m) a wheel: the heading spreads by 0.01 sqrt(2) sqrt(2) / 0.6 = 0.0333 rad."""
    headings = [bench({"slip": 0.01}, seed=s).step(0.4, count=100).odometry.pose.heading for s in range(300)]
    assert np.std(headings) == pytest.approx(0.0333, rel=0.12)
    assert abs(np.mean(headings)) < 0.006


def test_slip_does_not_move_the_robot(bench):
    assert bench({"slip": 0.05}).step(0.4, count=20).truth.pose.x == pytest.approx(0.4, abs=1e-12)


def test_robot_stops_before_the_wall_and_can_back_off(bench):
    """0.025 m a tick: the front reaches the wall with the 24th, so the robot stays where the 23rd took it."""
    robot = bench(QUIET, obstacles=(WALL,))
    out = robot.step(0.5, count=23)
    assert (out.contact.touching, out.truth.clearance) == (False, pytest.approx(0.025, abs=1e-9))
    out = robot.step(0.5, count=5)
    assert (out.contact.touching, out.truth.clearance, out.truth.nearest) == (True, 0.0, "wall")
    assert (out.truth.pose.x, out.truth.twist.vx) == (pytest.approx(0.575, abs=1e-9), 0.0)
    assert out.odometry.pose.x == pytest.approx(0.575, abs=1e-9)
    out = robot.step(-0.5)
    assert (out.contact.touching, out.truth.pose.x) == (False, pytest.approx(0.55, abs=1e-9))


def test_robot_passes_under_a_high_girder_but_not_a_low_one(bench):
    high, low = (Box("girder", (1.0, 1.2), (-2.0, 2.0), z) for z in ((1.4, 1.6), (0.9, 1.1)))
    assert bench(QUIET, obstacles=(high,)).step(0.5, count=100).truth.pose.x == pytest.approx(2.5, abs=1e-9)
    assert bench(QUIET, obstacles=(low,)).step(0.5, count=100).truth.pose.x == pytest.approx(0.575, abs=1e-9)


def test_obstacle_appears_at_its_time_on_top_of_the_robot(bench):
    robot = bench(QUIET, obstacles=(Box("crate", (-0.1, 0.1), (-0.1, 0.1), appears_at=0.5),))
    assert robot.step(count=9).truth.clearance == math.inf
    out = robot.step()
    assert (out.contact.touching, out.truth.nearest) == (True, "crate")


def test_moving_obstacle_comes_nearer(bench):
    """From x = 5 to 1 in 4 s: after 2 s its centre is at 3, its rim at 2.5, 2.1 m from the robot's front."""
    walker = Cylinder("walker", 5.0, 0.0, 0.5, waypoints=((0.0, 5.0, 0.0), (4.0, 1.0, 0.0)))
    robot = bench(QUIET, obstacles=(walker,))
    assert robot.step(count=40).truth.clearance == pytest.approx(2.1, abs=1e-9)
    out = robot.step(count=40)
    assert (out.truth.clearance, out.truth.nearest) == (pytest.approx(0.1, abs=1e-9), "walker")


def test_moving_obstacle_runs_into_the_robot(bench):
    walker = Box("cart", (4.9, 5.1), (-0.1, 0.1), waypoints=((0.0, 5.0, 0.0), (1.0, 0.0, 0.0)), loops=True)
    robot = bench(QUIET, obstacles=(walker,))
    touched = [robot.step().contact.touching for _ in range(20)]
    assert touched.index(True) == 17  # x = 5 - 0.25 k <= 0.5 first for k = 18
    assert not touched[-1]  # at t = 1 s it starts again at x = 5
