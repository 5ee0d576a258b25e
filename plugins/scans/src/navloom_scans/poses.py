"""Poses in the plane as rows (3,): x, y, m, heading, rad."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["compose", "pose_of", "relative"]

Floats = NDArray[np.float64]


def compose(a: Floats, b: Floats) -> Floats:
    """Pose b, given relative to pose a, in the frame in which a is given: (3,) x, y, m, heading, rad in [-π, π)."""
    (ax, ay, heading), (bx, by, turned) = a.tolist(), b.tolist()
    c, s = math.cos(heading), math.sin(heading)
    return pose_of(ax + c * bx - s * by, ay + s * bx + c * by, heading + turned)


def pose_of(x: float, y: float, heading: float) -> Floats:
    """(3,) x, y, m, and the heading, rad, wrapped to [-π, π)."""
    turn = math.remainder(heading, math.tau)
    return np.array([x, y, -math.pi if turn == math.pi else turn])


def relative(a: Floats, b: Floats) -> Floats:
    """Pose b relative to pose a: (3,) x, y, m, heading, rad."""
    (ax, ay, heading), (bx, by, turned) = a.tolist(), b.tolist()
    c, s, x, y = math.cos(heading), math.sin(heading), bx - ax, by - ay
    return np.array([c * x + s * y, c * y - s * x, math.remainder(turned - heading, math.tau)])
