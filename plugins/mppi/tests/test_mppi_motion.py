"""Motion in a roll-out against numbers worked by hand."""

import math

import numpy as np
import pytest
from navloom_avoidance.robot import Robot
from navloom_mppi.critics import CRITICS
from navloom_mppi.motion import Motion, after_dead_time, follow, motion_of, near_goal, ramp, turn_within
from navloom_mppi.rollout import drive, knots_of

SQUARE = np.array([[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]])
AT_ONCE = Motion(0.1, -0.5, 2.0, 3.0, 1.0e6, 1.0e6, 1.0e6, 0.0)
STANDING = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("now", "wanted", "then"),
    [(1.0, 2.0, 1.1), (1.0, 0.0, 0.7), (1.0, 1.05, 1.05), (-1.0, 0.0, -0.7), (-1.0, -2.0, -1.1), (0.0, -1.0, -0.1)],
)
def test_a_command_grows_by_0_1_and_falls_by_0_3_in_a_step(now, wanted, then):
    assert ramp(now, wanted, 0.1, 0.3) == pytest.approx(then)


def test_a_lagging_speed_closes_half_of_its_deviation_from_the_ramp_in_a_step():
    """Ramp 0.1, 0.2; speed 0.1 + (0 - 0.1) / 2 = 0.05, then 0.2 + (0.05 - 0.2) / 2 = 0.125."""
    motion = AT_ONCE._replace(up=1.0, keeps=0.5)
    v, w, sent_v, sent_w = follow(0.0, 0.0, 0.0, 0.0, 1.0, 0.0, motion)
    assert (v, sent_v) == pytest.approx((0.05, 0.1))
    v, w, sent_v, sent_w = follow(v, w, sent_v, sent_w, 1.0, 0.0, motion)
    assert (v, sent_v) == pytest.approx((0.125, 0.2))


def test_a_differential_drive_turns_in_place_and_an_ackermann_robot_does_not():
    """Radius 2 m: at 0.4 m/s at most 0.2 rad/s, standing none."""
    ackermann = AT_ONCE._replace(curvature=0.5)
    assert follow(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, AT_ONCE)[1] == 1.0
    assert follow(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, ackermann)[1] == 0.0
    assert follow(0.0, 0.0, 0.0, 0.0, 0.4, 1.0, ackermann)[1] == pytest.approx(0.2)
    assert follow(0.0, 0.0, 0.0, 0.0, -0.4, 1.0, ackermann)[1] == pytest.approx(0.2)


def test_the_motion_follows_from_the_robot():
    """Lag 0.1 s, step 0.05 s: exp(-0.5) is kept. A rim that gains 2 m/s² at 0.2 m turns by 10 rad/s²."""
    robot = Robot(SQUARE, 2.0, 3.0, 2.0, 1.5, motor_lag=0.1, half_track=0.2)
    motion = motion_of(robot, 0.05, 0.35, 0.0)
    assert motion == pytest.approx((0.05, -0.35, 2.0, 3.0, 2.0, 1.5, 10.0, math.exp(-0.5), math.inf))
    assert motion_of(robot, 0.05, 5.0, 4.0)[1] == -2.0
    assert motion_of(robot, 0.05, 0.35, 4.0).curvature == 0.25


def test_commands_in_flight_act_until_the_newest_one_does():
    """Dead time 0.1 s, two commands of 0.05 s: 0.4 and 0.8 m/s drive 0.02 + 0.04 m."""
    in_flight = np.array([[0.4, 0.0], [0.8, 0.0]])
    state = after_dead_time((0.2, 0.0), in_flight, 0.1, 0.05, AT_ONCE._replace(step=0.05))
    assert state == pytest.approx((0.06, 0.0, 0.0, 0.8, 0.0, 0.8, 0.0))


def test_without_a_dead_time_the_state_is_the_measured_one():
    state = after_dead_time((0.3, 0.1), np.array([[0.3, 0.1]]), 0.0, 0.05, AT_ONCE)
    assert state == pytest.approx((0.0, 0.0, 0.0, 0.3, 0.1, 0.3, 0.1))


def rolled(plan, motion, noise=None, pace=1.0, sigma=(0.0, 0.0), hold=None):
    plan = np.array(plan, dtype=float)
    hold = len(plan) if hold is None else hold
    noise = np.zeros((2, 2), np.float32) if noise is None else np.array(noise, np.float32)
    part, track = np.zeros(len(CRITICS)), np.zeros((len(plan), 5))
    drive(plan, noise, pace, sigma, hold, STANDING, motion, part, track)
    return dict(zip(CRITICS, part.tolist(), strict=True)), track


def test_a_lagged_motor_drives_the_sum_of_its_mean_speeds():
    """Speeds 0, 0.5, 0.75, 0.875 m/s, means 0.25, 0.625, 0.8125: 0.16875 m in three steps of 0.1 s."""
    _, track = rolled([[1.0, 0.0]] * 3, AT_ONCE._replace(keeps=0.5))
    np.testing.assert_allclose(track[:, 0], [0.025, 0.0875, 0.16875])


