"""Which beams of a planar fan can hit which obstacle: a fast, conservative test before the exact intersection.

The test enlarges every obstacle, in metres and in bearing, by far more than rounding can shift an intersection. A beam
that it leaves out would miss the obstacle in the exact intersection too, so leaving it out changes no bit of a scan.
"""

from __future__ import annotations

import math

from numba import njit

__all__ = ["beam_spans"]

_MARGIN = 1e-6
"""Enlargement of obstacles, m and rad. Rounding shifts intersections by some 1e-9 m for coordinates below 1e6 m."""
_ALL_AROUND = 8.0
"""Sector width of an obstacle that contains the sensor, rad: more than a full turn."""
_NOWHERE = -1.0
"""Sector width of an obstacle out of reach."""


@njit(cache=True, nogil=True, error_model="numpy")
def beam_spans(origin, first_bearing, step, count, reach, obstacles, spans):  # type: ignore[no-untyped-def]
    """Beams that can hit each box and cylinder; all others miss it.

    Args:
        origin: (3,) common start of the beams, m, map frame; the beams are level.
        first_bearing, step: Bearing of beam 0 in the map frame and from each beam to the next, rad; step > 0.
        count: Number of beams; less than a turn from the first to the last.
        reach: Obstacles farther away than this cannot be hit, m.
        obstacles: What can be hit; the raster is ignored.
        spans: (boxes + cylinders, 4) int64, filled: the beams spans[k, 0] to spans[k, 1] - 1 and, for a sector that
            contains beam 0, spans[k, 2] to spans[k, 3] - 1. An empty span may end before it begins.
    """
    x, y, z = origin[0], origin[1], origin[2]
    boxes, cylinders = obstacles.boxes, obstacles.cylinders
    for k in range(boxes.shape[0]):
        right, width = 0.0, _NOWHERE
        if boxes[k, 8] != 0.0 and _is_level(z, boxes[k, 4], boxes[k, 5]):
            right, width = _box_sector(x, y, reach, boxes, k)
        _to_beams(right - first_bearing, width, step, count, spans, k)
    for k in range(cylinders.shape[0]):
        right, width = 0.0, _NOWHERE
        if cylinders[k, 5] != 0.0 and _is_level(z, cylinders[k, 3], cylinders[k, 4]):
            right, width = _cylinder_sector(x, y, reach, cylinders, k)
        _to_beams(right - first_bearing, width, step, count, spans, boxes.shape[0] + k)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _is_level(z, z0, z1):  # type: ignore[no-untyped-def]
    """Whether a level beam at height z can lie between two heights, in either order as for the intersections."""
    return min(z0, z1) - _MARGIN <= z <= max(z0, z1) + _MARGIN


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _cylinder_sector(x, y, reach, cylinders, k):  # type: ignore[no-untyped-def]
    """Bearing of the right edge of a cylinder seen from (x, y), rad, and its angular width, rad."""
    ahead_x, ahead_y, radius = cylinders[k, 0] - x, cylinders[k, 1] - y, abs(cylinders[k, 2]) + _MARGIN
    away = math.sqrt(ahead_x * ahead_x + ahead_y * ahead_y)
    if away - radius > reach:
        return 0.0, _NOWHERE
    if not away > radius:
        return 0.0, _ALL_AROUND
    half = math.asin(radius / away)
    return math.atan2(ahead_y, ahead_x) - half, 2.0 * half


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _box_sector(x, y, reach, boxes, k):  # type: ignore[no-untyped-def]
    """Bearing of the right edge of a box seen from (x, y), rad, and its angular width, rad.

    The viewpoint is mirrored into the quadrant where both coordinates are positive; two corners then bound the box.
    """
    hx, hy, c, s = abs(boxes[k, 2]) + _MARGIN, abs(boxes[k, 3]) + _MARGIN, boxes[k, 6], boxes[k, 7]
    dx, dy = x - boxes[k, 0], y - boxes[k, 1]
    px, py = c * dx + s * dy, c * dy - s * dx
    side_x, side_y = (1.0 if px >= 0.0 else -1.0), (1.0 if py >= 0.0 else -1.0)
    px, py = abs(px), abs(py)
    beyond_x, beyond_y = px > hx, py > hy
    gap_x, gap_y = (px - hx if beyond_x else 0.0), (py - hy if beyond_y else 0.0)
    if gap_x * gap_x + gap_y * gap_y > reach * reach:
        return 0.0, _NOWHERE
    if not (beyond_x or beyond_y):
        return 0.0, _ALL_AROUND
    ax, ay = side_x * ((-hx if beyond_y else hx) - px), side_y * (hy - py)
    bx, by = side_x * (hx - px), side_y * ((-hy if beyond_x else hy) - py)
    right, left = math.atan2(s * ax + c * ay, c * ax - s * ay), math.atan2(s * bx + c * by, c * bx - s * by)
    if side_x != side_y:
        right, left = left, right
    return right, (left - right if left >= right else left - right + 2.0 * math.pi)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _to_beams(right, width, step, count, spans, k):  # type: ignore[no-untyped-def]
    """Writes the spans of a sector that begins at `right`, rad from beam 0, and is `width` wide, rad."""
    if width < 0.0:
        spans[k, :] = 0
        return
    begin = right - _MARGIN
    begin -= 2.0 * math.pi * math.floor(begin / (2.0 * math.pi))
    end = begin + width + 2.0 * _MARGIN
    for turn in range(2):
        # The comparisons are written so that NaN rules no beam out.
        low, high = (begin - turn * 2.0 * math.pi) / step, (end - turn * 2.0 * math.pi) / step
        low, high = (low if low > 0.0 else 0.0), (high if high < count - 1.0 else count - 1.0)
        spans[k, 2 * turn] = math.ceil(low if low < count else float(count))
        spans[k, 2 * turn + 1] = math.floor(high if high > -1.0 else -1.0) + 1
