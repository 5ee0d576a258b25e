"""Free space of a disc's centre on a raster map with boxes and cylinders in it. Implements `Space`."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from navloom.geometry.compiled import compiled
from numpy.typing import NDArray

from navloom_optimal.free_space import TOLERANCE, Shapes, shape_gap

__all__ = ["Field", "FieldSpace", "segment_is_free_in_field"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Field = tuple[Bools, int, float, Floats, NDArray[np.int32], Floats, Floats, float]
"""A `FieldSpace` for compiled functions: its attributes in order, then those of its shapes."""


@dataclass(frozen=True, eq=False)
class FieldSpace:
    """A raster map with boxes and cylinders in it; points off the map are not free.

    Attributes:
        occupied: (rows, cols) bool.
        per_cell: Lattice steps in a cell; lattice node (0, 0) is the lower left corner of cell (0, 0).
        step: Spacing of lattice nodes, m.
        clear: (rows * per_cell + 1, cols * per_cell + 1) distance of each node from the nearest obstacle, m.
        feature: (2, ...) for each node, the nearest lattice node of an occupied cell; -1 if no cell is occupied.
        shapes: Boxes and cylinders, m, in the raster's frame.
    """

    occupied: Bools
    per_cell: int
    step: float
    clear: Floats
    feature: NDArray[np.int32]
    shapes: Shapes

    def points_free(self, points: Floats) -> Bools:
        """See `Space`."""
        return _points_in_field(points, self.arrays)

    def segments_free(self, segments: Floats) -> Bools:
        """See `Space`."""
        return _segments_in_field(segments, self.arrays)

    def arcs_free(self, circles: Floats, angles: Floats, owners: Ints) -> Bools:
        """See `Space`."""
        return _arcs_in_field(circles, angles, self.arrays)

    @property
    def arrays(self) -> Field:
        """The space in the form for compiled functions."""
        s = self.shapes
        return self.occupied, self.per_cell, self.step, self.clear, self.feature, s.boxes, s.discs, s.radius


@compiled
def _nearest_cell(x: float, y: float, row: int, col: int, occupied: Bools, per_cell: int, step: float) -> float:
    """Distance of a point from the occupied cells adjacent to lattice node (row, col), m."""
    edge = per_cell * step
    best: float = np.inf
    for r in range(max(0, (row - 1) // per_cell), min(occupied.shape[0] - 1, row // per_cell) + 1):
        for c in range(max(0, (col - 1) // per_cell), min(occupied.shape[1] - 1, col // per_cell) + 1):
            if occupied[r, c]:
                dx = max(c * edge - x, x - (c + 1) * edge, 0.0)
                dy = max(r * edge - y, y - (r + 1) * edge, 0.0)
                gap: float = math.hypot(dx, dy)
                best = min(best, gap)
    return best


@compiled
def field_gap(
    x: float,
    y: float,
    field: Field,
) -> float:
    """Distance of the disc's rim from the nearest obstacle, m; negative if they overlap, -inf off the map.

    Near obstacles it is the distance from the cells nearest to the four lattice nodes around the point; further away
    it is a lower bound from the nearest node.
    """
    occupied, per_cell, step, clear, feature, boxes, discs, radius = field
    u, v = x / step, y / step
    rows, cols = clear.shape
    if not (-1e-9 <= u <= cols - 1 + 1e-9 and -1e-9 <= v <= rows - 1 + 1e-9):
        return -np.inf
    i, j = min(max(int(v + 0.5), 0), rows - 1), min(max(int(u + 0.5), 0), cols - 1)
    bound: float = clear[i, j] - radius - step * math.hypot(u - j, v - i)
    if bound > 0.5 * step:
        return bound
    best = np.inf
    low_i, low_j = min(max(int(v), 0), rows - 2), min(max(int(u), 0), cols - 2)
    for i in range(low_i, low_i + 2):
        for j in range(low_j, low_j + 2):
            if feature[0, i, j] >= 0:
                row, col = feature[0, i, j], feature[1, i, j]
                best = min(best, _nearest_cell(x, y, row, col, occupied, per_cell, step))
    gap: float = min(best - radius, shape_gap(x, y, boxes, discs, radius))
    return gap


@compiled
def _points_in_field(
    points: Floats,
    field: Field,
) -> Bools:
    free = np.empty(points.shape[0], dtype=np.bool_)
    for n in range(points.shape[0]):
        x, y = points[n, 0], points[n, 1]
        free[n] = field_gap(x, y, field) >= -TOLERANCE
    return free


@compiled
def segment_is_free_in_field(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    field: Field,
) -> bool:
    """Whether a segment is free: march along it by the free distance, at least a quarter of a lattice step."""
    step = field[2]
    length = math.hypot(bx - ax, by - ay)
    done = 0.0
    while True:
        share = done / length if length > 0.0 else 0.0
        x, y = ax + share * (bx - ax), ay + share * (by - ay)
        gap = field_gap(x, y, field)
        if gap < -TOLERANCE:
            return False
        if done >= length:
            return True
        done = min(done + max(gap, 0.25 * step), length)


@compiled
def _segments_in_field(
    segments: Floats,
    field: Field,
) -> Bools:
    free = np.empty(segments.shape[0], dtype=np.bool_)
    for n in range(segments.shape[0]):
        ax, ay, bx, by = segments[n, 0], segments[n, 1], segments[n, 2], segments[n, 3]
        free[n] = segment_is_free_in_field(ax, ay, bx, by, field)
    return free


@compiled
def _arcs_in_field(
    circles: Floats,
    angles: Floats,
    field: Field,
) -> Bools:
    step = field[2]
    free = np.ones(circles.shape[0], dtype=np.bool_)
    for n in range(circles.shape[0]):
        r, first, last = circles[n, 2], angles[n, 0], angles[n, 1]
        parts = 1 + math.ceil((last - first) * r / (0.25 * step))
        for part in range(parts + 1):
            angle = first + (last - first) * part / parts
            x, y = circles[n, 0] + r * math.cos(angle), circles[n, 1] + r * math.sin(angle)
            if field_gap(x, y, field) < -TOLERANCE:
                free[n] = False
                break
    return free
