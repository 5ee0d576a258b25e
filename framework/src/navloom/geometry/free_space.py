"""Where the centre of a disc may be, and whether it stays free along segments and arcs: among boxes and cylinders.

Contact is free, to within `TOLERANCE`. On a building's map: see `field_space`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.compiled import compiled

__all__ = ["TOLERANCE", "ShapeSpace", "Shapes", "Space", "shape_gap"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

TOLERANCE = 1e-7
"""How far the disc may reach into an obstacle and still count as touching it, m."""

_FINEST_ARC = 1e-4
"""Arcs are halved down to this length, m, where they run along an obstacle."""


@dataclass(frozen=True, eq=False)
class Shapes:
    """Obstacles and the disc's radius.

    Attributes:
        boxes: (k, 6) centre x, y, half extents, cosine and sine of the turn, m, before inflation.
        discs: (m, 3) centre x, y and radius, m, before inflation.
        radius: Of the moving disc, m.
    """

    boxes: Floats
    discs: Floats
    radius: float


class Space(Protocol):
    """Where the centre of the disc may be."""

    def points_free(self, points: Floats) -> Bools:
        """(n,) of points (n, 2), m."""
        ...

    def segments_free(self, segments: Floats) -> Bools:
        """(n,) of segments (n, 4) x1, y1, x2, y2, m."""
        ...

    def arcs_free(self, circles: Floats, angles: Floats, owners: Ints) -> Bools:
        """(n,) of arcs on circles (n, 3) x, y, radius, from angles (n, 2) first, last (>= first), rad.

        `owners`: (n,) the obstacle the circle goes round, box first, which is not asked again; -1 for none.
        """
        ...


@dataclass(frozen=True, eq=False)
class ShapeSpace:
    """The plane with boxes and cylinders in it: exact."""

    shapes: Shapes

    def points_free(self, points: Floats) -> Bools:
        """See `Space`."""
        s = self.shapes
        return _points_among_shapes(points, s.boxes, s.discs, s.radius)

    def segments_free(self, segments: Floats) -> Bools:
        """See `Space`."""
        s = self.shapes
        return _segments_among_shapes(segments, s.boxes, s.discs, s.radius)

    def arcs_free(self, circles: Floats, angles: Floats, owners: Ints) -> Bools:
        """See `Space`."""
        s = self.shapes
        return _arcs_among_shapes(circles, angles, owners, s.boxes, s.discs, s.radius)


@compiled
def shape_gap(x: float, y: float, boxes: Floats, discs: Floats, radius: float, skipped: int) -> float:
    """Distance of the disc's rim from the nearest shape, m; negative where they overlap."""
    best = np.inf
    for k in range(boxes.shape[0]):
        if k != skipped:
            dx, dy = x - boxes[k, 0], y - boxes[k, 1]
            along = abs(boxes[k, 4] * dx + boxes[k, 5] * dy) - boxes[k, 2]
            across = abs(boxes[k, 4] * dy - boxes[k, 5] * dx) - boxes[k, 3]
            best = min(best, math.hypot(max(along, 0.0), max(across, 0.0)) - radius)
    for k in range(discs.shape[0]):
        if k + boxes.shape[0] != skipped:
            best = min(best, math.hypot(x - discs[k, 0], y - discs[k, 1]) - discs[k, 2] - radius)
    return best


@compiled
def _points_among_shapes(points: Floats, boxes: Floats, discs: Floats, radius: float) -> Bools:
    free = np.empty(points.shape[0], dtype=np.bool_)
    for n in range(points.shape[0]):
        free[n] = shape_gap(points[n, 0], points[n, 1], boxes, discs, radius, -1) >= -TOLERANCE
    return free


