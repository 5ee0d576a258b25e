"""Tracking error and control law of Hoang et al. 2013, equations (4), (6) and (7).

It is Samson's law with a lateral gain of 1. The paper calls the robot's parameters "partially unknown", but the law
does not estimate any of them. It is only robust to wrong values: the tests show this for wheel radii and track widths.
"""

from __future__ import annotations

import math
from typing import NamedTuple

__all__ = [
    "TrackingError",
    "energy",
    "final_turn",
    "planar_command",
    "sinc",
    "stopping_turn",
    "tracking_command",
    "tracking_error",
    "turn_acceleration",
    "turn_direction",
    "turn_that_stops",
    "wrap",
]


class TrackingError(NamedTuple):
    """The reference seen from the robot, base frame: e1 ahead, m; e2 to the left, m; e3 heading, rad in [-π, π)."""

    e1: float
    e2: float
    e3: float


def wrap(angle: float) -> float:
    """The same angle, rad, in [-π, π)."""
    wrapped = (angle + math.pi) % (2.0 * math.pi) - math.pi
    return wrapped if wrapped < math.pi else -math.pi


def sinc(angle: float) -> float:
    """sin(angle) / angle, and 1 at 0. Below 1e-4 rad it uses the series, which is exact to the last digit there."""
    if abs(angle) < 1e-4:
        return 1.0 - angle * angle / 6.0
    return math.sin(angle) / angle


def tracking_error(x: float, y: float, heading: float, x_ref: float, y_ref: float, heading_ref: float) -> TrackingError:
    """The reference pose in the frame of the robot: Hoang et al. 2013, eq. (4), e3 wrapped.

    Args:
        x, y, heading: Pose of the robot, m, rad, in any frame.
        x_ref, y_ref, heading_ref: Reference pose, m, rad, in the same frame.
    """
    cos, sin, dx, dy = math.cos(heading), math.sin(heading), x_ref - x, y_ref - y
    return TrackingError(cos * dx + sin * dy, cos * dy - sin * dx, wrap(heading_ref - heading))


def tracking_command(error: TrackingError, v_ref: float, w_ref: float, k1: float, k3: float) -> tuple[float, float]:
    """Velocity that makes the tracking error vanish: Hoang et al. 2013, eq. (6).

    Args:
        error: Longitudinal e1 and lateral e2, m, and heading e3, rad in [-π, π), in the base frame.
        v_ref, w_ref: Reference speed, m/s, negative backwards, and turn rate, rad/s.
        k1, k3: Gains, 1/s, > 0. Lateral poles: s² + k3 s + v_ref²; k3 = 2 v_ref is critical.

    Returns:
        Forward speed, m/s, and turn rate, rad/s, before the limits of the robot.
    """
    v = v_ref * math.cos(error.e3) + k1 * error.e1
    w = w_ref + k3 * error.e3 + v_ref * error.e2 * sinc(error.e3)
    return v, w


def planar_command(
    error: TrackingError, velocity: tuple[float, float], w_ref: float, k1: float, k3: float
) -> tuple[float, float, float]:
    """Velocity that makes the tracking error of a holonomic robot vanish (not in the paper).

    The reference's velocity, seen from the robot, and each error times its gain: `energy` falls by
    k1 (e1² + e2²) + k3 e3².

    Args:
        error: m and rad in [-π, π), in the base frame.
        velocity: Reference speeds ahead and to the left, m/s, in the frame of the reference.
        w_ref: Reference turn rate, rad/s.
        k1, k3: Gains, 1/s, > 0.

    Returns:
        Speeds ahead and to the left, m/s, and turn rate, rad/s, before the limits of the robot.
    """
    cos, sin, (ahead, left) = math.cos(error.e3), math.sin(error.e3), velocity
    vx, vy = cos * ahead - sin * left, sin * ahead + cos * left
    return vx + k1 * error.e1, vy + k1 * error.e2, w_ref + k3 * error.e3


def energy(error: TrackingError) -> float:
    """Lyapunov function ½ (e1² + e2² + e3²): Hoang et al. 2013, eq. (7). Under eq. (6) it falls by k1 e1² + k3 e3²."""
    return 0.5 * (error.e1 * error.e1 + error.e2 * error.e2 + error.e3 * error.e3)


def turn_direction(e3: float, turning: int, above: float, until: float) -> int:
    """Direction of a turn in place before law (6) takes over (not in the paper).

    Law (6) drives backwards if |e3| > 90°, and far from the path if |e3| is not much smaller. The turn starts above one
    heading error and ends below a smaller one. Near ±180°, noise flips the sign of e3, so a turn that has started keeps
    its direction.

    Args:
        e3: Heading error, rad in [-π, π).
        turning: The previous result; 0 at first.
        above, until: Heading errors at which the turn starts and ends, rad >= 0; above >= π: never.

    Returns:
        1 to turn left, -1 right, 0 to follow the law.
    """
    if above >= math.pi or abs(e3) <= (until if turning else above):
        return 0
    if turning and abs(e3) > math.radians(150.0):
        return turning
    return 1 if e3 > 0.0 else -1


def final_turn(e3: float, w_max: float, acceleration: float = math.inf) -> float:
    """Turn rate to the requested heading at the goal, rad/s, where law (6) has no reference (not in the paper).

    Args:
        e3: Heading error, rad in [-π, π).
        w_max: Largest turn rate, rad/s. Once |e3| is below w_max * 0.5 s, the rate falls in proportion to it.
        acceleration: Largest turn acceleration, rad/s²; see `turn_that_stops`.
    """
    fastest = turn_that_stops(e3, w_max, acceleration)
    return max(-fastest, min(fastest, 2.0 * e3))


def turn_that_stops(e3: float, w_max: float, acceleration: float) -> float:
    """Largest turn rate, rad/s, from which a robot stops within |e3|, rad, at half its turn acceleration, rad/s².

    The other half covers the lag of its motors.
    """
    return min(w_max, math.sqrt(acceleration * abs(e3)))


def turn_acceleration(v_ref: float, acceleration: float, wheelbase: float, steering_rate: float) -> float:
    """Largest turn acceleration, rad/s², of a robot that may steer: at a speed, its wheels change the turn rate.

    ω = v tan(δ) / L, so that ω' is at least v δ' / L.

    Args:
        v_ref: Speed, m/s.
        acceleration: Limit of the robot, rad/s²; infinite for none.
        wheelbase: L, m; 0 for a robot that does not steer.
        steering_rate: δ', rad/s; infinite for no limit.
    """
    return acceleration if wheelbase == 0.0 else min(acceleration, abs(v_ref) * steering_rate / wheelbase)


def stopping_turn(w: float, w_ref: float, gain: float, acceleration: float) -> float:
    """A law's turn rate, rad/s, with less correction of the heading where the robot could not end it in time.

    A law that corrects an angle φ at the rate `gain` φ slows down by `gain`² φ. If that is more than the robot can, it
    turns past. See `turn_that_stops`.

    Args:
        w: Of the law, rad/s.
        w_ref: Of the reference, rad/s.
        gain: Of the heading error in the law, 1/s, > 0.
        acceleration: Largest turn acceleration, rad/s²; infinite for no limit.
    """
    correction = w - w_ref
    if gain * abs(correction) <= acceleration:
        return w
    return w_ref + math.copysign(turn_that_stops(correction / gain, math.inf, acceleration), correction)
