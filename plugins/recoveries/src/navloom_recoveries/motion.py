"""Collision check of an arc against sensed points, and the arc that leads back. Pure; SI, base frame."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["edges_of", "gap", "gap_after", "is_free", "margin_of", "turn_back"]

Floats = NDArray[np.float64]

_STEPS = 8
_CLOSER = 0.005
"""How much closer a robot that starts within its margin may still come, m."""
_LEAST = 0.005
"""Least margin to an echo without noise, m."""


def edges_of(footprint: Floats) -> Floats:
    """(n, 3) outward normal and distance, m, of each edge of a footprint (n, 2), m, convex, counter-clockwise."""
    along = np.roll(footprint, -1, axis=0) - footprint
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
    return np.column_stack([normals, (normals * footprint).sum(axis=1)])


def gap(points: Floats, edges: Floats) -> float:
    """Lower bound of the least distance, m, of points (k, 2) from the footprint; negative inside."""
    if not len(points):
        return math.inf
    outside = edges[:, :2] @ points.T - edges[:, 2:]
    return float(outside.max(axis=0).min())


def margin_of(points: Floats, edges: Floats, wished: float, noise: float) -> float:
    """Margin, m, to keep to points (k, 2): the wished one, or less where the robot is already closer.

    The least of many noisy distances varies from scan to scan; it may be too short by up to `noise`, m.
    """
    # Or a robot that is already too close could make no move at all.
    return max(_LEAST - noise, min(wished, gap(points, edges) - _CLOSER - 0.5 * noise))


def is_free(points: Floats, edges: Floats, v: float, w: float, horizon: float, margin: float) -> bool:
    """Whether the footprint keeps a margin, m, to points (k, 2) on an arc at v, m/s, and w, rad/s, up to a time, s."""
    return all(gap_after(points, edges, v, w, horizon * step / _STEPS) >= margin for step in range(1, _STEPS + 1))


def gap_after(points: Floats, edges: Floats, v: float, w: float, time: float) -> float:
    """Least distance, m, of points (k, 2) from the footprint after a time, s, on an arc at v, m/s, and w, rad/s."""
    turn = w * time
    if abs(w) > 1e-9:
        x, y = v / w * math.sin(turn), v / w * (1.0 - math.cos(turn))
    else:
        x, y = v * time, 0.0
    cos, sin = math.cos(turn), math.sin(turn)
    dx, dy = points[:, 0] - x, points[:, 1] - y
    return gap(np.stack([cos * dx + sin * dy, cos * dy - sin * dx], axis=1), edges)


def turn_back(trail: Floats, pose: tuple[float, float, float], speed: float, look: float) -> float | None:
    """Turn rate, rad/s, of the arc that leads backwards to the latest trail point at least `look`, m, away.

    None where the trail has no such point, or the point is ahead of the robot.

    Args:
        trail: (k, 3) x, y, m, heading, rad: past poses of the robot, oldest first.
        pose: x, y, m, heading, rad, in the frame of the trail.
        speed: Backward speed, m/s, > 0.
        look: Look-back distance, m.
    """
    x, y, heading = pose
    gaps = np.hypot(trail[:, 0] - x, trail[:, 1] - y)
    if not len(gaps):
        return None
    far = np.flatnonzero(gaps[: int(np.argmin(gaps)) + 1] >= look)  # points after the nearest one are ahead
    if not len(far):
        return None
    dx, dy = trail[far[-1], 0] - x, trail[far[-1], 1] - y
    ahead = dx * math.cos(heading) + dy * math.sin(heading)
    left = dy * math.cos(heading) - dx * math.sin(heading)
    if ahead >= 0.0:
        return None
    return float(-speed * 2.0 * left / (ahead * ahead + left * left))
