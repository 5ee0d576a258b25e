"""Nearest neighbours of agents, from a grid of cells: each agent is compared with those of the cells around it only."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]
MOST_CELLS = 1 << 16
"""Cells of the grid; where the crowd is spread wider, cells are larger than asked for."""


@njit(cache=True, nogil=True)
def fill_cells(positions: Floats, width: float) -> tuple[float, float, float, int, int, Numbers, Numbers]:
    """Sort agents into cells at least as wide as a width.

    Args:
        positions: (n, 2) m. width: m.

    Returns:
        Lower left corner x, y and side of a cell, m; columns and rows; (columns * rows + 1,) first place of each cell
        in the last array; (n,) agents by cell, in each in rising order.
    """
    n = positions.shape[0]
    left, low = positions[:, 0].min(), positions[:, 1].min()
    wide, high = positions[:, 0].max() - left, positions[:, 1].max() - low
    side = max(width, math.sqrt((wide + 1.0e-9) * (high + 1.0e-9) / MOST_CELLS), max(wide, high) / MOST_CELLS, 1.0e-9)
    columns, rows = int(wide / side) + 1, int(high / side) + 1
    first, order, cell = np.zeros(columns * rows + 1, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    for i in range(n):
        cell[i] = int((positions[i, 1] - low) / side) * columns + int((positions[i, 0] - left) / side)
        first[cell[i] + 1] += 1
    for k in range(columns * rows):
        first[k + 1] += first[k]
    place = first[:-1].copy()
    for i in range(n):
        order[place[cell[i]]] = i
        place[cell[i]] += 1
    return left, low, side, columns, rows, first, order


@njit(cache=True, nogil=True)
def cell_width(positions: Floats, reach: float) -> float:
    """Width of cells that hold about two agents each, m, where the crowd is spread evenly; at most the reach, m."""
    wide = positions[:, 0].max() - positions[:, 0].min()
    high = positions[:, 1].max() - positions[:, 1].min()
    return float(min(reach, math.sqrt(2.0 * wide * high / positions.shape[0]) + 1.0e-9))


@njit(cache=True, nogil=True)
def insert(others: Numbers, squares: Floats, count: int, other: int, square: float) -> int:
    """Insert an agent into a list that is sorted by distance, then by number, and keeps the nearest.

    Args:
        others: (most,) numbers; squares: (most,) squares of their distances, m²; both changed in place.
        count: Entries in use. other, square: The agent.

    Returns:
        Entries in use.
    """
    most = others.size
    if most == 0:
        return 0
    last = most - 1
    if count == most and (square > squares[last] or (square == squares[last] and other > others[last])):
        return count
    at = count if count < most else last
    while at > 0 and (square < squares[at - 1] or (square == squares[at - 1] and other < others[at - 1])):
        others[at], squares[at] = others[at - 1], squares[at - 1]
        at -= 1
    others[at], squares[at] = other, square
    return min(count + 1, most)


@njit(cache=True, nogil=True)
def nearest_seen(
    positions: Floats, i: int, sees: NDArray[np.bool_], reach: float,
    cells: tuple[float, float, float, int, int, Numbers, Numbers], others: Numbers, squares: Floats,
) -> int:  # fmt: skip
    """The nearest agents that agent i sees: ring after ring of cells, until what is left is farther than those found.

    Args:
        positions: (n, 2) m. i: The agent. sees: (n, n) who sees whom. reach: Farthest distance, m.
        cells: By fill_cells(). others, squares: (most,), filled in; see insert().

    Returns:
        Their number.
    """
    left, low, side, columns, rows, first, order = cells
    x, y, most, count = positions[i, 0], positions[i, 1], others.size, 0
    column, line = int((x - left) / side), int((y - low) / side)
    for ring in range(max(columns, rows)):
        near = (ring - 1) * side  # what is beyond the rings so far is at least as far
        if ring > 0 and (near >= reach or (count == most and (most == 0 or squares[most - 1] < near * near))):
            break
        for row in range(max(0, line - ring), min(rows, line + ring + 1)):
            # Of a row between the first and the last of the ring, only both ends.
            step = 1 if abs(row - line) == ring else max(2 * ring, 1)
            for at in range(column - ring, column + ring + 1, step):
                if not 0 <= at < columns:
                    continue
                cell = row * columns + at
                for k in range(first[cell], first[cell + 1]):
                    j = order[k]
                    if j == i or not sees[i, j]:
                        continue
                    dx, dy = positions[j, 0] - x, positions[j, 1] - y
                    square = dx * dx + dy * dy
                    if square < reach * reach:
                        count = insert(others, squares, count, j, square)
    return count
