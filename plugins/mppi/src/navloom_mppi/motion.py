"""Motion of the robot in a roll-out: the gate's ramps, the lag of the motors, and the pose."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from navloom_avoidance.robot import Robot
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
State = tuple[float, float, float, float, float, float, float]
"""x, y, m, and heading, rad; speed, m/s, and turn rate, rad/s; commanded speed and turn rate."""


class Motion(NamedTuple):
    """What the velocity of a robot can do in one step of a roll-out.

    Attributes:
        step: s.
        slowest, fastest: Bounds of the speed, m/s; the slowest is negative for a robot that may reverse.
        turn: Highest turn rate, rad/s.
        up, down: Change of the commanded speed away from 0 and towards 0, m/s².
        turn_change: Change of the commanded turn rate, rad/s²; may be infinite.
        keeps: Share of the deviation from the command that is left after a step: exp(-step / lag).
        curvature: Highest |turn rate / speed|, 1/m: infinite for a differential drive, 1 / (turning radius) for
            Ackermann.
    """

    step: float
    slowest: float
    fastest: float
    turn: float
    up: float
    down: float
    turn_change: float
    keeps: float
    curvature: float = math.inf


def motion_of(robot: Robot, step: float, reverse: float, turning_radius: float) -> Motion:
    """Motion of a robot.

    Args:
        robot: The robot's properties.
        step: Of a roll-out, s.
        reverse: Highest speed backwards, m/s.
        turning_radius: m; 0 for a differential drive, which turns in place.
    """
    return Motion(
        step, -min(reverse, robot.max_linear), robot.max_linear, robot.max_angular,
        robot.max_acceleration, robot.max_deceleration, turn_change_of(robot),
        math.exp(-step / robot.motor_lag) if robot.motor_lag > 0.0 else 0.0,
        1.0 / turning_radius if turning_radius > 0.0 else math.inf,
    )  # fmt: skip


def turn_change_of(robot: Robot) -> float:
    """Greatest change of the turn rate, rad/s²; may be infinite.

    Without a limit of it, the wheels limit it: a rim that gains `max_acceleration` turns the robot by
    max_acceleration / half_track.
    """
    by_wheels = robot.max_acceleration / robot.half_track if robot.half_track > 0.0 else math.inf
    return min(robot.max_angular_acceleration, by_wheels)


def near_goal(robot: Robot, period: float) -> float:
    """Distance from the goal, m, within which the robot heads straight for it.

    From there the highest speed just stops in time: a tick, the dead time and the lag later, it brakes. Nearer than a
    corner of the footprint, the way that is left of the nose no longer leads there, for a robot however slow.
    """
    late = period + robot.dead_time + robot.motor_lag
    stop = robot.max_linear * late + robot.max_linear**2 / (2.0 * robot.max_deceleration)
    return max(stop, 2.0 * float(np.hypot(robot.footprint[:, 0], robot.footprint[:, 1]).max()))


def turn_within(robot: Robot, duration: float) -> float:
    """Angle, rad, by which the robot can turn in a time, s, from standing, after its dead time and lag."""
    time = max(1.0e-9, duration - robot.dead_time - robot.motor_lag)
    reached = min(robot.max_angular, turn_change_of(robot) * time)
    return reached * (time - 0.5 * reached / turn_change_of(robot))


@njit(cache=True, nogil=True)
def clamp(value: float, low: float, high: float) -> float:
    """The value within its bounds."""
    return min(max(value, low), high)


@njit(cache=True, nogil=True)
def ramp(now: float, wanted: float, up: float, down: float) -> float:
    """Commanded speed after one step: at most `up` farther away from 0, at most `down` nearer to it."""
    # Without branches on the wanted speed, which is random and would be predicted wrongly.
    return clamp(wanted, now - (down if now > 0.0 else up), now + (up if now >= 0.0 else down))


@njit(cache=True, nogil=True)
def follow(
    v: float, w: float, sent_v: float, sent_w: float, asked_v: float, asked_w: float, m: Motion
) -> tuple[float, float, float, float]:
    """Velocity and command after one step in which a velocity is asked for.

    Args:
        v, w: Speed, m/s, and turn rate, rad/s. sent_v, sent_w: Command so far. asked_v, asked_w: Wanted command.
        m: The robot.

    Returns:
        v, w, sent_v, sent_w after the step.
    """
    sent_v = ramp(sent_v, clamp(asked_v, m.slowest, m.fastest), m.up * m.step, m.down * m.step)
    change = m.turn_change * m.step
    sent_w = clamp(clamp(asked_w, -m.turn, m.turn), sent_w - change, sent_w + change)
    # An Ackermann robot that is stopped cannot turn; inf * 0 is not a number.
    if m.curvature < np.inf:
        sent_w = clamp(sent_w, -m.curvature * abs(sent_v), m.curvature * abs(sent_v))
    return sent_v + m.keeps * (v - sent_v), sent_w + m.keeps * (w - sent_w), sent_v, sent_w


@njit(cache=True, nogil=True)
def after_dead_time(twist: tuple[float, float], in_flight: Floats, dead_time: float, period: float, m: Motion) -> State:
    """State of the robot when the command of this tick begins to act; the commands in flight act until then.

    Args:
        twist: Current speed, m/s, and turn rate, rad/s, at the origin.
        in_flight: (n, 2) from motors.Motors.in_flight(), a period apart.
        dead_time, period: s. m: The robot.
    """
    x, y, heading = 0.0, 0.0, 0.0
    v, w = twist
    steps = math.ceil(dead_time / m.step - 1.0e-9)
    for k in range(steps):
        time = dead_time / steps
        row = max(0, in_flight.shape[0] - math.ceil((dead_time - k * time) / period - 1.0e-9))
        keeps = m.keeps ** (time / m.step) if m.keeps > 0.0 else 0.0
        v = in_flight[row, 0] + keeps * (v - in_flight[row, 0])
        w = in_flight[row, 1] + keeps * (w - in_flight[row, 1])
        middle = heading + 0.5 * w * time
        x += v * time * math.cos(middle)
        y += v * time * math.sin(middle)
        heading += w * time
    return x, y, heading, v, w, in_flight[-1, 0], in_flight[-1, 1]
