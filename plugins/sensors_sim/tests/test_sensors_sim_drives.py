"""Steered and holonomic robots: the motion that a command gives, and their odometry."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from navloom import Context, PlatformInput, PlatformOutput, Pose2D, RobotSpec, Twist2D
from navloom_sensors_sim.adapter import SensorsSim

BODY = np.array([[-0.2, -0.2], [0.6, -0.2], [0.6, 0.2], [-0.2, 0.2]])
TICK_NS = 50_000_000
CAR = {"drive": "ackermann", "wheelbase": 0.5, "max_steering": math.radians(45.0)}


def driven(
    twists: list[tuple[float, float, float]], spec: dict[str, Any], params: dict[str, Any] | None = None
) -> PlatformOutput:
    """The last answer of a robot that gets one twist a tick of 50 ms, without slip."""
    robot = RobotSpec(BODY, 1.0, 0.05, 0.2, 1.0, 3.0, 1.0, 1.0, **spec)
    context = Context("main", 0.05, robot, lambda name: np.random.default_rng(0), Pose2D(0.0, 0.0, 0.0))
    platform = SensorsSim(SensorsSim.Params(noise=False, **(params or {})), context)
    out = platform.advance(PlatformInput(Twist2D(0.0, 0.0, 0.0), None, 0))
    for tick, twist in enumerate(twists, 1):
        out = platform.advance(PlatformInput(Twist2D(*twist), None, tick * TICK_NS))
    return out


def test_a_steered_robot_drives_on_an_arc() -> None:
    """1 m/s and 1 rad/s for 1 s: an arc of 1 m radius by 1 rad."""
    pose = driven([(1.0, 0.0, 1.0)] * 20, CAR).truth.pose
    assert (pose.x, pose.y, pose.heading) == pytest.approx((math.sin(1.0), 1.0 - math.cos(1.0), 1.0))


def test_a_steered_robot_turns_no_tighter_than_its_steering_allows() -> None:
    """At 45° the radius is the wheelbase: 0.5 m/s give 1 rad/s, whatever was asked for."""
    assert driven([(0.5, 0.0, 3.0)], CAR).truth.twist.wz == pytest.approx(1.0)


def test_a_steered_robot_does_not_turn_in_place() -> None:
    twist = driven([(0.0, 0.0, 1.0)] * 20, CAR).truth.twist
    assert (twist.vx, twist.wz) == (0.0, 0.0)


def test_backwards_the_same_turn_needs_the_opposite_steering() -> None:
    """-1 m/s and 1 rad/s: back along the arc to the right, heading to the left."""
    pose = driven([(-1.0, 0.0, 1.0)] * 20, CAR).truth.pose
    assert (pose.x, pose.y, pose.heading) == pytest.approx((-math.sin(1.0), math.cos(1.0) - 1.0, 1.0))


def test_steering_takes_its_time() -> None:
    """30° in 1 s at 30°/s: after half of it, 15°: w = v tan(15°) / L."""
    twist = driven([(1.0, 0.0, 2.0)] * 10, CAR | {"max_steering_rate": math.radians(30.0)}).truth.twist
    assert twist.wz == pytest.approx(math.tan(math.radians(15.0)) / 0.5)


def test_steering_lags() -> None:
    """First order: after one time constant, 1 - 1/e of 45°."""
    twist = driven([(1.0, 0.0, 2.0)] * 10, CAR, {"steering_time_constant": 0.5}).truth.twist
    assert twist.wz == pytest.approx(math.tan(math.radians(45.0) * (1.0 - math.exp(-1.0))) / 0.5)


def test_the_rear_wheels_of_a_steered_robot_count_its_way() -> None:
    out = driven([(0.6, 0.0, 0.8)] * 30 + [(-0.4, 0.0, 0.5)] * 30, CAR)
    assert np.allclose(out.odometry.pose.read_fields(), out.truth.pose.read_fields(), atol=1e-9)


def test_odometry_that_assumes_a_wider_track_measures_less_turn() -> None:
    twist = driven([(1.0, 0.0, 1.0)], CAR, {"odometry_half_track_error": 0.25}).odometry.twist
    assert twist.wz == pytest.approx(1.0 / 1.25)


def test_a_holonomic_robot_drives_sideways() -> None:
    out = driven([(0.0, 0.5, 0.0)] * 20, {"drive": "holonomic"})
    assert np.allclose(out.truth.pose.read_fields(), (0.0, 0.5, 0.0), atol=1e-12)
    assert out.odometry.twist.vy == pytest.approx(0.5)


def test_a_holonomic_robot_that_turns_meanwhile_drives_on_an_arc() -> None:
    """To the left at 1 m/s and turning at 1 rad/s: the centre of the arc is 1 m behind; after 1 rad."""
    pose = driven([(0.0, 1.0, 1.0)] * 20, {"drive": "holonomic"}).truth.pose
    assert (pose.x, pose.y, pose.heading) == pytest.approx((math.cos(1.0) - 1.0, math.sin(1.0), 1.0))


def test_the_wheels_of_a_holonomic_robot_count_its_way() -> None:
    out = driven([(0.3, -0.4, 0.5)] * 40, {"drive": "holonomic"}, {"motor_time_constant": 0.2})
    assert np.allclose(out.odometry.pose.read_fields(), out.truth.pose.read_fields(), atol=1e-9)


def test_a_differential_robot_ignores_a_speed_to_the_side() -> None:
    pose = driven([(0.0, 0.5, 0.0)] * 20, {}).truth.pose
    assert (pose.x, pose.y) == (0.0, 0.0)
