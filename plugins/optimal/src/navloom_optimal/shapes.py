"""Boxes and cylinders among which a disc moves, and the limits that each sets to it.

Contact is free, within `TOLERANCE`. For many shapes see `buckets`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from navloom.geometry.compiled import compiled
from numpy.typing import NDArray

__all__ = ["TOLERANCE", "Shapes", "gap_to", "is_near_segment", "to_segment_squared"]

Floats = NDArray[np.float64]

TOLERANCE = 1e-7
"""Largest overlap of the disc with an obstacle that still counts as contact, m."""


@dataclass(frozen=True, eq=False)
class Shapes:
    """Obstacles and the disc's radius.

    Attributes:
        boxes: (k, 6) centre x, y, half extents, cosine and sine of the turn, m, before inflation.
        discs: (m, 3) centre x, y and radius, m, before inflation.
        radius: Radius of the moving disc, m.
    """

    boxes: Floats
    discs: Floats
    radius: float


@compiled
def gap_to(k: int, x: float, y: float, boxes: Floats, discs: Floats, radius: float) -> float:
    """Distance of the disc's rim from shape k, boxes first, m; negative if they overlap."""
    count = boxes.shape[0]
    if k < count:
        dx, dy = x - boxes[k, 0], y - boxes[k, 1]
        along = abs(boxes[k, 4] * dx + boxes[k, 5] * dy) - boxes[k, 2]
        across = abs(boxes[k, 4] * dy - boxes[k, 5] * dx) - boxes[k, 3]
        return float(math.hypot(max(along, 0.0), max(across, 0.0)) - radius)
    m = k - count
    return float(math.hypot(x - discs[m, 0], y - discs[m, 1]) - discs[m, 2] - radius)


@compiled
def to_segment_squared(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
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
        if to_segment_squared(x, y, ax, ay, bx, by) < squared:
            return True
        side = dx * (y - ay) - dy * (x - ax)
        lowest, highest = min(lowest, side), max(highest, side)
    # If no end and no corner is near, the segment is near only if it passes through the rectangle.
    through_x = min(ax, bx) < hx and max(ax, bx) > -hx
    through_y = min(ay, by) < hy and max(ay, by) > -hy
    return through_x and through_y and lowest < 0.0 < highest


@compiled
def is_near_segment(
    k: int, ax: float, ay: float, bx: float, by: float, boxes: Floats, discs: Floats, radius: float
) -> bool:
    """Whether shape k, boxes first, blocks the disc on a segment."""
    count = boxes.shape[0]
    if k >= count:
        m = k - count
        reach = discs[m, 2] + radius - TOLERANCE
        return bool(to_segment_squared(discs[m, 0], discs[m, 1], ax, ay, bx, by) < reach * reach)
    cosine, sine = boxes[k, 4], boxes[k, 5]
    dax, day, dbx, dby = ax - boxes[k, 0], ay - boxes[k, 1], bx - boxes[k, 0], by - boxes[k, 1]
    return _rectangle_is_near(
        boxes[k, 2],
        boxes[k, 3],
        cosine * dax + sine * day,
        cosine * day - sine * dax,
        cosine * dbx + sine * dby,
        cosine * dby - sine * dbx,
        radius - TOLERANCE,
    )
