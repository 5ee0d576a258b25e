"""Regulated pure pursuit: Macenski, Singh, Martín, Ginés, *Regulated Pure Pursuit for Robot Path Tracking*, Autonomous
Robots 47, 2023 (arXiv 2305.20026), on Coulter, *Implementation of the Pure Pursuit Path Tracking Algorithm*, 1992.

The robot drives on the arc to a point of the path at the look-ahead distance. A trajectory is an array (n, 6) of arc
length, m, in equal steps, x, y, m, heading, rad, curvature, 1/m, and speed, m/s.
"""

from __future__ import annotations

import math

import numpy as np
from navloom_lyapunov_tracker.law import wrap
from numpy.typing import NDArray

__all__ = [
    "curvature_speed",
    "look_ahead",
    "proximity_speed",
    "pursuit_curvature",
    "pursuit_point",
    "pursuit_pose",
    "reaching",
]

Floats = NDArray[np.float64]

_WINDOW = 2.0
"""Arc length within which the point is searched, in look-aheads; short enough to miss the other leg of a hairpin."""


def look_ahead(speed: float, gain: float, least: float, most: float) -> float:
    """Look-ahead distance, m: L = l v of the adaptive variant, within bounds.

    Args:
        speed: Speed of the robot, m/s.
        gain: l, s.
        least, most: m, > 0.
    """
    return min(max(gain * speed, least), most)


def reaching(distance: float, cross_track: float, approach: float) -> float:
    """Extend the look-ahead, m, so that the point is at most `approach`, rad (0..π/2), off the path's direction.

    Not from the paper; exact for a straight path.

    Args:
        distance: Look-ahead, m.
        cross_track: Distance of the robot from the path, m.
    """
    return max(distance, abs(cross_track) / math.sin(approach))


def pursuit_curvature(ahead: float, left: float) -> float:
    """Curvature, 1/m, of the arc to a point, m, base frame: κ = 2 y / L², Coulter 1992; 0 for the base itself."""
    square = ahead * ahead + left * left
    return 2.0 * left / square if square > 1e-12 else 0.0


def curvature_speed(speed: float, curvature: float, radius: float, least: float) -> float:
    """Speed, m/s, reduced in arcs tighter than a radius, m: v / (r_min |κ|) where |κ| > 1 / r_min; not below `least`.

    A speed already below `least` is unchanged.
    """
    return min(speed, max(speed / max(radius * abs(curvature), 1.0), least))


def proximity_speed(speed: float, distance: float, within: float, least: float) -> float:
    """Speed, m/s, reduced in proportion to a distance, m, below `within`, m: v d / d_prox; not below `least`.

    A speed already below `least` is unchanged.
    """
    return min(speed, max(speed * min(max(distance, 0.0) / within, 1.0), least))


def pursuit_point(samples: Floats, progress: float, x: float, y: float, distance: float) -> tuple[float, float]:
    """Point of `pursuit_pose`, m."""
    return pursuit_pose(samples, progress, x, y, distance)[:2]


def pursuit_pose(samples: Floats, progress: float, x: float, y: float, distance: float) -> tuple[float, float, float]:
    """First point after the robot's foot point that is one look-ahead away from the robot, m, and its heading, rad.

    The trajectory is extended straight beyond its end, so that the last arcs do not become tight. If no point is far
    enough, the result is the farthest one within two look-aheads; if the foot point itself is farther, the foot point.

    Args:
        samples: (n, 6) trajectory, n >= 1.
        progress: Arc length of the foot point, m.
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
        return _pose(window[k])
    return _beyond(samples[last], x, y, distance)


def _pose(sample: Floats) -> tuple[float, float, float]:
    return float(sample[1]), float(sample[2]), float(sample[3])


def _crossing(window: Floats, gaps: Floats, k: int, distance: float) -> tuple[float, float, float]:
    """Pose at which the gap reaches the distance, between samples k - 1 and k."""
    if k == 0:
        return _pose(window[0])
    share = float((distance - gaps[k - 1]) / (gaps[k] - gaps[k - 1]))
    (x, y, heading), (x_after, y_after, heading_after) = _pose(window[k - 1]), _pose(window[k])
    return x + share * (x_after - x), y + share * (y_after - y), wrap(heading + share * wrap(heading_after - heading))


def _beyond(end: Floats, x: float, y: float, distance: float) -> tuple[float, float, float]:
    """Pose at the distance on the straight line beyond the end; the end itself is nearer."""
    cos, sin = math.cos(end[3]), math.sin(end[3])
    dx, dy = float(end[1]) - x, float(end[2]) - y
    along = dx * cos + dy * sin
    further = math.sqrt(along * along + distance * distance - dx * dx - dy * dy) - along
    return float(end[1]) + further * cos, float(end[2]) + further * sin, float(end[3])
