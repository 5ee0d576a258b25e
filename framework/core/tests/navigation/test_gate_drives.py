"""The gate and its monitor on robots that steer, or that drive sideways."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from judged_gate import FREE, LIMITS, decide, judged, offer
from limits import with_robot
from navloom.messages import Odometry, Pose2D, RangeScan, StopReason, Twist2D
from navloom.navigation.collision_monitor import CollisionMonitor, MonitorLimits, Verdict
from navloom.navigation.command_gate import CommandGate, GateLimits
from navloom.navigation.monitor_rollout import MOST_POSES, stopping_way
from navloom.testing import robot
from numpy.typing import NDArray

CAR: dict[str, Any] = {"drive": "ackermann", "wheelbase": 0.5, "max_steering": math.radians(45.0)}
"""It turns on circles of 0.5 m radius at least."""
BOTH = {"avoider": offer(0.0)}


def passed(limits: GateLimits, *twists: tuple[float, float, float]) -> Twist2D:
    """What a gate passes of the last of several twists."""
    gate = CommandGate(limits)
    out = Twist2D(0.0, 0.0, 0.0)
    for twist in twists:
        out, *_ = decide(gate, {**BOTH, "controller": offer()._replace(twist=Twist2D(*twist))})
    return out


def test_steered_wheels_turn_no_tighter_than_their_limit() -> None:
    """At 0.3 m/s and a radius of 0.5 m: 0.6 rad/s."""
    assert passed(with_robot(FREE, **CAR), (0.3, 0.0, 0.8)).wz == pytest.approx(0.6)


def test_backwards_too() -> None:
    assert passed(with_robot(FREE, **CAR), (-0.3, 0.0, 0.8)).wz == pytest.approx(0.6)


def test_a_steered_robot_is_not_told_to_turn_in_place() -> None:
    assert passed(with_robot(FREE, **CAR), (0.0, 0.0, 0.8)) == Twist2D(0.0, 0.0, 0.0)


def test_a_steered_robot_speeds_up_along_the_curvature_asked_for() -> None:
    """From rest, 0.6 m/s² give 0.03 m/s in a tick; a curvature of 1 / m then 0.03 rad/s."""
    slow = with_robot(LIMITS, max_angular_acceleration=math.inf, **CAR)
    twist = passed(slow, (0.4, 0.0, 0.4))
    assert (twist.vx, twist.wz) == pytest.approx((0.03, 0.03))


def test_a_steered_robot_that_is_stopped_keeps_its_curvature() -> None:
    slow = with_robot(LIMITS, max_acceleration=1e3, max_angular_acceleration=math.inf, **CAR)
    twist = passed(slow, (0.4, 0.0, 0.2), (0.0, 0.0, 0.0))
    assert twist.wz / twist.vx == pytest.approx(0.5) and twist.vx == pytest.approx(0.4 - 1.1 * 0.05)


def test_only_a_holonomic_robot_is_told_to_drive_sideways() -> None:
    assert passed(FREE, (0.3, 0.2, 0.0)) == Twist2D(0.3, 0.0, 0.0)
    assert passed(with_robot(FREE, drive="holonomic"), (0.3, 0.2, 0.0)) == Twist2D(0.3, 0.2, 0.0)


def test_the_speed_limit_holds_for_both_directions_together() -> None:
    """0.9 and 1.2 m/s are 1.5 m/s; 0.7 m/s are allowed."""
    twist = passed(with_robot(FREE, drive="holonomic"), (0.9, 1.2, 0.0))
    assert (twist.vx, twist.vy) == pytest.approx((0.42, 0.56))


def test_the_acceleration_limit_holds_for_both_directions_together() -> None:
    """0.6 m/s² in 0.05 s, in the direction asked for."""
    twist = passed(with_robot(LIMITS, drive="holonomic"), (0.3, 0.4, 0.0))
    assert (twist.vx, twist.vy) == pytest.approx((0.018, 0.024))


def test_a_holonomic_robot_brakes_along_its_way() -> None:
    limits = with_robot(LIMITS, drive="holonomic", max_acceleration=1e3)
    gate = CommandGate(limits)
    decide(gate, {**BOTH, "controller": offer()._replace(twist=Twist2D(0.3, 0.4, 0.0))})
    twist, _, status = decide(gate, {})
    assert status.why == StopReason("no_trajectory")
    assert (twist.vx, twist.vy) == pytest.approx((0.6 * 0.445, 0.8 * 0.445)), "0.5 m/s less 1.1 m/s² in 0.05 s"


def test_an_operators_limit_slows_a_holonomic_robot_along_its_way() -> None:
    gate = CommandGate(with_robot(FREE, drive="holonomic"))
    gate.speed_limit = 0.25
    twist, *_ = decide(gate, {**BOTH, "controller": offer()._replace(twist=Twist2D(0.3, 0.4, 0.1))})
    assert twist.read_fields() == pytest.approx((0.15, 0.2, 0.05))


def test_the_monitor_is_asked_about_the_way_to_the_side() -> None:
    gate, judge = judged(limits=with_robot(FREE, drive="holonomic"))
    sideways = {**BOTH, "controller": offer()._replace(twist=Twist2D(0.0, 0.4, 0.0))}
    decide(gate, sideways)
    decide(gate, sideways)
    assert judge.asked[1][:2] == (Twist2D(0.0, 0.4, 0.0), 0.4), "the twist, and the speed of the last command"


# --- the monitor ------------------------------------------------------------------------------------------------------


def judge(twist: Twist2D, **spec: Any) -> Verdict:
    """The verdict on a command to a robot of 0.6 x 0.6 m that sees a post 0.2 m to its left."""
    limits = MonitorLimits(robot(0.6, 0.6, max_linear=1.0, **spec), 0.05, 0.001)
    monitor = CollisionMonitor(limits)
    monitor.move(Odometry(0, Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0)))
    bearings = np.linspace(-math.pi, math.pi, 361)
    ranges = np.where(np.abs(bearings - 0.5 * math.pi) < 0.02, 0.5, 5.0)
    beams = len(bearings)
    monitor.look(
        "laser", RangeScan(0, np.zeros((beams, 2)), bearings, np.zeros(beams), np.zeros(beams), ranges, 0.05, 10.0)
    )
    return monitor.judge(twist, 0.0, 0.0)


def test_an_obstacle_to_the_left_stops_a_way_to_the_left() -> None:
    """From 1 m/s at 1 m/s² it would stop after half a metre."""
    verdict = judge(Twist2D(0.0, 1.0, 0.0), drive="holonomic", max_deceleration=1.0)
    assert verdict.kind == "obstacle" and verdict.share < 0.7


def test_it_does_not_stop_a_way_to_the_right() -> None:
    assert judge(Twist2D(0.0, -1.0, 0.0), drive="holonomic", max_deceleration=1.0).kind == ""


def roll_out(command: tuple[float, float, float], motor: list[float]) -> NDArray[np.float64]:
    poses = np.zeros((MOST_POSES, 3))
    still, none = np.zeros(3), np.zeros((0, 4))
    count = stopping_way(still, none, 0.0, np.array(command), np.array(motor), 0.5, poses)
    return poses[:count]


def test_a_roll_out_to_the_side_ends_there() -> None:
    """0.7 m/s for 0.05 s and then less by 0.04 m/s in each period: 0.324 m, as straight ahead."""
    end = roll_out((0.0, -0.7, 0.0)[:1] + (0.0, -0.7), [0.05, 0.8, 1.1, 0.0, 0.0])[-1]
    assert end == pytest.approx([0.0, -0.324, 0.0], abs=1e-9)


def test_a_roll_out_of_steered_wheels_turns_them_at_their_rate() -> None:
    """Wheels at 45° to the right that turn by 0.1 rad/s at most: the robot turns right, whatever is asked for."""
    end = roll_out((0.7, 0.7, 0.0), [0.05, 0.8, 1.1, 0.0, 0.0, 0.5, 0.1, -math.pi / 4.0])[-1]
    assert end[2] < -0.4
