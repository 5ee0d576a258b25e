"""A* on an 8-connected grid without corner cutting (Hart, Nilsson & Raphael 1968), optimal in exact arithmetic.

Without the heuristic, the same search is Dijkstra's (1959).

**Lengths** are a + b sqrt(2) cells, with a straight and b diagonal steps. They are compared as whole numbers q a + p b,
where p/q is a convergent of sqrt(2). Two ways of different length would be ranked wrongly, or as equal, only if the
ratio of their differences in a and b were p/q or lay between p/q and sqrt(2). All fractions in that range have
denominators of q or more, so the numbers of diagonal steps would differ by q or more. A shortest way enters no cell
twice, so its b is below the number of cells. With q above that number the ranking is exact. `step_costs` returns the
smallest such convergent. (1393/985, which fits 32 bits, is exact if no way has 985 diagonal steps. This is certain on
grids of up to 985 cells.)

**Successors.** A step from a cell is pruned if another way from the cell's parent, around the cell, is shorter. A
diagonal step is also pruned if another way is equally long and ends in a straight step. This is the neighbour pruning
of Harabor & Grastien (2011) without their jumps. Straight steps are pruned only if they are strictly longer, so every
cell keeps at least one shortest way without a pruned step. Extra costs break this argument: with them, all eight
successors are tried.

**The open list** is a ring of buckets over f, about 0.1 to 0.2 cells wide, each last in, first out. A cell is reopened
when a shorter way to it is found. The heuristic is consistent, so f never falls below the lower bound of the current
bucket. Once that bound reaches the cost of the goal, no open cell can improve it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["EXTRA_UNIT", "Cell", "Closed", "DijkstraSearch", "Ends", "GridSearch", "Way", "step_costs", "warm_up"]

Bools = NDArray[np.bool_]
Cell = tuple[int, int]
"""Row and column."""
Index = int | np.int64
"""Index of a cell or a direction: kernels mix both integer types."""
Ends = tuple[tuple[float, float], tuple[float, float]]
"""x, y of start and goal, cells: the cell (row, column) spans column..column + 1 by row..row + 1."""

EXTRA_UNIT = 8
"""Parts per unit of extra cost: extra costs are whole eighths."""

_LARGEST = 1 << 62
_CLOSED = -1
_START = 8
"""Direction of arrival stored for the start, which has no parent."""
_MOST_BUCKETS = 2048
_ROW_STEP = np.array((0, 1, 1, 1, 0, -1, -1, -1))
_COLUMN_STEP = np.array((1, 1, 0, -1, -1, -1, 0, 1))
"""Directions: even ones are straight, odd ones diagonal, anticlockwise."""


def _successors() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Directions that are not pruned, and how many there are.

    Returns:
        (33, 8) and (33,), indexed by 4 x (direction from the parent) + 1 if a wall is left of the parent + 2 if a wall
        is right of it.
    """
    table, counts = np.zeros((33, 8), dtype=np.int64), np.zeros(33, dtype=np.int64)
    for case in range(33):
        k, walls = divmod(case, 4)
        if k == _START:
            chosen = list(range(8))
        elif k % 2:
            chosen = [k - 1, k + 1, k]
        else:
            chosen = [k + 2, k + 1] * (walls & 1) + [k - 2, k - 1] * (walls >> 1) + [k]
        table[case, : len(chosen)], counts[case] = np.array(chosen) % 8, len(chosen)
    return table, counts


_CHOICES, _COUNTS = _successors()


@dataclass(frozen=True, eq=False)
class Way:
    """A shortest way.

    Attributes:
        cells: (n, 2) rows and columns from start to goal, int64.
        straight, diagonal: Number of steps of each kind.
        cost: Integral of 1 + extra along the way, cells; equal to the length if there are no extra costs.
    """

    cells: NDArray[np.int64]
    straight: int
    diagonal: int
    cost: float

    @property
    def length(self) -> float:
        """Length of the way, cells."""
        return self.straight + self.diagonal * math.sqrt(2.0)


@dataclass(frozen=True)
class Closed:
    """There is no way.

    Attributes:
        nearest: The cell connected with the start that is nearest to the goal in a straight line. Ties go to the
            lowest cost, then row, then column.
    """

    nearest: Cell


@lru_cache(maxsize=64)
def step_costs(most: int) -> tuple[int, int]:
    """Costs q, p of a straight and a diagonal step that rank all lengths a + b sqrt(2) with b <= `most` exactly.

    Args:
        most: Upper bound of the number of diagonal steps of any way, >= 1. The ranking is exact up to 4e8; above
            that, the costs are the largest that cannot overflow.
    """
    straight, diagonal = 1, 1
    while straight <= most:
        following = straight + diagonal, 2 * straight + diagonal
        if 4 * most * following[1] > _LARGEST:
            break
        straight, diagonal = following
    return straight, diagonal


