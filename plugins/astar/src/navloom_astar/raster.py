"""Draw line segments on the cells of the planning grid (Hoang et al. 2013, III.A).

Coordinates are in cells: the cell (row, column) is the unit square around the point x = column, y = row.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["RasterMethod", "draw_segments", "warm_up"]

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
RasterMethod = Literal["distance", "supercover", "paper"]

_DRAWN_IN = 1e-6
"""Length cut off both ends of a segment, cells, so that one that ends on a cell's edge does not fill the next cell."""
_TOUCH = 1e-9
"""Distance at which a segment still touches a cell, cells: one along an edge fills the cells on both sides."""


def draw_segments(occupied: Bools, segments: Floats, method: RasterMethod = "distance", paper_t: float = 2.0) -> None:
    """Mark the cells of segments as occupied, in place.

    Args:
        occupied: (rows, columns).
        segments: (n, 4) x1, y1, x2, y2, cells. A point has two equal ends.
        method: Which cells a segment occupies. "distance": those whose centre is at most half a cell from the segment,
            and those that hold one of its ends. No straight step between free cells then crosses the segment: of two
            neighbouring centres on opposite sides of it, one is within half a cell. "supercover": those that the
            segment touches. "paper": those of the printed test.
        paper_t: T of the printed test, cells. The paper sets it to the size of the robot.
    """
    ends = segments.astype(np.float64)
    if method == "paper":
        for segment in ends:
            occupied |= _printed_test(occupied.shape, segment, paper_t)
        return
    along = ends[:, 2:] - ends[:, :2]
    length = np.hypot(along[:, 0], along[:, 1])
    inwards = along * (np.minimum(_DRAWN_IN, 0.25 * length) / np.where(length > 0.0, length, 1.0))[:, None]
    ends[:, :2] += inwards
    ends[:, 2:] -= inwards
    _draw(occupied, ends, method == "supercover")


def _printed_test(shape: tuple[int, ...], segment: Floats, t: float) -> Bools:
    """The test of III.A: |(m - x1)/(n - y1) - (x2 - x1)/(y2 - y1)| <= T, or m - x1 <= T if x1 = x2, for cells (m, n).

    It compares a slope with a length, and it does not end where the segment ends. Only two things are corrected. Where
    it divides by zero (y1 = y2, or the row n = y1), the test is |n - y1| <= 1/2 with m between both ends. For x1 = x2
    it uses |m - x1| instead of m - x1.
    """
    x1, y1, x2, y2 = segment
    n, m = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    in_row: Bools = (np.abs(n - y1) <= 0.5) & (m >= min(x1, x2) - 0.5) & (m <= max(x1, x2) + 0.5)
    if x1 == x2:
        hit: Bools = np.abs(m - x1) <= t
        return hit
    if y1 == y2:
        return in_row
    rise = n - y1
    is_level = rise == 0.0
    slope = (m - x1) / np.where(is_level, 1.0, rise)
    return np.asarray(np.where(is_level, in_row, np.abs(slope - (x2 - x1) / (y2 - y1)) <= t))


@njit(cache=True, nogil=True)
def _draw(occupied: Bools, segments: Floats, is_supercover: bool) -> None:
    rows, columns = occupied.shape
    for i in range(segments.shape[0]):
        x1, y1, x2, y2 = segments[i, 0], segments[i, 1], segments[i, 2], segments[i, 3]
        for x, y in ((x1, y1), (x2, y2)):
            row, column = math.floor(y + 0.5), math.floor(x + 0.5)
            if 0 <= row < rows and 0 <= column < columns:
                occupied[row, column] = True
        low, high = math.floor(min(y1, y2)), math.ceil(max(y1, y2))
        for row in range(max(0, low), min(rows - 1, high) + 1):
            # The part of the segment within one row of this row, and the columns around that part.
            enter, leave = 0.0, 1.0
            if abs(y2 - y1) > 1.0:
                to_low, to_high = (row - 1.0 - y1) / (y2 - y1), (row + 1.0 - y1) / (y2 - y1)
                enter, leave = max(0.0, min(to_low, to_high)), min(1.0, max(to_low, to_high))
            xa, xb = x1 + enter * (x2 - x1), x1 + leave * (x2 - x1)
            left, right = math.floor(min(xa, xb)) - 1, math.ceil(max(xa, xb)) + 1
            for column in range(max(0, left), min(columns - 1, right) + 1):
                if is_supercover:
                    hit = _touches_cell(x1 - column, y1 - row, x2 - column, y2 - row)
                else:
                    hit = _is_near(x1 - column, y1 - row, x2 - column, y2 - row)
                if hit:
                    occupied[row, column] = True


@njit(cache=True, nogil=True)
def _is_near(x1: float, y1: float, x2: float, y2: float) -> bool:
    """Whether the segment comes within half a cell of the origin."""
    dx, dy = x2 - x1, y2 - y1
    squared = dx * dx + dy * dy
    share = 0.0 if squared == 0.0 else min(1.0, max(0.0, -(x1 * dx + y1 * dy) / squared))
    return math.hypot(x1 + share * dx, y1 + share * dy) <= 0.5 + _TOUCH


@njit(cache=True, nogil=True)
def _touches_cell(x1: float, y1: float, x2: float, y2: float) -> bool:
    """Whether the segment meets the closed unit square around the origin (Liang & Barsky 1984)."""
    half, enter, leave = 0.5 + _TOUCH, 0.0, 1.0
    for start, step in ((x1, x2 - x1), (y1, y2 - y1)):
        if step == 0.0:
            if abs(start) > half:
                return False
        else:
            near, far = (-half - start) / step, (half - start) / step
            enter, leave = max(enter, min(near, far)), min(leave, max(near, far))
    return enter <= leave


def warm_up() -> None:
    """Compile all kernels."""
    draw_segments(np.zeros((2, 2), dtype=np.bool_), np.zeros((1, 4)))
