"""The trackers as plugins."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from navloom import (
    Context,
    ControllerInput,
    Discovery,
    Point2D,
    Pose2D,
    PoseEstimate,
    Reference,
    RobotSpec,
    Trajectory,
    Twist2D,
)
from navloom_trackers.adapter import FierroLewis, Graceful, Kanayama, PurePursuit, Ramsete, RegulatedPurePursuit
from navloom_trackers.limits import stiffest
from pydantic import ValidationError

SQUARE = np.array([[-0.4, -0.4], [0.4, -0.4], [0.4, 0.4], [-0.4, 0.4]])
ROBOT = RobotSpec(SQUARE, 1.2, 0.05, 0.3, 0.5, math.radians(25.0), 0.5, 1.0)
STEERED = replace(ROBOT, drive="ackermann", wheelbase=0.5, max_steering=0.5)
ALONG = np.linspace(0.0, 9.0, 451)
TRAJECTORY = Trajectory(1, np.column_stack((ALONG, ALONG, 0 * ALONG, 0 * ALONG, 0 * ALONG, 0 * ALONG + 0.3)))
TRACKERS = {cls.name: cls for cls in (FierroLewis, Graceful, Kanayama, PurePursuit, Ramsete, RegulatedPurePursuit)}
EACH = pytest.mark.parametrize("name", sorted(TRACKERS))


def make(name, **params):
    context = Context("main", 0.05, ROBOT, np.random.default_rng, Pose2D(0.0, 0.0, 0.0))
    return TRACKERS[name](TRACKERS[name].Params(**params), context)


def seen(x, y, heading, speed=0.3, turn_to=None, moving=(0.3, 0.0)):
    """The robot at a pose, its reference re-projected on the x axis."""
    covariance = np.zeros((3, 3))
    reference = Reference(1, x, 9.0 - x, Pose2D(x, 0.0, 0.0), speed, 0.0, y, Point2D(x + 1.0, 0.0),
                          np.array([[x, 0.0], [x + 1.0, 0.0]]), 0.4, turn_to)  # fmt: skip
    twist = Twist2D(moving[0], 0.0, moving[1])
    return ControllerInput(0, TRAJECTORY, reference, PoseEstimate(0, Pose2D(x, y, heading), twist, covariance))


@EACH
def test_it_is_found_by_its_name(name):
    assert Discovery().role("controller", name) is TRACKERS[name]


@EACH
def test_on_the_reference_it_drives_as_the_reference(name):
    command = make(name).control(seen(1.0, 0.0, 0.0))
    assert (command.twist.vx, command.twist.vy, command.twist.wz) == pytest.approx((0.3, 0.0, 0.0))
    assert (command.e1, command.e2, command.e3) == pytest.approx((0.0, 0.0, 0.0))


def test_the_command_of_kanayama_is_eq_8_and_carries_the_errors():
    command = make("kanayama", k_y=4.0).control(seen(1.0, -0.02, 0.1))
    assert (command.e1, command.e2, command.e3) == pytest.approx((0.02 * math.sin(0.1), 0.02 * math.cos(0.1), -0.1))
    # Critical: k_theta = 2 * 2.
    assert command.twist.vx == pytest.approx(0.3 * math.cos(0.1) + 0.02 * math.sin(0.1))
    assert command.twist.wz == pytest.approx(0.3 * (4.0 * 0.02 * math.cos(0.1) - 4.0 * math.sin(0.1)))


def test_the_command_of_ramsete():
    # k = 2 * 0.5 * sqrt(4 * 0.09) = 0.6.
    command = make("ramsete", b=4.0, zeta=0.5).control(seen(1.0, -0.02, 0.0))
    assert (command.twist.vx, command.twist.wz) == pytest.approx((0.3, 4.0 * 0.3 * 0.02))


def test_fierro_and_lewis_lead_the_measured_velocity_to_the_law():
    # Behind the law by 0.1 m/s and 0.1 rad/s; exp(-1) of that is left after a tick of 0.05 s at 20 1/s. The foot moves
    # at 0.2 m/s: e1' = -0.1 e2 ... with e = 0, e' = (0, 0, -0.1): the turn rate is to fall by v_r k3 0.1 = 0.12 rad/s².
    command = make("fierro_lewis", k4=20.0).control(seen(1.0, 0.0, 0.0, moving=(0.2, 0.1)))
    left = math.exp(-1.0)
    assert command.twist.vx == pytest.approx(0.3 - 0.1 * left)
    assert command.twist.wz == pytest.approx(0.1 * left - 0.12 * 0.05)


def test_pure_pursuit_drives_the_arc_to_a_point_half_a_metre_away():
    # 0.3 m to the right: the point is 0.4 m ahead and 0.3 m to the left, of 0.5 m; curvature 2 * 0.3 / 0.25 = 2.4 1/m.
    # 0.3 m/s / (0.9 * 2.4) = 0.139 m/s.
    command = make("pure_pursuit").control(seen(1.0, -0.3, 0.0))
    assert command.twist.vx == pytest.approx(0.3 / 2.16, abs=1e-3)
    assert command.twist.wz / command.twist.vx == pytest.approx(2.4, abs=1e-3)


def test_pure_pursuit_slows_before_the_end():
    assert make("pure_pursuit").control(seen(8.7, 0.0, 0.0)).twist.vx == pytest.approx(0.15)


def test_regulated_pure_pursuit_looks_ahead_and_slows_by_the_limits_of_the_robot():
    """Late by a tick of 0.05 s: 3.544 * 0.05 * 0.3 = 0.05 m, so half the inscribed radius, 0.2 m, is looked ahead.

    Of it, 0.12 m are to the left: curvature 2 * 0.12 / 0.04 = 6 1/m. Arcs are slow below 0.5 / 0.43633 = 1.14592 m.
    """
    command = make("regulated_pure_pursuit").control(seen(1.0, -0.12, 0.0)).twist
    assert command.wz / command.vx == pytest.approx(6.0, rel=1e-2)
    assert command.vx == pytest.approx(0.5 / (1.14592 * 6.0), rel=1e-2)


@pytest.mark.parametrize("name", ["regulated_pure_pursuit", "graceful"])
def test_it_slows_within_its_braking_distance_of_the_end(name):
    """0.5² / 1 = 0.25 m; at 0.2 m of it 0.4 m/s, more than the reference's speed, and at 0.1 m 0.2 m/s."""
    assert make(name).control(seen(8.8, 0.0, 0.0)).twist.vx == pytest.approx(0.3)
    assert make(name).control(seen(8.9, 0.0, 0.0)).twist.vx == pytest.approx(0.2)


