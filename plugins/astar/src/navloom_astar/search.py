"""A* on an 8-connected grid without corner cutting (Hart, Nilsson & Raphael 1968), optimal in exact arithmetic.

Without the heuristic, the same search is Dijkstra's (1959). It runs from the goal to the start, so that the costs that
it finds are those from each cell to the goal.

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
cell keeps at least one shortest way without a pruned step. The other way leads over neighbours of the cell, so with
extra costs the argument holds where all neighbours cost the same. Elsewhere all eight successors are tried.

**The open list** is a ring of buckets over f, about 0.1 to 0.2 cells wide, each last in, first out. A cell is opened
again when a shorter way to it is found; its old entry is skipped, since its cost is no longer the cell's. The
heuristic is consistent, so f never falls below the lower bound of the current bucket. Once that bound is above the cost
of the start, the costs of all cells on all shortest ways are final.

**One of the shortest ways.** So the way does not depend on the order of the search: from the start on, each step is the
first one, counted from the direction of the last, whose cost and the cost from its end sum to the cost of the cell. If
the way is as short as on an empty grid, the search ends when it reaches the start, and the way is the first of those of
that length, again by the direction of the last step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navloom_astar.expansion import (
    direct_way,
    expand,
    far_index,
    nearest,
    new_open_list,
    set_mixed,
    set_steps,
    way_down,
)
from navloom_astar.repair import changed_cells, reopened

__all__ = ["EXTRA_UNIT", "Cell", "Closed", "DijkstraSearch", "Ends", "GridSearch", "Way", "step_costs", "warm_up"]

Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Cell = tuple[int, int]
"""Row and column."""
Index = int | np.int64
"""Index of a cell or a direction: kernels mix both integer types."""
Ends = tuple[tuple[float, float], tuple[float, float]]
"""x, y of start and goal, cells: the cell (row, column) spans column..column + 1 by row..row + 1."""

EXTRA_UNIT = 8
"""Parts per unit of extra cost: extra costs are whole eighths."""

_LARGEST = 1 << 62
_MOST_CHANGED, _MOST_FORGOTTEN = 0.05, 0.05
"""Shares of a grid's cells that may change, and that may lose their costs by that, for a repair, not a new search."""


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


class _Scale(NamedTuple):
    """Whole numbers in which costs are counted: see `expansion.expand`.

    `straight` and `diagonal` are the costs of a step, `q` and `p` those of each unit of extra cost at either end of it;
    `span` is more than any way costs.
    """

    straight: int
    diagonal: int
    q: int
    p: int
    shift: int
    buckets: int
    span: int

    @property
    def octile(self) -> tuple[int, int]:
        """Costs of a straight step, and of a diagonal one in its place: the octile distance."""
        return self.straight, self.diagonal - self.straight