class GridSearch:
    """A* on grids of one size. It reuses its work arrays without clearing them between queries.

    The costs of a query are below all costs of earlier queries, so old values read as "not yet reached".

    Attributes:
        wall: (rows + 2, columns + 2) blocked cells of the last query, with a border of walls.
        extra: (rows + 2, columns + 2) extra costs of the last query that had any.
    """

    _looks_ahead = True

    def __init__(self, shape: tuple[int, int]) -> None:
        self.shape = shape
        padded = (shape[0] + 2, shape[1] + 2)
        size = padded[0] * padded[1]
        self.wall = np.ones(padded, dtype=np.bool_)
        self.extra = np.zeros(padded, dtype=np.uint8)
        self._cost = np.zeros(size, dtype=np.int64)
        self._arrival = np.empty(size, dtype=np.uint8)
        # Each bucket is a circular list of its cells; its head is an element past the last cell of the grid.
        self._before, self._after = np.empty((2, size + _MOST_BUCKETS), dtype=np.int32)
        self._base = self._top = 0

    def shortest(
        self, free: Bools, start: Cell, goal: Cell, extra: NDArray[np.uint8] | None = None, ends: Ends | None = None
    ) -> Way | Closed:
        """The shortest way between two cells.

        A step to a straight neighbour has length 1, a step to a diagonal one sqrt(2). The cell it leads to must be
        free; for a diagonal step, so must both cells beside it.

        Args:
            free: (rows, columns) of this search's shape.
            start, goal: Free cells.
            extra: (rows, columns) extra cost per cell of length, in units of 1 / `EXTRA_UNIT`. A step of length s from
                a cell with extra cost e to one with f costs s (1 + (e + f) / 2).
            ends: Not used: ways on cells lead from centre to centre, wherever in its cell the robot is.

        Raises:
            ValueError: The grid has another shape, or the start or goal is outside or not free.
        """
        self._check(free, start, goal, extra)
        np.logical_not(free, out=self.wall[1:-1, 1:-1])
        parts, factor = 1, 1
        if extra is not None:
            self.extra[1:-1, 1:-1] = extra
            parts, factor = 2 * EXTRA_UNIT, 2 * EXTRA_UNIT + 2 * int(extra.max())
        q, p = step_costs(free.size * factor)
        self._renew(2 * (free.size + 2) * factor * p)
        stride = self.shape[1] + 2
        first, last = ((row + 1) * stride + column + 1 for row, column in (start, goal))
        shift = max(0, (parts * q // 5).bit_length() - 1)
        buckets = 1 << ((2 * factor * p >> shift) + 2).bit_length()
        ahead = (q * parts, (p - q) * parts) if self._looks_ahead else (0, 0)
        weights = None if extra is None else self.extra.reshape(-1)
        found = _search(self.wall, weights, self._cost, self._arrival, self._before, self._after, buckets, first, last,
                        self._base, self._top, q * parts, p * parts, q, p, *ahead, shift)  # fmt: skip
        if not found:
            return self._nearest(goal)
        cells, diagonal = _trace(self._arrival, stride, first, last)
        straight = len(cells) - 1 - diagonal
        cost = straight + diagonal * math.sqrt(2.0) if extra is None else _cost_of(cells, extra)
        return Way(cells, straight, diagonal, cost)

    def _check(self, free: Bools, start: Cell, goal: Cell, extra: NDArray[np.uint8] | None) -> None:
        for name, array in (("free", free), ("extra", extra)):
            if array is not None and array.shape != self.shape:
                raise ValueError(f"{name}: got a grid of shape {array.shape}, expected {self.shape}")
        for name, (row, column) in (("start", start), ("goal", goal)):
            if not (0 <= row < self.shape[0] and 0 <= column < self.shape[1] and free[row, column]):
                raise ValueError(f"{name}: got cell {(row, column)}, expected a free one within {self.shape}")

    def _renew(self, span: int) -> None:
        """Reserve a range of costs below those of all earlier queries: from `base` up to, not including, `top`."""
        if self._base - span < -_LARGEST:
            self._cost.fill(0)
            self._base = 0
        self._base, self._top = self._base - span, self._base

    def _nearest(self, goal: Cell) -> Closed:
        cost = self._cost.reshape(self.wall.shape)[1:-1, 1:-1]
        rows, columns = np.nonzero(cost < self._top)
        distances = (rows - goal[0]) ** 2 + (columns - goal[1]) ** 2
        best = np.lexsort((columns, rows, cost[rows, columns], distances))[0]
        return Closed((int(rows[best]), int(columns[best])))


class DijkstraSearch(GridSearch):
    """The same search without the heuristic (Dijkstra 1959): same costs, but it expands many more cells."""

    _looks_ahead = False


def _cost_of(cells: NDArray[np.int64], extra: NDArray[np.uint8]) -> float:
    lengths = np.where((np.diff(cells, axis=0) != 0).all(axis=1), math.sqrt(2.0), 1.0)
    ground = extra[cells[:, 0], cells[:, 1]] / EXTRA_UNIT
    return float((lengths * (1.0 + 0.5 * (ground[1:] + ground[:-1]))).sum())


@njit(cache=True, nogil=True, error_model="numpy")
def _search(
    wall: Bools, extra: NDArray[np.uint8] | None, cost: NDArray[np.int64], arrival: NDArray[np.uint8],
    before: NDArray[np.int32], after: NDArray[np.int32], buckets: int, start: Index, goal: int, base: int, top: int,
    straight: int, diagonal: int, q: int, p: int, ahead_long: int, ahead_short: int, shift: int,
) -> bool:  # fmt: skip
    """Fill `cost` and `arrival` from the start until those of the goal are final. Returns whether it was reached.

    The heuristic is `ahead_long` per cell along the longer side of the box from a cell to the goal, plus `ahead_short`
    per cell along the shorter side. With q and p - q it is the octile distance; with 0 and 0 there is no heuristic.

    `before` and `after` link the cells of a bucket, whose head is element `size + bucket`. A cell in no bucket has -1
    in `before`. `held` is the next cell of the current bucket; it skips the list to save time.
    """
    mask, stride, size, walls = buckets - 1, wall.shape[1], wall.size, wall.reshape(-1)
    offsets = _ROW_STEP * stride + _COLUMN_STEP
    beside, beyond = offsets.copy(), offsets.copy()  # the cells beside a diagonal step
    for n in range(1, 8, 2):
        beside[n], beyond[n] = offsets[n - 1], offsets[(n + 1) & 7]
    goal_row, goal_column = goal // stride, goal % stride
    down, across = abs(start // stride - goal_row), abs(start % stride - goal_column)
    bottom = base + ahead_long * max(down, across) + ahead_short * min(down, across)
    for head in range(size, size + buckets):
        before[head], after[head] = head, head
    cost[start], arrival[start], before[start] = base, _START, _CLOSED
    bucket, empty, held = 0, 0, start
    while empty < buckets and bottom + (bucket << shift) < cost[goal]:
        cell, held = held, 0
        if cell == 0:
            head = size + (bucket & mask)
            cell = np.int64(after[head])
            if cell == head:
                bucket += 1
                empty += 1
                continue
            empty, second = 0, after[cell]
            after[head], before[second], before[cell] = second, head, _CLOSED
        row = np.int64(np.uint32(cell) // np.uint32(stride))
        case: Index = 4 * _START
        column, sofar = cell - row * stride, cost[cell]
        if extra is None and arrival[cell] != _START:
            k = np.int64(arrival[cell])
            case = 4 * k
            if not k & 1:
                parent = cell - offsets[k]
                case += walls[parent + offsets[(k + 2) & 7]] + 2 * walls[parent + offsets[(k - 2) & 7]]
        for n in range(_COUNTS[case]):
            k = _CHOICES[np.uint64(case), np.uint64(n)]
            other = np.uint64(cell + offsets[k])
            if walls[other] or walls[np.uint64(cell + beside[k])] or walls[np.uint64(cell + beyond[k])]:
                continue
            reached, known = sofar + (diagonal if k & 1 else straight), cost[other]
            if extra is not None:
                reached += (p if k & 1 else q) * (np.int64(extra[cell]) + extra[other])
            if reached >= known:
                continue
            if known < top and before[other] != _CLOSED:
                after[before[other]], before[after[other]] = after[other], before[other]
            cost[other], arrival[other] = reached, k
            down, across = abs(row + _ROW_STEP[k] - goal_row), abs(column + _COLUMN_STEP[k] - goal_column)
            ahead = ahead_long * max(down, across) + ahead_short * min(down, across)
            place = (reached + ahead - bottom) >> shift
            if place == bucket and n + 1 == _COUNTS[case]:
                held, before[other] = np.int64(other), _CLOSED
                continue
            head = size + (place & mask)
            second = after[head]
            before[other], after[other], before[second], after[head] = head, second, other, other
    is_reached: bool = cost[goal] < top
    return is_reached


@njit(cache=True, nogil=True)
def _trace(arrival: NDArray[np.uint8], stride: int, start: int, goal: int) -> tuple[NDArray[np.int64], int]:
    """(n, 2) rows and columns of the way from the start, not counting the border, and its number of diagonal steps."""
    count, diagonal, cell = 1, 0, goal
    while cell != start:
        k = arrival[cell]
        cell -= _ROW_STEP[k] * stride + _COLUMN_STEP[k]
        count, diagonal = count + 1, diagonal + (k & 1)
    way, cell = np.empty((count, 2), np.int64), goal
    for n in range(count - 1, -1, -1):
        way[n, 0], way[n, 1] = cell // stride - 1, cell % stride - 1
        k = arrival[cell] & 7
        cell -= _ROW_STEP[k] * stride + _COLUMN_STEP[k]
    return way, diagonal


def warm_up() -> None:
    """Compile all kernels, with and without extra costs."""
    free = np.ones((2, 2), dtype=np.bool_)
    GridSearch((2, 2)).shortest(free, (0, 0), (1, 1))
    GridSearch((2, 2)).shortest(free, (0, 0), (1, 1), np.zeros((2, 2), dtype=np.uint8))
