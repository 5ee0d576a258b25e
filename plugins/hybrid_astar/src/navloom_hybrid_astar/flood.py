"""Distance to the goal for a disc that moves in any direction: the holonomic heuristic (Dolgov et al. 2010)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navloom_hybrid_astar.compiled import compiled

__all__ = ["UNIT", "distances_to"]

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

UNIT = 408
"""Length of a cell, in the whole numbers in which the flood counts. 408, 577, 912 are as 1, √2, √5, to 0.001."""
_STEPS = np.array(
    [
        (0, 1, 408), (1, 0, 408), (0, -1, 408), (-1, 0, 408), (1, 1, 577), (1, -1, 577), (-1, -1, 577), (-1, 1, 577),
        (1, 2, 912), (2, 1, 912), (2, -1, 912), (1, -2, 912), (-1, -2, 912), (-2, -1, 912), (-2, 1, 912), (-1, 2, 912),
    ],
    dtype=np.int64,
)  # fmt: skip
_BUCKETS = 4
"""More than the longest step over the shortest, rounded up: the buckets are used in turn."""
_STRETCH = 1.0 / 1.0275
"""The sixteen directions make a way at most 2.75 % longer than a straight one: with this factor none is too long."""


def distances_to(passable: Bools, goal: tuple[int, int], start: tuple[int, int], beyond: float) -> NDArray[np.float32]:
    """Lower bounds of the ways to the goal from all cells.

    Args:
        passable: (rows, columns) cells in which the robot's base may be.
        goal, start: Row and column.
        beyond: The flood ends where it is this many cells further than 1.5 times the way from the start.

    Returns:
        (rows, columns) cells. Where the flood did not come because it ended, what it had reached; infinite where there
        is no way.
    """
    rows, columns = passable.shape
    cost = np.full(rows * columns, -1, dtype=np.int64)
    end = _flood(
        np.ascontiguousarray(passable).reshape(-1), columns, goal[0] * columns + goal[1],
        start[0] * columns + start[1], int(beyond * UNIT), cost,
    )  # fmt: skip
    return _in_cells(cost, end, _STRETCH / UNIT).reshape(rows, columns)


@compiled
def _in_cells(cost: Ints, end: int, factor: float) -> NDArray[np.float32]:
    found = np.empty(cost.shape[0], dtype=np.float32)
    for cell in range(cost.shape[0]):
        known = cost[cell] if cost[cell] >= 0 else end
        found[cell] = known * factor if known >= 0 else np.inf
    return found


@compiled
def _flood(passable: Bools, columns: int, goal: int, start: int, beyond: int, cost: Ints) -> int:
    """Fill `cost` in the order of Dijkstra; returns the bound of cells that were not reached, -1 if all were.

    A bucket is as wide as the shortest step, so what leaves it cannot come back into it. An entry may be in a bucket
    twice: only the first that is taken out counts.
    """
    rows = passable.shape[0] // columns
    buckets = [[goal], [goal][:0], [goal][:0], [goal][:0]]
    cost[goal] = 0
    is_done = np.zeros(passable.shape[0], dtype=np.bool_)
    level, empty, limit = 0, 0, -1
    while empty < _BUCKETS:
        bucket = buckets[level % _BUCKETS]
        if len(bucket) == 0:
            empty += 1
            level += 1
            continue
        empty = 0
        cell = bucket.pop()
        if is_done[cell] or cost[cell] // UNIT != level:
            continue
        is_done[cell] = True
        if cell == start:
            limit = cost[cell] + cost[cell] // 2 + beyond
        if 0 <= limit < cost[cell]:
            return limit
        row, column = cell // columns, cell % columns
        for n in range(_STEPS.shape[0]):
            down, across = _STEPS[n, 0], _STEPS[n, 1]
            if not (0 <= row + down < rows and 0 <= column + across < columns):
                continue
            other = cell + down * columns + across
            if not passable[other] or is_done[other]:
                continue
            if n >= 8:
                # A step of one by two leads through the two cells between.
                half = (0, across // 2) if abs(across) == 2 else (down // 2, 0)
                beside = cell + half[0] * columns + half[1]
                if not passable[beside] or not passable[other - (beside - cell)]:
                    continue
            further = cost[cell] + _STEPS[n, 2]
            if cost[other] < 0 or further < cost[other]:
                cost[other] = further
                buckets[(further // UNIT) % _BUCKETS].append(other)
    return -1