def _scale(cells: int, extra: int | None) -> _Scale:
    """The scale for a grid with that many cells and that largest extra cost, if there are any."""
    parts, factor = (1, 1) if extra is None else (2 * EXTRA_UNIT, 2 * EXTRA_UNIT + 2 * extra)
    q, p = step_costs(cells * factor)
    shift = max(0, (parts * q // 2).bit_length() - 1)
    buckets = 1 << ((2 * factor * p >> shift) + 2).bit_length()
    return _Scale(q * parts, p * parts, q, p, shift, buckets, 2 * (cells + 2) * factor * p)


class GridSearch:
    """A* on grids of one size. It reuses its work arrays without clearing them between queries.

    The costs of a query are below all costs of earlier queries, so old values read as "not yet reached". If the goal
    is that of the last query and few cells have changed, the costs of that query are repaired instead; see `repair`.
    The way is the same as that of a new search, cell by cell.

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
        self.extra, self._mixed, self._steps = (np.zeros(padded, dtype=np.uint8) for _ in range(3))
        self._cost = np.zeros(size, dtype=np.int64)
        self._open = new_open_list(size)
        self._base = self._top = self._used = 0
        self._kept: tuple[int, _Scale] | None = None

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
        stride = self.shape[1] + 2
        first, last = ((row + 1) * stride + column + 1 for row, column in (start, goal))
        scale, weights = _scale(free.size, None if extra is None else int(extra.max())), None
        if extra is not None:
            weights = self.extra
        changed = self._changed(free, extra) if self._kept == (last, scale) else None
        self._take(free, extra, changed)
        self._kept = last, scale
        if changed is None or not self._repair(scale, weights, last, first, changed):
            self._search(scale, weights, last, first, self._looks_ahead)
        if self._cost[first] >= self._top:
            return Closed(self._nearest(scale, weights, first, last))
        if self._cost[first] - self._base == far_index(first, last, stride, *scale.octile):
            cells, diagonal = direct_way(self._steps, weights, first, last)
        else:
            cells, diagonal = way_down(self._steps, weights, self._cost, first, last, *scale[:4])
        straight = len(cells) - 1 - diagonal
        cost = straight + diagonal * math.sqrt(2.0) if extra is None else _cost_of(cells, extra)
        return Way(cells, straight, diagonal, cost)

    def _search(self, scale: _Scale, extra: Bytes | None, source: int, target: int, looks_ahead: bool) -> None:
        """Find the costs to the source from all cells on shortest ways to it."""
        seeds, self._used = np.array([source]), -1
        while True:
            self._renew(scale.span)
            self._cost[source] = self._base
            if self._expand(scale, extra, seeds, source, target, looks_ahead):
                return
            self._open = new_open_list(2 * len(self._open[0]))

    def _expand(
        self, scale: _Scale, extra: Bytes | None, seeds: NDArray[np.int64], source: int, target: int, looks_ahead: bool
    ) -> bool:
        """Go on from open cells. Returns whether the open list was long enough."""
        ahead = scale.octile if looks_ahead else (0, 0)
        self._used = expand(self._steps, extra, self._mixed, self._cost, self._open, scale.buckets, seeds, source,
                            target, *scale[:4], *ahead, scale.shift)  # fmt: skip
        return self._used >= 0

    def _nearest(self, scale: _Scale, extra: Bytes | None, first: int, last: int) -> Cell:
        self._kept = None
        self._renew(scale.span)
        cells = nearest(self._steps, self._cost, self._base, first, last).tolist()
        costs = []
        for cell in cells if len(cells) > 1 else ():
            self._search(scale, extra, cell, first, self._looks_ahead)
            costs.append(int(self._cost[first]) - self._base)
        row, column = divmod(min(zip(costs, cells, strict=True))[1] if costs else cells[0], self.shape[1] + 2)
        return row - 1, column - 1

    def _changed(self, free: Bools, extra: Bytes | None) -> NDArray[np.int64] | None:
        cells = free.view(np.uint8), self.wall.view(np.uint8)
        return changed_cells(*cells, extra, self.extra, int(_MOST_CHANGED * free.size))

    def _take(self, free: Bools, extra: Bytes | None, changed: NDArray[np.int64] | None) -> None:
        """Store a grid: all of it, or the box around the cells that have changed."""
        if changed is None:
            low, left, (high, right) = 1, 1, self.shape
        elif len(changed):
            low, high, left, right = changed[0, 0], changed[-1, 0], changed[:, 1].min(), changed[:, 1].max()
        else:
            return
        here, there = np.s_[low : high + 1, left : right + 1], np.s_[low - 1 : high, left - 1 : right]
        np.logical_not(free[there], out=self.wall[here])
        # The steps of a cell depend on its neighbours.
        box = max(low - 1, 1), min(high + 1, self.shape[0]) + 1, max(left - 1, 1), min(right + 1, self.shape[1]) + 1
        set_steps(self.wall, self._steps, *box)
        if extra is not None:
            self.extra[here] = extra[there]
            set_mixed(self.extra, self._mixed, *box)

    def _repair(self, scale: _Scale, extra: Bytes | None, source: int, target: int, changed: NDArray[np.int64]) -> bool:
        """Make the costs of the last search to the same goal those of this one. Returns whether that was possible."""
        most = int(_MOST_FORGOTTEN * self._cost.size)
        seeds = reopened(self._steps, extra, self._cost, self._open, self._used, changed, source, self._top, *scale[:4],
                         most)  # fmt: skip
        return seeds is not None and self._expand(scale, extra, seeds, source, target, self._looks_ahead)

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


class DijkstraSearch(GridSearch):
    """The same search without the heuristic (Dijkstra 1959): same ways, but it expands many more cells."""

    _looks_ahead = False


def _cost_of(cells: NDArray[np.int64], extra: NDArray[np.uint8]) -> float:
    lengths = np.where((np.diff(cells, axis=0) != 0).all(axis=1), math.sqrt(2.0), 1.0)
    ground = extra[cells[:, 0], cells[:, 1]] / EXTRA_UNIT
    return float((lengths * (1.0 + 0.5 * (ground[1:] + ground[:-1]))).sum())


def warm_up() -> None:
    """Compile all kernels, with and without extra costs."""
    free = np.ones((2, 2), dtype=np.bool_)
    GridSearch((2, 2)).shortest(free, (0, 0), (1, 1))
    GridSearch((2, 2)).shortest(free, (0, 0), (1, 1), np.zeros((2, 2), dtype=np.uint8))