def test_an_arc_ends_where_its_circle_does():
    """1 m/s and 0.5 rad/s: radius 2 m; after 2 s at (2 sin 1, 2 - 2 cos 1). Speed at the start is 1, not 0."""
    motion, plan = AT_ONCE._replace(step=0.02), np.tile([1.0, 0.5], (100, 1))
    part, track = np.zeros(len(CRITICS)), np.zeros((100, 5))
    start = (0.0, 0.0, 0.0, 1.0, 0.5, 1.0, 0.5)
    drive(plan, np.zeros((2, 2), np.float32), 1.0, (0.0, 0.0), 100, start, motion, part, track)
    np.testing.assert_allclose(track[-1, :3], [2.0 * math.sin(1.0), 2.0 - 2.0 * math.cos(1.0), 1.0], atol=2e-4)
    np.testing.assert_allclose(track[-1, 3:], [math.cos(1.0), math.sin(1.0)], atol=1e-6)


def test_noise_is_linear_between_its_knots():
    """Knots 0 and 1 with sigma 0.4, two steps apart: commands 1.0, 1.2, then from the second knot 1.4."""
    noise = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]]
    _, track = rolled([[1.0, 0.0]] * 4, AT_ONCE, noise, sigma=(0.4, 0.1), hold=2)
    np.testing.assert_allclose(np.diff(track[:, 0]), [0.11, 0.13, 0.14], rtol=1e-6)


def test_a_roll_out_of_pace_0_starts_from_standing():
    _, track = rolled([[1.0, 0.5]] * 4, AT_ONCE, pace=0.0)
    assert np.abs(track[:, :3]).max() == 0.0


def test_the_critics_of_velocities_are_means():
    """Backwards at 0.25 of 4 steps at 0.4 m/s; turning at 1 rad/s in two of them; 0.5 m/s beyond 2 m/s in one."""
    costs, _ = rolled([[-0.4, 1.0], [2.5, 0.0], [0.0, -1.0], [0.0, 0.0]], AT_ONCE)
    found = [costs[name] for name in ("prefer_forward", "twirling", "constraint", "control")]
    assert found == pytest.approx([0.1, 0.5, 0.125, 0.0])


def test_the_control_cost_is_that_of_williams():
    """u ε / σ² = 1 · 0.2 / 0.04 = 5 in each of two steps."""
    costs, _ = rolled([[1.0, 0.0]] * 2, AT_ONCE, [[1.0, 0.0]] * 2, sigma=(0.2, 0.1))
    assert costs["control"] == pytest.approx(10.0)


@pytest.mark.parametrize(("steps", "hold", "knots"), [(56, 7, 9), (56, 1, 57), (57, 7, 10), (8, 50, 2)])
def test_every_step_is_between_two_knots(steps, hold, knots):
    assert knots_of(steps, hold) == knots


@pytest.mark.parametrize(
    ("speed", "braking", "lag", "within"),
    # Half an edge of 0.3 m: corners 0.424 m away. 2 m/s and 2 m/s²: 2 * 0.2 + 1; 0.3 m/s stops within the footprint.
    [(2.0, 2.0, 0.1, 1.4), (0.3, 1.0, 0.05, 2.0 * math.hypot(0.3, 0.3))],
)
def test_the_robot_heads_straight_for_a_goal_within_its_stopping_distance(speed, braking, lag, within):
    square = 0.3 * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    robot = Robot(square, speed, 3.0, 1.0, braking, motor_lag=lag, dead_time=0.05)
    assert near_goal(robot, 0.05) == pytest.approx(within)


@pytest.mark.parametrize(
    ("fastest", "change", "lag", "dead_time", "bearing"),
    [
        # Of 1.4 - 0.5 s, it takes 0.5 s to reach 45°/s, and turns by 11.25° meanwhile; then 0.4 s at 45°/s.
        (45.0, 90.0, 0.3, 0.2, 11.25 + 18.0),
        (90.0, 50.0, 0.3, 0.1, 25.0),  # 90°/s is not reached in 1 s
        (180.0, math.inf, 0.1, 0.05, 225.0),
        (40.0, math.inf, 0.4, 0.0, 40.0),
        (90.0, 50.0, 1.0, 0.5, 0.0),  # by then, it does not even begin to turn
    ],
)
def test_the_angle_a_robot_turns_by_in_1_4_s_from_standing(fastest, change, lag, dead_time, bearing):
    limits = {"motor_lag": lag, "dead_time": dead_time, "max_angular_acceleration": math.radians(change)}
    robot = Robot(np.eye(2), 1.0, math.radians(fastest), 1.0, 1.0, **limits)
    assert math.degrees(turn_within(robot, 1.4)) == pytest.approx(bearing, abs=1e-6)
