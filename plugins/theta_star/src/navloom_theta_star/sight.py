"""Line of sight on a grid, and the cost of the ground along it.

Points are x, y in cells: the cell (row, column) spans column..column + 1 by row..row + 1.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["ground_cost", "is_in_sight"]

Bools = NDArray[np.bool_]

_TOUCH = 1e-6
"""Distance at which a segment still touches a cell, cells, so that the result does not depend on rounding."""


@njit(cache=True, nogil=True, error_model="numpy")
def is_in_sight(wall: Bools, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Whether a segment touches no wall, not even at a corner (closed supercover).

    A segment through the shared corner of four cells touches all four. Corners are therefore not cut, and no way leads
    between obstacles that touch at a corner. The framework prunes paths by the same rule.

    Args:
        wall: (rows, columns) bool with a border of walls, C-contiguous.
        x0, y0, x1, y1: Ends of the segment, within the border, cells.
    """
    walls, stride = wall.reshape(-1), wall.shape[1]
    if abs(x1 - x0) < abs(y1 - y0):
        return _is_free(walls, 1, stride, y0, x0, y1, x1)
    return _is_free(walls, stride, 1, x0, y0, x1, y1)


@njit(cache=True, nogil=True, error_model="numpy")
def _is_free(walls: Bools, lane: int, step: int, u0: float, v0: float, u1: float, v1: float) -> bool:
    """Check the line of sight lane by lane. Lanes are rows or columns, whichever the segment crosses fewer of.

    The cells that the segment touches are the same either way.

    Args:
        walls: (n,) cells of the grid, flattened.
        lane, step: Index offsets from a cell to the one beside it in the next lane, and to the next one in its lane.
        u0, v0, u1, v1: Ends of the segment, along (u) and across (v) the lanes, cells.
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

    Between the centres of neighbouring cells, this equals the cost of a step of A*.

    Args:
        extra: (rows, columns) extra cost per length, in units of 1 / `unit`.
        unit: Value of `extra` that doubles the cost of a cell.
        x0, y0, x1, y1: Ends of the segment, within the grid, cells.
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