def test_graceful_heads_for_a_pose_one_look_ahead_away():
    """6.970 * 0.05 * 0.3 = 0.10 m, so 0.2 m, of which 0.12 m to the left, at the angle asin 0.6 = 0.6435 to the line.

    θ = -0.6435 and δ = -0.6435: 3 (0.6435 + atan 0.6435) + (1 + 1 / 1.4141) 0.6 = 4.6698, over 0.2: 23.349 1/m.
    β = (0.5 / 0.87266)² = 0.32828, so by the paper v = 0.5 / (1 + 0.32828 * 545.2) = 0.00278 m/s. The turn rate is
    greatest where β κ² = 1, at 1.7453 1/m: 0.25 * 1.7453 = 0.43633 rad/s.
    """
    away = seen(1.0, -0.12, 0.0)
    as_printed = make("graceful", approach_deg=90.0, keeps_turn_rate=False).control(away).twist
    assert as_printed.wz / as_printed.vx == pytest.approx(23.349, rel=1e-2)
    assert as_printed.vx == pytest.approx(0.00278, rel=2e-2)
    assert make("graceful", approach_deg=90.0).control(away).twist.wz == pytest.approx(0.43633, rel=1e-4)


@pytest.mark.parametrize("name", ["regulated_pure_pursuit", "graceful"])
def test_beside_it_the_mirrored_scene_gives_the_mirrored_command(name):
    left = make(name).control(seen(1.0, -0.2, 0.3)).twist
    right = make(name).control(seen(1.0, 0.2, -0.3)).twist
    assert (right.vx, right.wz) == pytest.approx((left.vx, -left.wz))


@EACH
def test_far_beside_it_does_not_turn_beyond_the_limits_of_the_robot(name):
    command = make(name).control(seen(1.0, -0.2, 0.0)).twist
    assert command.wz <= ROBOT.max_angular + 1e-12
    assert 0.0 < command.vx <= ROBOT.max_linear


@EACH
def test_far_beside_the_heading_back_is_the_angle_of_approach(name):
    """It keeps an angle of 45 degrees, and turns towards it from either side."""
    turns = []
    for degrees in (40.0, 45.0, 50.0):
        command = make(name).control(seen(1.0, -3.0, math.radians(degrees))).twist
        turns.append(command.wz)
    assert turns[0] > 0.0 > turns[2]
    assert turns[1] == pytest.approx(0.0, abs=1e-6)


def test_the_printed_rule_of_kanayama_heads_back_more_squarely_from_farther():
    """k_y n cos e3 = k_theta sin e3: 45 degrees at 0.25 m, and still turning to the line at 1 m."""
    tracker = make("kanayama", approach_deg=90.0)
    assert tracker.control(seen(1.0, -0.25, 0.25 * math.pi)).twist.wz == pytest.approx(0.0, abs=1e-9)
    assert tracker.control(seen(1.0, -1.0, 0.25 * math.pi)).twist.wz > 0.0


