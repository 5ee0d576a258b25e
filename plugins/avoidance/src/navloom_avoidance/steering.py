"""Directions, and the turn rate towards one."""

import math

__all__ = ["TURN", "turn_rate", "wrap"]

TURN = 2.0 * math.pi


def wrap(angle: float) -> float:
    """The angle in [-pi, pi), rad."""
    return (angle + math.pi) % TURN - math.pi


def turn_rate(direction: float, heading: float, gain: float, limit: float) -> float:
    """Turn rate proportional to the heading error: omega = gain (theta_d - theta), |omega| <= limit.

    Hoang et al. 2013, III.C: gain 10 1/s, limit 25 deg/s. Borenstein & Koren 1989: K_s (delta - theta). Limit and
    result in rad/s.
    """
    return max(-limit, min(limit, gain * wrap(direction - heading)))
