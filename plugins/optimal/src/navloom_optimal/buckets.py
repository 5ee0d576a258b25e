"""Free space of a disc's centre among many boxes and cylinders, in a grid of buckets.

A bucket holds the shapes that reach into its square when inflated by the disc's radius. A query examines only the
buckets that it touches, so its cost depends on nearby shapes and not on their total number.
"""

from __future__ import annotations

import math

import numpy as np
from navloom.geometry.compiled import compiled
from numpy.typing import NDArray

from navloom_optimal.shapes import TOLERANCE, Shapes, gap_to, is_near_segment

__all__ = ["Buckets", "arc_is_free", "buckets_of", "segment_is_free"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Buckets = tuple[float, float, float, int, int, Ints, Ints, Floats, Floats, float]
"""Shapes sorted by place: corner x, y and edge of the buckets, m, rows, columns,
(rows * columns + 1) offsets into the shape numbers, the shape numbers (boxes first), then the attributes of `Shapes`.
"""

_PER_SHAPE = 2.0
"""Number of buckets for each shape."""
_SLACK = 1e-4
"""Margin of a bucket relative to its edge, so that rounding does not lose a shape at an edge."""
_FINEST_ARC = 1e-4
"""Shortest length to which arcs are halved along an obstacle, m."""


def buckets_of(shapes: Shapes) -> Buckets:
    """Sort shapes into buckets."""
    boxes, discs, radius = shapes.boxes, shapes.discs, shapes.radius
    cosine, sine = np.abs(boxes[:, 4:].T)
    around = cosine * boxes[:, 2] + sine * boxes[:, 3], sine * boxes[:, 2] + cosine * boxes[:, 3]
    reach = np.concatenate([np.stack(around, axis=-1), np.tile(discs[:, 2:], 2)]) + radius
    centres = np.concatenate([boxes[:, :2], discs[:, :2]])
    if not len(centres):
        centres, reach = np.zeros((1, 2)), np.full((1, 2), radius)
    low, high = (centres - reach).min(axis=0), (centres + reach).max(axis=0)
    wide, tall = (high - low).tolist()
    count = _PER_SHAPE * len(centres)
    edge = max(math.sqrt(wide * tall / count), max(wide, tall) / count)
    rows, cols = int(tall / edge) + 1, int(wide / edge) + 1
    counts, numbers = np.zeros(rows * cols, dtype=np.int64), np.empty(0, dtype=np.int64)
    _sort_in(low[0], low[1], edge, rows, cols, counts, numbers, boxes, discs, radius)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    numbers = np.empty(offsets[-1], dtype=np.int64)
    _sort_in(low[0], low[1], edge, rows, cols, offsets[:-1].copy(), numbers, boxes, discs, radius)
    return float(low[0]), float(low[1]), edge, rows, cols, offsets, numbers, boxes, discs, radius


@compiled
def _span(low: float, high: float, origin: float, edge: float, count: int) -> tuple[int, int]:
    """First index and last index + 1 of the `count` buckets that an interval, m, touches."""
    first, last = math.floor((low - origin) / edge), math.floor((high - origin) / edge)
    return int(min(max(first, 0), count)), int(min(max(last + 1, 0), count))


@compiled
def _sort_in(
    x0: float,
    y0: float,
    edge: float,
    rows: int,
    cols: int,
    ends: Ints,
    numbers: Ints,
    boxes: Floats,
    discs: Floats,
    radius: float,
) -> None:
    """Append the number of each shape to each bucket that it reaches into; without `numbers`, only count them.

    A shape belongs to every bucket whose centre is within half a diagonal of it.
    """
    near = (0.5 + 2.0 * _SLACK) * math.sqrt(2.0) * edge
    for k in range(boxes.shape[0] + discs.shape[0]):
        if k < boxes.shape[0]:
            x, y, reach = boxes[k, 0], boxes[k, 1], math.hypot(boxes[k, 2], boxes[k, 3])
        else:
            m = k - boxes.shape[0]
            x, y, reach = discs[m, 0], discs[m, 1], discs[m, 2]
        reach += radius + near
        first_row, last_row = _span(y - reach, y + reach, y0, edge, rows)
        first_col, last_col = _span(x - reach, x + reach, x0, edge, cols)
        for row in range(first_row, last_row):
            for col in range(first_col, last_col):
                if gap_to(k, x0 + (col + 0.5) * edge, y0 + (row + 0.5) * edge, boxes, discs, radius) <= near:
                    if numbers.shape[0] > 0:
                        numbers[ends[row * cols + col]] = k
                    ends[row * cols + col] += 1


@compiled
def segment_is_free(ax: float, ay: float, bx: float, by: float, buckets: Buckets) -> bool:
    """Whether the disc's centre may move along a segment."""
    x0, y0, edge, rows, cols, offsets, numbers, boxes, discs, radius = buckets
    if ay > by:
        ax, ay, bx, by = bx, by, ax, ay
    first_row, last_row = _span(ay, by, y0, edge, rows)
    for row in range(first_row, last_row):
        # Part of the segment within this row of buckets.
        low, high = 0.0, 1.0
        if by > ay:
            low = min(max((y0 + (row - _SLACK) * edge - ay) / (by - ay), 0.0), 1.0)
            high = min(max((y0 + (row + 1 + _SLACK) * edge - ay) / (by - ay), 0.0), 1.0)
        left, right = ax + low * (bx - ax), ax + high * (bx - ax)
        first_col, last_col = _span(min(left, right), max(left, right), x0, edge, cols)
        for bucket in range(row * cols + first_col, row * cols + last_col):
            for place in range(offsets[bucket], offsets[bucket + 1]):
                if is_near_segment(numbers[place], ax, ay, bx, by, boxes, discs, radius):
                    return False
    return True


@compiled
def arc_is_free(x: float, y: float, r: float, first: float, last: float, owner: int, buckets: Buckets) -> bool:
    """Whether an arc is free: halve it until each part is shorter than its distance from the shapes (slope <= 1)."""
    x0, y0, edge, rows, cols, offsets, numbers, boxes, discs, radius = buckets
    waiting = [(first, last)]
    while len(waiting) > 0:
        low, high = waiting.pop()
        middle = 0.5 * (low + high)
        half = 0.5 * (high - low) * r
        px, py = x + r * math.cos(middle), y + r * math.sin(middle)
        first_row, last_row = _span(py - half, py + half, y0, edge, rows)
        first_col, last_col = _span(px - half, px + half, x0, edge, cols)
        gap = np.inf
        for row in range(first_row, last_row):
            for place in range(offsets[row * cols + first_col], offsets[row * cols + last_col]):
                if numbers[place] != owner:
                    gap = min(gap, gap_to(numbers[place], px, py, boxes, discs, radius))
        if gap < -TOLERANCE:
            return False
        if gap < half and half > 0.5 * _FINEST_ARC:
            waiting.append((low, middle))
            waiting.append((middle, high))
    return True
