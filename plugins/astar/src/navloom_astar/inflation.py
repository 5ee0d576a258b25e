"""Grow obstacles by the size of the robot, so that the robot can be planned for as a point.

The result is the configuration space of a disc or a square. Any shape works that is symmetric and narrows away from its
middle row. Its *reach* lists its half width in the middle row, in the next row, and so on. Two passes, down and up,
find each cell's distance to the nearest obstacle in its column. Two passes along the rows spread the obstacles by the
reach at that distance. This costs four steps per cell, whatever the size of the shape. Only the box around all
obstacles is processed.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["circumscribed_radius", "disc_reach", "grow", "inscribed_radius", "square_reach", "warm_up"]

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Reach = NDArray[np.int32]

_TOUCH = 1e-9
"""How much closer than its radius the robot may come, cells: touching is not a collision, whatever the rounding."""


def square_reach(cells: int) -> Reach:
    """(cells + 1,) reach of a square with sides of 2 * cells + 1; Hoang et al. 2013, III.A, dilate by 2 cells."""
    return np.full(cells + 1, cells, dtype=np.int32)


def disc_reach(radius: float) -> Reach:
    """Reach of a disc around a cell's centre that must not meet any point of an obstacle's cell.

    The centre of the robot is assumed to be at a cell centre. Its distance from the nearest edge or corner of the
    obstacle's cell is compared with the radius. This is exact for whole cells, and on the safe side for the obstacle
    itself, which may lie anywhere in its cell.

    Args:
        radius: Cells, >= 0.

    Returns:
        (n,) number of cells on either side that are too close; element i is i rows from the obstacle's row. Element 0
        always exists, so an obstacle's own cell is always blocked.
    """
    reach = [0]
    if radius - _TOUCH > 0.5:
        reach = [math.ceil(radius + 0.5 - _TOUCH) - 1]
    for row in range(1, math.ceil(radius + 0.5)):
        across = (radius - _TOUCH) ** 2 - (row - 0.5) ** 2
        if across <= 0.0:
            break
        reach.append(math.ceil(math.sqrt(across) + 0.5) - 1)
    return np.array(reach, dtype=np.int32)


def grow(occupied: Bools, reach: Reach) -> Bools:
    """The cells that are within reach of an occupied one.

    Args:
        occupied: (rows, columns).
        reach: (n,) half widths, which never increase.
    """
    if len(reach) == 1 and reach[0] == 0:
        return occupied.copy()
    # Of one layout, since numba compiles again for another.
    return _grow(np.ascontiguousarray(occupied), reach)


def inscribed_radius(footprint: Floats) -> float:
    """Radius of the largest disc around the origin within a convex outline, m.

    Args:
        footprint: (n, 2) corners, m, base frame, counter-clockwise.
    """
    edges = np.roll(footprint, -1, axis=0) - footprint
    across = footprint[:, 0] * edges[:, 1] - footprint[:, 1] * edges[:, 0]
    return float((across / np.hypot(edges[:, 0], edges[:, 1])).min())


def circumscribed_radius(footprint: Floats) -> float:
    """Radius of the smallest disc around the origin that covers an outline, m. `footprint`: (n, 2) m, base frame."""
    return float(np.hypot(footprint[:, 0], footprint[:, 1]).max())


@njit(cache=True, nogil=True)
def _grow(occupied: Bools, reach: Reach) -> Bools:
    grown = np.zeros(occupied.shape, np.bool_)
    low, high, left, right = _box(occupied.view(np.uint8))
    if high < low:
        return grown
    far, wide = len(reach), reach[0]
    low, high = max(low - far + 1, 0), min(high + far, occupied.shape[0])
    left, right = max(left - wide, 0), min(right + wide + 1, occupied.shape[1])
    rows, columns = high - low, right - left
    away = np.empty((rows, columns), np.int32)  # rows to the nearest obstacle of the column, at most `far`
    for row in range(rows):
        line = occupied[low + row, left:right]
        for column in range(columns):
            before = away[row - 1, column] + 1 if row > 0 else far
            away[row, column] = 0 if line[column] else min(before, far)
    for row in range(rows - 2, -1, -1):
        for column in range(columns):
            away[row, column] = min(away[row, column], away[row + 1, column] + 1)
    spread = np.empty(far + 1, np.int32)
    # Value by value: to assign a whole array compiles numba's message for unequal shapes, 2 s.
    for k in range(far):
        spread[k] = reach[k]
    spread[far] = -1
    for row in range(rows):
        line, ahead = grown[low + row, left:right], -1
        for column in range(columns):
            ahead = max(ahead - 1, spread[away[row, column]])
            line[column] = ahead >= 0
        ahead = -1
        for column in range(columns - 1, -1, -1):
            ahead = max(ahead - 1, spread[away[row, column]])
            line[column] |= ahead >= 0
    return grown


@njit(cache=True, nogil=True)
def _box(cells: NDArray[np.uint8]) -> tuple[int, int, int, int]:
    """First and last row, first and last column with a cell other than 0; if there is none, the last row is -1."""
    low, high, in_column = cells.shape[0], -1, np.zeros(cells.shape[1], np.uint8)
    for row in range(cells.shape[0]):
        in_row = np.uint8(0)
        for column in range(cells.shape[1]):
            in_row |= cells[row, column]
        if in_row:
            low, high = min(low, row), row
            for column in range(cells.shape[1]):
                in_column[column] |= cells[row, column]
    left, right = cells.shape[1], -1
    for column in range(cells.shape[1]):
        if in_column[column]:
            left, right = min(left, column), column
    return low, high, left, right


def warm_up() -> None:
    """Compile all kernels."""
    grow(np.zeros((2, 2), dtype=np.bool_), square_reach(1))
