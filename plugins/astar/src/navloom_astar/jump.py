"""Jump point search without corner cutting (Harabor & Grastien 2011, 2012, 2014).

The successors are those of `search`. After a straight step, the search goes straight on; it also turns to a side if an
obstacle beside the previous cell ends there. After a diagonal step, it goes on diagonally or along either of the two
neighbouring straight directions. Jump point search follows each direction at once to the next cell with a choice. Only
these **jump points** enter the open list:

- In a straight direction: the goal, or a cell beside which an obstacle has just ended. If corners could be cut, the
  jump point would be the previous cell, from which a diagonal step leads around the obstacle. Without corner cutting,
  the robot must first pass the corner (2012, "no corner cutting").
- In a diagonal direction: the goal, or a cell from which either neighbouring straight direction leads to a jump point.
  No obstacle forces a choice on the diagonal itself, since both cells beside a diagonal step must be free.

Costs are the whole numbers of `search.step_costs`, so lengths are ranked exactly and equal those of A*.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_astar.expansion import CHOICES, COUNTS, START, Index
from navloom_astar.search import Bools, Cell, Closed, Ends, GridSearch, Way, step_costs

__all__ = ["JumpPointSearch", "warm_up"]

_NONE = 0
"""Index that means "no jump point": cell 0 is a corner of the border."""


class JumpPointSearch(GridSearch):
    """Same as `GridSearch`, by jump points.

    Jumping skips ways that are only *as* short as another. This is valid only if all ground costs the same, so with
    extra costs A* is used. A* also runs if there is no way, so that both report the same nearest cell.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        super().__init__(shape)
        self._parent = np.zeros(self.wall.size, dtype=np.int32)
        self._arrival = np.empty(self.wall.size, dtype=np.uint8)

    def shortest(
        self, free: Bools, start: Cell, goal: Cell, extra: NDArray[np.uint8] | None = None, ends: Ends | None = None
    ) -> Way | Closed:
        """See `GridSearch.shortest`."""
        if extra is not None:
            return super().shortest(free, start, goal, extra)
        self._check(free, start, goal, None)
        np.logical_not(free, out=self.wall[1:-1, 1:-1])
        q, p = step_costs(free.size)
        self._renew(2 * (free.size + 2) * p)
        self._kept = None  # the costs are those of jump points
        stride = self.shape[1] + 2
        first, last = ((row + 1) * stride + column + 1 for row, column in (start, goal))
        if not _search(self.wall, self._cost, self._arrival, self._parent, first, last, self._base, self._top, q, p):
            return super().shortest(free, start, goal)
        cells, diagonal = _trace(self._arrival, self._parent, stride, first, last)
        straight = len(cells) - 1 - diagonal
        return Way(cells, straight, diagonal, straight + diagonal * math.sqrt(2.0))


@njit(cache=True, nogil=True, error_model="numpy")
def _search(
    wall: Bools, cost: NDArray[np.int64], arrival: NDArray[np.uint8], parent: NDArray[np.int32], start: int, goal: int,
    base: int, top: int, q: int, p: int,
) -> bool:  # fmt: skip
    """Fill `cost`, `arrival` and `parent` of jump points until the goal's are final. Returns whether it was reached."""
    stride, walls = np.int64(wall.shape[1]), wall.reshape(-1)
    offsets = np.array((1, stride + 1, stride, stride - 1, -1, -stride - 1, -stride, 1 - stride))
    goal_row, goal_column = goal // stride, goal % stride
    cost[start], arrival[start], parent[start] = base, START, start
    heap: list[tuple[Index, Index, Index]] = [(np.int64(base), np.int64(base), np.int64(start))]
    while heap:
        sofar, cell = heapq.heappop(heap)[1:]
        if cell == goal:
            return True
        # An old entry: heapq cannot change one that is in the heap, so a shorter way adds another.
        if sofar > cost[cell]:
            continue
        case: Index = 4 * START
        row, column = cell // stride, cell % stride
        if arrival[cell] != START:
            came = np.int64(arrival[cell])
            case = 4 * came
            if not came & 1:
                before = cell - offsets[came]
                case += walls[before + offsets[(came + 2) & 7]] + 2 * walls[before + offsets[(came - 2) & 7]]
        for n in range(COUNTS[case]):
            k = CHOICES[case, n]
            other = _slide(walls, cell, k, offsets, goal) if k & 1 else _run(walls, cell, k, offsets, goal)
            if other == _NONE:
                continue
            other_row, other_column = other // stride, other % stride
            steps = max(abs(other_row - row), abs(other_column - column))
            reached = sofar + steps * (p if k & 1 else q)
            if reached >= cost[other]:
                continue
            cost[other], arrival[other], parent[other] = reached, k, cell
            down, across = abs(other_row - goal_row), abs(other_column - goal_column)
            heapq.heappush(heap, (reached + q * max(down, across) + (p - q) * min(down, across), reached, other))
    return False


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _run(walls: Bools, cell: Index, k: Index, offsets: NDArray[np.int64], goal: int) -> Index:
    """The next jump point in the straight direction k, or `_NONE`."""
    ahead, left, right = offsets[k], offsets[(k + 2) & 7], offsets[(k - 2) & 7]
    was_left, was_right = walls[cell + left], walls[cell + right]
    while True:
        cell += ahead
        if walls[cell]:
            return _NONE
        is_left, is_right = walls[cell + left], walls[cell + right]
        if cell == goal or was_left > is_left or was_right > is_right:
            return cell
        was_left, was_right = is_left, is_right


@njit(cache=True, nogil=True, error_model="numpy")
def _slide(walls: Bools, cell: Index, k: Index, offsets: NDArray[np.int64], goal: int) -> Index:
    """The next jump point in the diagonal direction k, or `_NONE`."""
    ahead, right, left = offsets[k], offsets[k - 1], offsets[(k + 1) & 7]
    while not (walls[cell + left] or walls[cell + right] or walls[cell + ahead]):
        cell += ahead
        if cell == goal or _run(walls, cell, k - 1, offsets, goal) or _run(walls, cell, (k + 1) & 7, offsets, goal):
            return cell
    return _NONE


@njit(cache=True, nogil=True)
def _trace(
    arrival: NDArray[np.uint8], parent: NDArray[np.int32], stride: int, start: int, goal: int
) -> tuple[NDArray[np.int64], int]:
    """(n, 2) rows and columns of all cells of the way, not counting the border, and its number of diagonal steps."""
    count, diagonal, cell = 1, 0, goal
    while cell != start:
        before = int(parent[cell])
        steps = max(abs(cell // stride - before // stride), abs(cell % stride - before % stride))
        count, diagonal, cell = count + steps, diagonal + steps * (arrival[cell] & 1), before
    way, cell, n = np.empty((count, 2), np.int64), goal, count - 1
    way[n, 0], way[n, 1] = cell // stride - 1, cell % stride - 1
    while n > 0:
        before = int(parent[cell])
        row, column = before // stride - 1, before % stride - 1
        while way[n, 0] != row or way[n, 1] != column:
            n -= 1
            way[n, 0] = way[n + 1, 0] + np.sign(row - way[n + 1, 0])
            way[n, 1] = way[n + 1, 1] + np.sign(column - way[n + 1, 1])
        cell = before
    return way, diagonal


def warm_up() -> None:
    """Compile the kernels."""
    JumpPointSearch((2, 2)).shortest(np.ones((2, 2), dtype=np.bool_), (0, 0), (1, 1))
