"""Line of sight on a grid, and what the ground costs along it.

Places are x, y in cells: the cell (row, column) is column..column + 1, row..row + 1.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["ground_cost", "is_in_sight"]

Bools = NDArray[np.bool_]

_TOUCH = 1e-6
"""A segment this near to a cell touches it, in cells: the answer must not hang on rounding."""


@njit(cache=True, nogil=True, error_model="numpy")
def is_in_sight(wall: Bools, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Whether a segment touches no wall, be it at a corner only (closed supercover).

    A segment through the shared corner of four cells touches all four, so corners are not cut, and between obstacles
    that touch at a corner there is no way. The framework prunes paths by the same rule.

    Args:
        wall: (rows, columns) bool with a border of walls, row by row in memory.
        x0, y0, x1, y1: Places within the border.
    """
    walls, stride = wall.reshape(-1), wall.shape[1]
    if abs(x1 - x0) < abs(y1 - y0):
        return _is_free(walls, 1, stride, y0, x0, y1, x1)
    return _is_free(walls, stride, 1, x0, y0, x1, y1)


@njit(cache=True, nogil=True, error_model="numpy")
def _is_free(walls: Bools, lane: int, step: int, u0: float, v0: float, u1: float, v1: float) -> bool:
    """The same lane by lane. Lanes are rows or columns, whichever are fewer: the cells touched are the same.

    Args:
        walls: (n,) the grid's cells.
        lane, step: From a cell to the one beside it in the next lane, and to the next one in its own.
        u0, v0, u1, v1: Ends, along and across the lanes.
    """
    if v0 > v1:
        u0, v0, u1, v1 = u1, v1, u0, v0
    rise, low, high = v1 - v0, min(u0, u1), max(u0, u1)
    slope, back, ahead = 0.0, -math.inf, math.inf
    if rise > _TOUCH:
        slope = (u1 - u0) / rise
        across = slope * (1.0 + 2.0 * _TOUCH)
        back, ahead = min(across, 0.0), max(across, 0.0)
    for v in range(math.floor(v0 - _TOUCH), math.floor(v1 + _TOUCH) + 1):
        enter = u0 + (v - _TOUCH - v0) * slope
        first = math.floor(max(enter + back, low) - _TOUCH)
        last = math.floor(min(enter + ahead, high) + _TOUCH)
        for cell in range(v * lane + first * step, v * lane + last * step + 1, step):
            if walls[cell]:
                return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def ground_cost(extra: NDArray[np.uint8], unit: int, x0: float, y0: float, x1: float, y1: float) -> float:
    """Integral of 1 + extra / unit along a segment, cells.

    Between the centres of neighbouring cells that is the cost of a step of A*.

    Args:
        extra: (rows, columns) of the ground besides its length.
        unit: Parts of `extra` that count as the length once more.
        x0, y0, x1, y1: Places within the grid.
    """
    length = math.hypot(x1 - x0, y1 - y0)
    if y0 > y1:
        x0, y0, x1, y1 = x1, y1, x0, y0
    rise, more = y1 - y0, 0.0
    for row in range(math.floor(y0), math.floor(y1) + 1):
        enter, leave = 0.0, 1.0
        if rise > 0.0:
            enter, leave = max(0.0, (row - y0) / rise), min(1.0, (row + 1.0 - y0) / rise)
        xa, xb = x0 + enter * (x1 - x0), x0 + leave * (x1 - x0)
        left, right = min(xa, xb), max(xa, xb)
        for column in range(math.floor(left), math.floor(right) + 1):
            share = leave - enter
            if right > left:
                share *= (min(right, column + 1.0) - max(left, float(column))) / (right - left)
            more += share * extra[row, column]
    return length * (1.0 + more / unit)
