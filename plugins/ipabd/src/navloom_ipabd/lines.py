"""Extract line segments from the points of objects: iterative end-point fit, merge, total least squares."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["distances_to_segments", "extract_lines", "fresh_segments", "warm_up"]

Floats = NDArray[np.float64]


def extract_lines(points: Floats, starts: NDArray[np.int64], tolerance: float) -> Floats:
    """Segments of all objects. Every point lies within `tolerance` of a segment.

    Split (iterative end-point fit): an object is cut at the point farthest from its chord, as long as that point is
    farther than `tolerance`. The distance is to the chord as a segment, so that a spike along the chord counts too.
    Both parts keep the point, so that corners stay closed.

    Merge: neighbouring parts of one object become one if together they lie within `tolerance` of one line. Objects are
    never joined, since a gap between them may be a door.

    Refit: the line of each part is its total least squares fit, from the projection of one extreme point to that of
    the other. If the fit leaves a point farther than `tolerance`, the chord is used.

    An object of one point gives a segment of zero length, and one of two points the segment between them, so that posts
    are kept.

    Args:
        points: (n, 2) x, y, m, in order of azimuth.
        starts: (objects + 1,) result of `segment_starts`.
        tolerance: T, m.

    Returns:
        (segments, 4) x1, y1, x2, y2, m, in order of azimuth.
    """
    segments: Floats = _extract(np.ascontiguousarray(points), np.ascontiguousarray(starts, dtype=np.int64), tolerance)
    return segments


def distances_to_segments(points: Floats, segments: Floats) -> Floats:
    """Distance of each point to the nearest segment.

    Args:
        points: (n, 2) m.
        segments: (m, 4) x1, y1, x2, y2, m; the length may be zero.

    Returns:
        (n,) m; +inf if there are no segments.
    """
    start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    length2 = np.maximum((along**2).sum(axis=1), 1e-300)
    offsets = points[:, None, :] - start[None]
    share = np.clip((offsets * along).sum(axis=2) / length2, 0.0, 1.0)
    gaps: Floats = np.linalg.norm(offsets - share[..., None] * along, axis=2).min(axis=1, initial=math.inf)
    return gaps


def fresh_segments(known: Floats, new: Floats, tolerance: float) -> Floats:
    """Union of known and new segments, without those that are contained in a segment of the other set.

    A segment is contained in another if both its ends lie within `tolerance` of it. Repeated sweeps of a static scene
    therefore keep a bounded number of segments.

    Args:
        known, new: (n, 4) and (m, 4) x1, y1, x2, y2, m.

    Returns:
        (k, 4).
    """
    added = new[~_are_contained(new, known, tolerance)]
    return np.concatenate([known[~_are_contained(known, added, tolerance)], added])


def _are_contained(inner: Floats, outer: Floats, tolerance: float) -> NDArray[np.bool_]:
    contained = np.zeros(len(inner), dtype=np.bool_)
    for segment in outer:
        one = segment[None]
        ends = np.maximum(distances_to_segments(inner[:, :2], one), distances_to_segments(inner[:, 2:], one))
        contained |= ends <= tolerance
    return contained


@njit(cache=True, nogil=True)
def _extract(points: Floats, starts: NDArray[np.int64], tolerance: float) -> Floats:
    """Split, merge and refit each object; the result has at most one segment per point."""
    segments = np.empty((max(points.shape[0], 1), 4))
    count = 0
    for i in range(starts.size - 1):
        first, last = starts[i], starts[i + 1] - 1
        corners = _split(points, first, last, tolerance)
        here = corners[0]
        for c in range(1, corners.size):
            is_final = c == corners.size - 1
            if not is_final and _total_least_squares(points, here, corners[c + 1])[0] <= tolerance:
                continue
            worst, segment = _total_least_squares(points, here, corners[c])
            a, b = points[here], points[corners[c]]
            # Value by value: to assign a whole row compiles numba's message for unequal shapes, 2 s.
            x1, y1, x2, y2 = segment if worst <= tolerance else (a[0], a[1], b[0], b[1])
            segments[count, 0], segments[count, 1], segments[count, 2], segments[count, 3] = x1, y1, x2, y2
            count += 1
            here = corners[c]
    return segments[:count].copy()


@njit(cache=True, nogil=True)
def _split(points: Floats, first: int, last: int, tolerance: float) -> NDArray[np.int64]:
    """Increasing indices of the corners, including both ends."""
    is_corner = np.zeros(last - first + 1, dtype=np.bool_)
    is_corner[0] = is_corner[last - first] = True
    stack = [(first, last)]
    while len(stack) > 0:
        a, b = stack.pop()
        worst, place = tolerance, -1
        for i in range(a + 1, b):
            distance = _distance_to_chord(points[a], points[b], points[i])
            if distance > worst:
                worst, place = distance, i
        if place >= 0:
            is_corner[place - first] = True
            stack.append((a, place))
            stack.append((place, b))
    corners = np.flatnonzero(is_corner) + first
    return corners if corners.size > 1 else np.array([first, first])


@njit(cache=True, nogil=True)
def _distance_to_chord(a: Floats, b: Floats, p: Floats) -> float:
    """Distance of p to the segment from a to b."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    length2 = dx * dx + dy * dy
    share = 0.0
    if length2 > 0.0:
        share = min(1.0, max(0.0, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / length2))
    return math.hypot(p[0] - a[0] - share * dx, p[1] - a[1] - share * dy)


@njit(cache=True, nogil=True)
def _total_least_squares(points: Floats, first: int, last: int) -> tuple[float, tuple[float, float, float, float]]:
    """Largest distance of points[first:last + 1] to their fitted line, and the segment on it, x1, y1, x2, y2."""
    n = last - first + 1
    mean_x = points[first : last + 1, 0].sum() / n
    mean_y = points[first : last + 1, 1].sum() / n
    xx = xy = yy = 0.0
    for i in range(first, last + 1):
        dx, dy = points[i, 0] - mean_x, points[i, 1] - mean_y
        xx, xy, yy = xx + dx * dx, xy + dx * dy, yy + dy * dy
    direction = 0.5 * math.atan2(2.0 * xy, xx - yy)
    ux, uy = math.cos(direction), math.sin(direction)
    worst, low, high = 0.0, np.inf, -np.inf
    for i in range(first, last + 1):
        dx, dy = points[i, 0] - mean_x, points[i, 1] - mean_y
        worst = max(worst, abs(ux * dy - uy * dx))
        low, high = min(low, ux * dx + uy * dy), max(high, ux * dx + uy * dy)
    if ux * (points[last, 0] - points[first, 0]) + uy * (points[last, 1] - points[first, 1]) < 0.0:
        low, high = high, low
    return worst, (mean_x + low * ux, mean_y + low * uy, mean_x + high * ux, mean_y + high * uy)


def warm_up() -> None:
    """Compile the kernels."""
    extract_lines(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]), np.array([0, 3]), 0.06)