@compiled
def _to_segment_squared(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Squared distance of a point from a segment, m²."""
    dx, dy = bx - ax, by - ay
    squared = dx * dx + dy * dy
    share = 0.0
    if squared > 0.0:
        share = min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / squared))
    return (x - ax - share * dx) ** 2 + (y - ay - share * dy) ** 2


@compiled
def _rectangle_is_near(hx: float, hy: float, ax: float, ay: float, bx: float, by: float, reach: float) -> bool:
    """Whether a segment comes nearer than `reach` to the rectangle |x| <= hx, |y| <= hy (its own frame)."""
    if (
        min(ax, bx) >= hx + reach
        or max(ax, bx) <= -hx - reach
        or min(ay, by) >= hy + reach
        or max(ay, by) <= -hy - reach
    ):
        return False
    squared = reach * reach
    for x, y in ((ax, ay), (bx, by)):
        if max(abs(x) - hx, 0.0) ** 2 + max(abs(y) - hy, 0.0) ** 2 < squared:
            return True
    lowest, highest = np.inf, -np.inf
    dx, dy = bx - ax, by - ay
    for x, y in ((-hx, -hy), (hx, -hy), (hx, hy), (-hx, hy)):
        if _to_segment_squared(x, y, ax, ay, bx, by) < squared:
            return True
        side = dx * (y - ay) - dy * (x - ax)
        lowest, highest = min(lowest, side), max(highest, side)
    # No end and no corner is near: then it is only near if it runs right through.
    through_x = min(ax, bx) < hx and max(ax, bx) > -hx
    through_y = min(ay, by) < hy and max(ay, by) > -hy
    return through_x and through_y and lowest < 0.0 < highest


@compiled
def _segments_among_shapes(segments: Floats, boxes: Floats, discs: Floats, radius: float) -> Bools:
    free = np.ones(segments.shape[0], dtype=np.bool_)
    for n in range(segments.shape[0]):
        ax, ay, bx, by = segments[n, 0], segments[n, 1], segments[n, 2], segments[n, 3]
        for k in range(discs.shape[0]):
            reach = discs[k, 2] + radius - TOLERANCE
            if _to_segment_squared(discs[k, 0], discs[k, 1], ax, ay, bx, by) < reach * reach:
                free[n] = False
                break
        if not free[n]:
            continue
        for k in range(boxes.shape[0]):
            cosine, sine = boxes[k, 4], boxes[k, 5]
            dax, day, dbx, dby = ax - boxes[k, 0], ay - boxes[k, 1], bx - boxes[k, 0], by - boxes[k, 1]
            if _rectangle_is_near(
                boxes[k, 2],
                boxes[k, 3],
                cosine * dax + sine * day,
                cosine * day - sine * dax,
                cosine * dbx + sine * dby,
                cosine * dby - sine * dbx,
                radius - TOLERANCE,
            ):
                free[n] = False
                break
    return free


@compiled
def _arc_is_free(
    x: float, y: float, r: float, first: float, last: float, owner: int, boxes: Floats, discs: Floats, radius: float
) -> bool:
    """Halve an arc until each part is further from the shapes than it is long: distances have slope <= 1."""
    waiting = [(first, last)]
    while len(waiting) > 0:
        low, high = waiting.pop()
        middle = 0.5 * (low + high)
        gap = shape_gap(x + r * math.cos(middle), y + r * math.sin(middle), boxes, discs, radius, owner)
        if gap < -TOLERANCE:
            return False
        half = 0.5 * (high - low) * r
        if gap < half and half > 0.5 * _FINEST_ARC:
            waiting.append((low, middle))
            waiting.append((middle, high))
    return True


@compiled
def _arcs_among_shapes(
    circles: Floats, angles: Floats, owners: Ints, boxes: Floats, discs: Floats, radius: float
) -> Bools:
    free = np.empty(circles.shape[0], dtype=np.bool_)
    for n in range(circles.shape[0]):
        x, y, r = circles[n, 0], circles[n, 1], circles[n, 2]
        free[n] = _arc_is_free(x, y, r, angles[n, 0], angles[n, 1], owners[n], boxes, discs, radius)
    return free