def test_a_law_drives_backwards_only_if_allowed():
    """Turned away beside the line, the reference lies behind: 0.3 cos 50° - 10 sin 50° m/s."""
    away = seen(1.0, 1.0, math.radians(50.0))
    assert make("kanayama", k_x=10.0, approach_deg=90.0).control(away).twist.vx == 0.0
    assert make("kanayama", k_x=10.0, approach_deg=90.0, may_reverse=True).control(away).twist.vx < -0.1


@EACH
def test_a_robot_that_faces_away_turns_in_place(name):
    tracker = make(name)
    turning = tracker.control(seen(1.0, 0.0, math.radians(150.0))).twist
    assert (turning.vx, turning.wz) == pytest.approx((0.0, -ROBOT.max_angular))
    assert tracker.control(seen(1.0, 0.0, math.radians(30.0))).twist.vx == 0.0, (
        "it turns on below the angle of its start"
    )
    tracker.reset()
    assert tracker.control(seen(1.0, 0.0, math.radians(30.0))).twist.vx > 0.0


def turned_round(given):
    """The same scene for a robot that drives backwards: robot, reference and trajectory head the other way."""
    samples = given.trajectory.samples.copy()
    samples[:, 3] -= math.pi
    samples[:, 4:] *= -1.0
    twist = given.estimate.twist
    return replace(
        given,
        trajectory=Trajectory(1, samples),
        reference=replace(given.reference, pose=turned(given.reference.pose), speed=-given.reference.speed),
        estimate=replace(given.estimate, pose=turned(given.estimate.pose), twist=Twist2D(-twist.vx, 0.0, twist.wz)),
    )


def turned(pose):
    return replace(pose, heading=math.remainder(pose.heading + math.pi, math.tau))


@EACH
@pytest.mark.parametrize(("y", "heading"), [(0.0, 0.0), (0.3, 0.1), (-0.2, -0.4), (0.1, 2.5)])
def test_a_robot_that_backs_along_its_path_turns_as_one_that_drives_forwards(name, y, heading):
    forwards = seen(1.0, y, heading)
    ahead, back = (make(name).control(given) for given in (forwards, turned_round(forwards)))
    assert (back.twist.vx, back.twist.wz) == pytest.approx((-ahead.twist.vx, ahead.twist.wz))
    assert (back.e1, back.e2, back.e3) == pytest.approx((-ahead.e1, -ahead.e2, ahead.e3))


@EACH
def test_a_robot_that_steers_drives_where_another_would_turn_in_place(name):
    context = Context("main", 0.05, STEERED, np.random.default_rng, Pose2D(0.0, 0.0, 0.0))
    tracker = TRACKERS[name](TRACKERS[name].Params(), context)
    assert tracker.control(seen(1.0, 0.0, math.radians(80.0))).twist.vx > 0.0


def test_the_gain_of_a_robot_that_steers_is_full_an_eighth_of_its_radius_beside():
    """R = 1 m: 1 / R at 1 / 8 m needs 8 1/m²; 16 of RAMSETE would steer fully at 6 cm."""
    assert stiffest(1.0) == pytest.approx(8.0)
    assert stiffest(0.0) == math.inf


def test_a_slow_wheel_slows_the_turn_in_place():
    command = make("kanayama", max_wheel_speed=1.0).control(seen(1.0, 0.0, math.pi))
    assert abs(command.twist.wz) == pytest.approx(0.05 / 0.3)


@EACH
def test_at_the_goal_it_turns_to_the_goal_heading_and_stops(name):
    tracker = make(name)
    left = tracker.control(seen(9.0, 0.0, 0.0, turn_to=1.0)).twist
    assert (left.vx, left.wz) == pytest.approx((0.0, ROBOT.max_angular))
    back = tracker.control(seen(9.0, 0.0, 1.1, turn_to=1.0))
    assert (back.twist.vx, back.twist.wz, back.e3) == pytest.approx((0.0, -0.2, -0.1))


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("kanayama", {"k_y": 0.0}),
        ("kanayama", {"k3": 1.0}),
        ("fierro_lewis", {"k4": -1.0}),
        ("ramsete", {"zeta": math.inf}),
        ("ramsete", {"turn_in_place_above_deg": 15.0}),
        ("pure_pursuit", {"min_look_ahead": 1.0}),
        ("pure_pursuit", {"approach_deg": 91.0}),
        ("regulated_pure_pursuit", {"max_look_ahead": 0.3, "min_look_ahead": 0.4}),
        ("graceful", {"exponent": 1.0}),
    ],
    ids=lambda value: value if isinstance(value, str) else next(iter(value)),
)
def test_parameters_out_of_bounds_are_refused(name, wrong):
    with pytest.raises(ValidationError):
        make(name, **wrong)
