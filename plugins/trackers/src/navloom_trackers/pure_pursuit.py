"""Regulated pure pursuit: Macenski, Singh, Martín, Ginés, *Regulated Pure Pursuit for Robot Path Tracking*, Autonomous
Robots 47, 2023 (arXiv 2305.20026), on Coulter, *Implementation of the Pure Pursuit Path Tracking Algorithm*, 1992.

The robot drives the arc to a point of the path, one look-ahead away. A trajectory is an array (n, 6) of arc length,
m, in equal steps, x, y, m, heading, rad, curvature, 1/m, and speed, m/s.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["curvature_speed", "look_ahead", "proximity_speed", "pursuit_curvature", "pursuit_point", "reaching"]

Floats = NDArray[np.float64]

_WINDOW = 2.0
"""Look-aheads of arc length within which the point is searched: no other leg of a hairpin is in sight by then."""


def look_ahead(speed: float, gain: float, least: float, most: float) -> float:
    """Look-ahead distance, m: L = l v of the adaptive variant, within bounds.

    Args:
        speed: Of the robot, m/s.
        gain: l, s.
        least, most: m, > 0.
    """
    return min(max(gain * speed, least), most)


def reaching(distance: float, cross_track: float, approach: float) -> float:
    """The look-ahead, m, made so long that the point is no more than `approach`, rad (0..π/2), aside. Ours.

    Args:
        distance: Look-ahead, m.
        cross_track: Of the robot, m.
    """
    return max(distance, abs(cross_track) / math.sin(approach))


def pursuit_curvature(ahead: float, left: float) -> float:
    """Curvature, 1/m, of the arc to a point, m, in the base frame: κ = 2 y / L², Coulter 1992. 0 to the base itself."""
    square = ahead * ahead + left * left
    return 2.0 * left / square if square > 1e-12 else 0.0


def curvature_speed(speed: float, curvature: float, radius: float, least: float) -> float:
    """Speed, m/s, slowed in arcs tighter than a radius, m: v / (r_min |κ|) where |κ| > 1 / r_min; not below `least`.

    A speed that is below `least` already stays as it is.
    """
    return min(speed, max(speed / max(radius * abs(curvature), 1.0), least))


def proximity_speed(speed: float, distance: float, within: float, least: float) -> float:
    """Speed, m/s, slowed in proportion to a distance, m, below `within`, m: v d / d_prox; not below `least`.

    A speed that is below `least` already stays as it is.
    """
    return min(speed, max(speed * min(max(distance, 0.0) / within, 1.0), least))


def pursuit_point(samples: Floats, progress: float, x: float, y: float, distance: float) -> tuple[float, float]:
    """The first point after the robot's foot that is one look-ahead away from it, m.

    Beyond its end the trajectory goes on straight, so that the last arcs do not become tight. Where nothing is as far
    away, it is the farthest point within two look-aheads; where the foot itself is farther, the foot.

    Args:
        samples: (n, 6) trajectory, n >= 1.
        progress: Arc length of the foot, m.
        x, y: Robot, m, in the frame of the samples.
        distance: Look-ahead, m, > 0.
    """
    last = len(samples) - 1
    step = float(samples[last, 0]) / last if last else 1.0
    first = min(int(progress / step), last)
    window = samples[first : min(first + math.ceil(_WINDOW * distance / step), last) + 1]
    gaps = np.hypot(window[:, 1] - x, window[:, 2] - y)
    k = int(np.argmax(gaps >= distance))
    if gaps[k] >= distance:
        return _crossing(window, gaps, k, distance)
    if first + len(window) <= last:
        k = int(np.argmax(gaps))
        return float(window[k, 1]), float(window[k, 2])
    return _beyond(samples[last], x, y, distance)


def _crossing(window: Floats, gaps: Floats, k: int, distance: float) -> tuple[float, float]:
    """Where the gap reaches the distance, between samples k - 1 and k."""
    if k == 0:
        return float(window[0, 1]), float(window[0, 2])
    share = float((distance - gaps[k - 1]) / (gaps[k] - gaps[k - 1]))
    (x, y), (x_after, y_after) = window[k - 1, 1:3].tolist(), window[k, 1:3].tolist()
    return x + share * (x_after - x), y + share * (y_after - y)


def _beyond(end: Floats, x: float, y: float, distance: float) -> tuple[float, float]:
    """The point on the straight line from the end on that is as far away; the end is nearer than that."""
    cos, sin = math.cos(end[3]), math.sin(end[3])
    dx, dy = float(end[1]) - x, float(end[2]) - y
    along = dx * cos + dy * sin
    further = math.sqrt(along * along + distance * distance - dx * dx - dy * dy) - along
    return float(end[1]) + further * cos, float(end[2]) + further * sin
