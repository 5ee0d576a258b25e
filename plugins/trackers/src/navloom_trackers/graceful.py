"""Park, Kuipers, *A Smooth Control Law for Graceful Motion of Differential Wheeled Mobile Robots in 2D Environment*,
ICRA 2011: the way to a pose, in egocentric polar coordinates.

Here the pose is the point of the trajectory one look-ahead away, with the trajectory's heading there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from navloom_lyapunov_tracker.law import wrap

__all__ = [
    "EgocentricPolar",
    "curvature",
    "egocentric_polar",
    "line_of_sight",
    "rates",
    "speed",
    "speed_weight",
    "turning_speed",
]


class EgocentricPolar(NamedTuple):
    """A pose seen from the robot, relative to the line of sight from the robot to it.

    Attributes:
        r: Distance, m.
        theta: Heading of the pose, rad in [-π, π) from the line of sight.
        delta: Heading of the robot, rad in [-π, π) from the line of sight.
    """

    r: float
    theta: float
    delta: float


def egocentric_polar(
    x: float, y: float, heading: float, x_target: float, y_target: float, heading_target: float
) -> EgocentricPolar:
    """Coordinates of a target pose, m, rad, for a robot at a pose, m, rad, both in the same frame."""
    dx, dy = x_target - x, y_target - y
    sight = math.atan2(dy, dx)
    return EgocentricPolar(math.hypot(dx, dy), wrap(heading_target - sight), wrap(heading - sight))


def rates(seen: EgocentricPolar, v: float, w: float) -> EgocentricPolar:
    """Time derivative of the coordinates of a fixed target, m/s and rad/s: r' = -v cos δ, θ' = v/r sin δ, δ' = θ' + ω.

    Args:
        seen: r > 0.
        v, w: Speed, m/s, and turn rate, rad/s, of the robot.
    """
    swing = v / seen.r * math.sin(seen.delta)
    return EgocentricPolar(-v * math.cos(seen.delta), swing, swing + w)


def curvature(seen: EgocentricPolar, k1: float, k2: float) -> float:
    """Curvature ω / v of the way to the target, 1/m.

    κ = -(1/r) (k2 (δ - atan(-k1 θ)) + (1 + k1 / (1 + (k1 θ)²)) sin δ). Under it,
    z = δ - atan(-k1 θ) vanishes: z' = -k2 v/r z.

    Args:
        seen: r > 0.
        k1: Ratio of the rate of θ to that of r, > 0. k2: Rate of z, > 0.
    """
    bent = k1 * seen.theta
    steering = k2 * (seen.delta + math.atan(bent)) + (1.0 + k1 / (1.0 + bent * bent)) * math.sin(seen.delta)
    return -steering / seen.r


def speed(fastest: float, bend: float, beta: float, exponent: float) -> float:
    """Speed, m/s, that falls with the curvature κ, 1/m, of the way: v = v_max / (1 + β |κ|^λ)."""
    return fastest / (1.0 + beta * math.pow(abs(bend), exponent))


def turning_speed(fastest: float, bend: float, beta: float, exponent: float) -> float:
    """`speed`, m/s, but beyond the curvature at which ω is greatest, κ^λ = 1 / (β (λ - 1)), ω stays there: v = ω / κ.

    Not from the paper, by which ω falls to 0 as κ grows: a robot that must turn sharply would turn ever more slowly.

    Args:
        beta: >= 0. exponent: > 1. The others are those of `speed`.
    """
    if beta * math.pow(abs(bend), exponent) * (exponent - 1.0) <= 1.0:
        return speed(fastest, bend, beta, exponent)
    worst = math.pow(beta * (exponent - 1.0), -1.0 / exponent)
    return speed(fastest, worst, beta, exponent) * worst / abs(bend)


def speed_weight(fastest: float, turn_rate: float, exponent: float) -> float:
    """β, m^λ, with which |ω| = `speed` |κ| just reaches the robot's largest turn rate, rad/s, at its worst curvature.

    Not from the paper. v_max κ / (1 + β κ^λ) is greatest at κ^λ = 1 / (β (λ - 1)), where it is v_max κ (λ - 1) / λ.

    Args:
        fastest: m/s. exponent: λ > 1.
    """
    worst = turn_rate * exponent / (fastest * (exponent - 1.0))
    return 1.0 / ((exponent - 1.0) * math.pow(worst, exponent))


def line_of_sight(approach: float, k1: float, k2: float) -> float:
    """Angle of the line of sight from a straight path, rad, on which the law keeps to `approach`, rad (0..π/2).

    Not from the paper. With the line of sight at φ, θ = -φ and δ = approach - φ; φ is where κ = 0.
    """
    near, far = 0.0, approach
    for _ in range(60):
        middle = 0.5 * (near + far)
        turns_left = curvature(EgocentricPolar(1.0, -middle, approach - middle), k1, k2) > 0.0
        near, far = (near, middle) if turns_left else (middle, far)
    return far
