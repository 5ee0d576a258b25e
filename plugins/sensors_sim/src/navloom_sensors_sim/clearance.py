"""Gap between a convex footprint and upright boxes, vertical cylinders and one raster, in the plane.

An obstacle counts if its height interval overlaps that of the robot, 0..height. Gaps to boxes and cylinders are exact
at any distance. Gaps to a raster are exact below `RASTER_CAP`; beyond it the result is the cap, a lower bound.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_sensors_sim.casting import NOTHING, Obstacles

__all__ = ["RASTER_CAP", "TOUCHING", "clearance_at", "footprint_gap"]

Floats = NDArray[np.float64]

RASTER_CAP = 2.0
"""Largest gap to a raster that is measured, m."""
TOUCHING = 1e-9
"""Largest gap of two shapes that touch, m: rounding alone must not separate them."""
_ROUNDING = 1e-6
"""More than rounding shifts a lower bound of a gap, m."""
_HALF_DIAGONAL = 0.7071067811865476


def footprint_gap(
    pose: tuple[float, float, float], footprint: Floats, height: float, obstacles: Obstacles
) -> tuple[float, int]:
    """Gap between the footprint at a pose and the nearest obstacle.

    Args:
        pose: x, y, m, and heading, rad, of the base in the map frame.
        footprint: (n, 2) corners of a convex polygon, counter-clockwise, m, base frame.
        height: Height of the robot, m.
        obstacles: What the footprint can touch.

    Returns:
        The gap, m, 0 if they touch or overlap, +inf without obstacles; and the obstacle's index or NOTHING.
    """
    corners = np.ascontiguousarray(footprint, dtype=np.float64)
    gap, index = clearance_at(pose[0], pose[1], pose[2], corners, height, obstacles)
    return gap, index


@njit(cache=True, nogil=True, error_model="numpy")
def clearance_at(x, y, heading, footprint, height, obstacles):  # type: ignore[no-untyped-def]
    """`footprint_gap`, for use inside kernels: returns (gap, m; index)."""
    count = footprint.shape[0]
    corners = np.empty((count, 2))
    c, s = math.cos(heading), math.sin(heading)
    mid_x, mid_y, reach = 0.0, 0.0, 0.0
    for i in range(count):
        corners[i, 0] = x + c * footprint[i, 0] - s * footprint[i, 1]
        corners[i, 1] = y + s * footprint[i, 0] + c * footprint[i, 1]
        mid_x += corners[i, 0] / count
        mid_y += corners[i, 1] / count
    for i in range(count):
        reach = max(reach, math.hypot(corners[i, 0] - mid_x, corners[i, 1] - mid_y))
    best, nearest = np.inf, NOTHING
    boxes, cylinders = obstacles.boxes, obstacles.cylinders
    quad = np.empty((4, 2))
    for k in range(boxes.shape[0]):
        if boxes[k, 8] != 0.0 and boxes[k, 4] < height and boxes[k, 5] > 0.0:
            # Lower bounds sort out most boxes without their corners, and in large worlds most without a root.
            size = abs(boxes[k, 2]) + abs(boxes[k, 3])
            if _is_beyond(mid_x - boxes[k, 0], mid_y - boxes[k, 1], size + reach, best):
                continue
            if _to_box(mid_x, mid_y, boxes, k) - reach >= best:
                continue
            _box_corners(boxes, k, quad)
            gap = _convex_gap(corners, quad)
            if gap < best:
                best, nearest = gap, k
    for k in range(cylinders.shape[0]):
        if cylinders[k, 5] != 0.0 and cylinders[k, 3] < height and cylinders[k, 4] > 0.0:
            if _is_beyond(mid_x - cylinders[k, 0], mid_y - cylinders[k, 1], abs(cylinders[k, 2]) + reach, best):
                continue
            gap = max(_to_polygon(cylinders[k, 0], cylinders[k, 1], corners) - cylinders[k, 2], 0.0)
            if gap < best:
                best, nearest = gap, boxes.shape[0] + k
    frame = obstacles.raster
    if obstacles.gaps.size and frame[5] < height and frame[6] > 0.0:
        gap = _raster_gap(mid_x, mid_y, reach, corners, min(best, RASTER_CAP), obstacles.gaps, frame)
        if gap < best:
            best = gap
            # At the cap, only a bound is known, and no obstacle.
            nearest = boxes.shape[0] + cylinders.shape[0] if gap < RASTER_CAP else NOTHING
    return (0.0 if best <= TOUCHING else best), nearest


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _is_beyond(dx, dy, size, best):  # type: ignore[no-untyped-def]
    """Whether two things of this size together, m, with middles (dx, dy) m apart, are certainly `best`, m, apart."""
    return max(abs(dx), abs(dy)) - size > best + _ROUNDING


@njit(cache=True, nogil=True, error_model="numpy")
def _to_box(x, y, boxes, k):  # type: ignore[no-untyped-def]
    """Distance from a point to box k in the plane, m; 0 inside."""
    px, py, c, s = x - boxes[k, 0], y - boxes[k, 1], boxes[k, 6], boxes[k, 7]
    out_x = max(abs(c * px + s * py) - boxes[k, 2], 0.0)
    out_y = max(abs(c * py - s * px) - boxes[k, 3], 0.0)
    return math.sqrt(out_x * out_x + out_y * out_y)


@njit(cache=True, nogil=True, error_model="numpy")
def _box_corners(boxes, k, quad):  # type: ignore[no-untyped-def]
    """Corners of box k, counter-clockwise, map frame, into (4, 2) `quad`."""
    c, s = boxes[k, 6], boxes[k, 7]
    for i in range(4):
        u = boxes[k, 2] if i == 1 or i == 2 else -boxes[k, 2]
        v = boxes[k, 3] if i >= 2 else -boxes[k, 3]
        quad[i, 0] = boxes[k, 0] + c * u - s * v
        quad[i, 1] = boxes[k, 1] + s * u + c * v


@njit(cache=True, nogil=True, error_model="numpy")
def _squared_to_edges(x, y, corners):  # type: ignore[no-untyped-def]
    """Smallest squared distance from a point to the edges of a polygon, m²."""
    best = np.inf
    count = corners.shape[0]
    j = count - 1
    for i in range(count):
        ax, ay = corners[j, 0], corners[j, 1]
        ex, ey = corners[i, 0] - ax, corners[i, 1] - ay
        length = ex * ex + ey * ey
        share = ((x - ax) * ex + (y - ay) * ey) / length if length > 0.0 else 0.0
        share = min(max(share, 0.0), 1.0)
        dx, dy = ax + share * ex - x, ay + share * ey - y
        best = min(best, dx * dx + dy * dy)
        j = i
    return best


@njit(cache=True, nogil=True, error_model="numpy")
def _to_polygon(x, y, corners):  # type: ignore[no-untyped-def]
    """Distance from a point to a convex counter-clockwise polygon, m; 0 inside."""
    j = corners.shape[0] - 1
    inside = True
    for i in range(corners.shape[0]):
        ex, ey = corners[i, 0] - corners[j, 0], corners[i, 1] - corners[j, 1]
        if ex * (y - corners[j, 1]) - ey * (x - corners[j, 0]) < 0.0:
            inside = False
        j = i
    return 0.0 if inside else math.sqrt(_squared_to_edges(x, y, corners))


@njit(cache=True, nogil=True, error_model="numpy")
def _has_parting_edge(a, b):  # type: ignore[no-untyped-def]
    """Whether all of b lies on the outer side of one edge of the counter-clockwise polygon a."""
    j = a.shape[0] - 1
    for i in range(a.shape[0]):
        ex, ey = a[i, 0] - a[j, 0], a[i, 1] - a[j, 1]
        parts = True
        for k in range(b.shape[0]):
            if ex * (b[k, 1] - a[j, 1]) - ey * (b[k, 0] - a[j, 0]) >= 0.0:
                parts = False
                break
        if parts:
            return True
        j = i
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def _convex_gap(a, b):  # type: ignore[no-untyped-def]
    """Distance between two convex counter-clockwise polygons, m; 0 if they intersect.

    If they do not, the nearest points are on a corner of one and an edge of the other.
    """
    if not _has_parting_edge(a, b) and not _has_parting_edge(b, a):
        return 0.0
    best = np.inf
    for i in range(a.shape[0]):
        best = min(best, _squared_to_edges(a[i, 0], a[i, 1], b))
    for i in range(b.shape[0]):
        best = min(best, _squared_to_edges(b[i, 0], b[i, 1], a))
    return math.sqrt(best)


@njit(cache=True, nogil=True, error_model="numpy")
def _raster_gap(mid_x, mid_y, reach, corners, cap, gaps, frame):  # type: ignore[no-untyped-def]
    """Distance from the polygon to the nearest occupied cell, m, at most `cap`; computed in cells.

    Args:
        mid_x, mid_y: A point inside the polygon, m, map frame.
        reach: Largest distance from that point to a corner, m.
        corners: (n, 2) polygon, m, map frame.
        cap: Distances from this on are not measured, m.
        gaps, frame: `gaps` and `raster` of `Obstacles`.
    """
    c, s, cell = frame[2], frame[3], frame[4]
    rows, cols = gaps.shape
    local = np.empty_like(corners)
    for i in range(corners.shape[0]):
        px, py = corners[i, 0] - frame[0], corners[i, 1] - frame[1]
        local[i, 0], local[i, 1] = (c * px + s * py) / cell, (c * py - s * px) / cell
    px, py = mid_x - frame[0], mid_y - frame[1]
    x, y = (c * px + s * py) / cell, (c * py - s * px) / cell
    best, reach = cap / cell, reach / cell
    # The distance from the cell nearest to the middle to the nearest occupied centre bounds the gap from both sides.
    col, row = min(max(int(x), 0), cols - 1), min(max(int(y), 0), rows - 1)
    offset = math.hypot(col + 0.5 - x, row + 0.5 - y)
    if gaps[row, col] - offset - _HALF_DIAGONAL - reach >= best:
        return cap
    span = min(best, gaps[row, col] + offset) + reach + _HALF_DIAGONAL
    found = _nearest_cell(x, y, reach, local, best, span, gaps)
    return found * cell if found < best else cap


@njit(cache=True, nogil=True, error_model="numpy")
def _nearest_cell(x, y, reach, corners, best, span, gaps):  # type: ignore[no-untyped-def]
    """Distance from the polygon to the occupied cells within `span` of its middle, at most `best`; all in cells."""
    rows, cols = gaps.shape
    quad = np.empty((4, 2))
    last = min(int(x + span) + 2, cols)
    for r in range(max(int(y - span), 0), min(int(y + span) + 2, rows)):
        k = max(int(x - span), 0)
        while k < last:
            gap = gaps[r, k]
            if gap > 0.0:  # no occupied centre within `gap` cells, so none in this row either
                k += math.ceil(gap)
                continue
            if math.hypot(k + 0.5 - x, r + 0.5 - y) - _HALF_DIAGONAL - reach < best:
                quad[0, 0], quad[0, 1], quad[1, 0], quad[1, 1] = k, r, k + 1.0, r
                quad[2, 0], quad[2, 1], quad[3, 0], quad[3, 1] = k + 1.0, r + 1.0, k, r + 1.0
                best = min(best, _convex_gap(corners, quad))
            k += 1
    return best
