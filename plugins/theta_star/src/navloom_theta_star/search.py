"""Theta* and Lazy Theta* on the cells of a grid.

Both are A* on an 8-connected grid without corner cutting, in which a cell's parent need not be its neighbour: a cell is
offered the parent of the neighbour that is expanded, from which the way is never longer. **Theta*** (Nash, Daniel,
Koenig & Felner 2007) makes sure at once that the parent is in sight. **Lazy Theta*** (Nash, Koenig & Tovey 2010) takes
it for granted until the cell is to be expanded; if it turns out not to be, the best neighbour is the parent.

**Never longer than A*.** Cells are opened again when a shorter way to them turns up, and in Lazy Theta* a cell whose
cost had to be corrected goes back to the open list. Hence each cell on a shortest way over neighbouring cells is open,
or was expanded, with no more than its cost on that way, and the answer is no longer than it. (The papers close cells
for good; straight-line distance is consistent for neighbours only, and there are grids on which A* is then shorter.)
Lazy Theta* checks the sight at once where the cell's present cost is known to be good: so that cost is never lost.

On ground of unequal cost a segment costs its integral, and a cell is offered both ways: straight on may be dearer.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from navloom_astar.search import EXTRA_UNIT, Cell, Closed, Ends, GridSearch
from numba import njit
from numpy.typing import NDArray

from navloom_theta_star.sight import ground_cost, is_in_sight

__all__ = ["LazyThetaSearch", "Taut", "ThetaSearch", "warm_up"]

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

_ROW_STEP = np.array((0, 1, 1, 1, 0, -1, -1, -1))
_COLUMN_STEP = np.array((1, 1, 0, -1, -1, -1, 0, 1))
"""Directions: even ones are straight, odd ones diagonal."""
_SAME = 1e-9
"""Costs are different from this on, cells: equal ways must not reopen each other by their rounding."""


@dataclass(frozen=True, eq=False)
class Taut:
    """An any-angle way.

    Attributes:
        cells: (n, 2) rows and columns of its ends and turns, int64.
        length: Between the ends that were asked for, over the centres of the turns' cells, cells.
        cost: Integral of 1 + extra along it, cells; the length where nothing is extra.
        expanded: How many cells were expanded, each as often as it was.
    """

    cells: NDArray[np.int64]
    length: float
    cost: float
    expanded: int


class ThetaSearch:
    """Theta* on grids of one size."""

    _is_lazy = False

    def __init__(self, shape: tuple[int, int]) -> None:
        self.shape = shape
        self._on_cells = GridSearch(shape)
        padded = (shape[0] + 2, shape[1] + 2)
        self._wall = np.ones(padded, dtype=np.bool_)
        self._extra = np.zeros(padded, dtype=np.uint8)
        self._cost = np.zeros(padded[0] * padded[1])
        self._parent = np.zeros(padded[0] * padded[1], dtype=np.int64)
        self._known = np.zeros(padded[0] * padded[1], dtype=np.bool_)

    def shortest(
        self, free: Bools, start: Cell, goal: Cell, extra: NDArray[np.uint8] | None = None, ends: Ends | None = None
    ) -> Taut | Closed:
        """A short way between two cells, by straight segments that touch free cells only.

        A* is asked first whether there is a way at all: where there is none, it knows so far sooner.

        Args:
            free: (rows, columns) of this search's shape.
            start, goal: Free cells.
            extra: (rows, columns) cost of the ground besides its length, in `EXTRA_UNIT` parts of it.
            ends: x, y of the ends in their cells, cells; default: the centres.

        Raises:
            ValueError: A grid of another shape, or a start or goal that is outside or not free.
        """
        on_cells = self._on_cells.shortest(free, start, goal, extra)
        if isinstance(on_cells, Closed):
            return on_cells
        np.logical_not(free, out=self._wall[1:-1, 1:-1])
        weights = None
        if extra is not None:
            self._extra[1:-1, 1:-1] = extra
            weights = self._extra
        self._cost.fill(np.inf)
        self._known.fill(False)
        stride = self.shape[1] + 2
        first, last = ((row + 1) * stride + column + 1 for row, column in (start, goal))
        centres = tuple((column + 0.5, row + 0.5) for row, column in (start, goal))
        places = np.array(centres if ends is None else ends) + 1.0
        expanded = _search(self._wall, weights, self._cost, self._parent, self._known, first, last, places,
                           self._is_lazy)  # fmt: skip
        turns = [last]
        while turns[-1] != first:
            turns.append(int(self._parent[turns[-1]]))
        cells = np.stack(np.divmod(np.array(turns[::-1], dtype=np.int64), stride), axis=-1) - 1
        corners = np.concatenate([places[:1], cells[1:-1, ::-1] + 1.5, places[1:]])
        length = float(np.hypot(*np.diff(corners, axis=0).T).sum())
        cost = (
            length if weights is None else sum(ground_cost(weights, EXTRA_UNIT, *a, *b) for a, b in pairwise(corners))
        )
        return Taut(cells, length, cost, int(expanded))


class LazyThetaSearch(ThetaSearch):
    """Lazy Theta* on grids of one size."""

    _is_lazy = True


@njit(cache=True, nogil=True, error_model="numpy")
def _place(cell, stride, start, goal, places):  # type: ignore[no-untyped-def]
    """x, y of a cell: its centre, or the end that lies in it."""
    if cell == start:
        return places[0, 0], places[0, 1]
    if cell == goal:
        return places[1, 0], places[1, 1]
    return cell % stride + 0.5, cell // stride + 0.5


@njit(cache=True, nogil=True, error_model="numpy")
def _along(extra, x0, y0, x1, y1):  # type: ignore[no-untyped-def]
    """Cost of a segment, cells."""
    if extra is None:
        return math.hypot(x1 - x0, y1 - y0)
    return ground_cost(extra, EXTRA_UNIT, x0, y0, x1, y1)


@njit(cache=True, nogil=True, error_model="numpy")
def _take_neighbour(cell, walls, extra, cost, parent, known, stride, start, goal, places):  # type: ignore[no-untyped-def]
    """Make the best neighbour whose cost is known the parent of a cell, and the cell's own cost known."""
    x, y = _place(cell, stride, start, goal, places)
    cost[cell], known[cell] = np.inf, True
    for k in range(8):
        other = cell + _ROW_STEP[k] * stride + _COLUMN_STEP[k]
        if not known[other] or walls[cell + _ROW_STEP[k] * stride] or walls[cell + _COLUMN_STEP[k]]:
            continue
        other_x, other_y = _place(other, stride, start, goal, places)
        reached = cost[other] + _along(extra, other_x, other_y, x, y)
        if reached < cost[cell]:
            cost[cell], parent[cell] = reached, other


@njit(cache=True, nogil=True, error_model="numpy")
def _search(wall, extra, cost, parent, known, start, goal, places, is_lazy):  # type: ignore[no-untyped-def]
    """Fill `cost` and `parent` until the goal's, which can be reached, are final. Number of cells expanded.

    A cell's cost is known when its parent is sure to be in sight or a neighbour.
    """
    stride, walls = np.int64(wall.shape[1]), wall.reshape(-1)
    goal_x, goal_y = places[1, 0], places[1, 1]
    cost[start], parent[start], known[start] = 0.0, start, True
    heap, expanded = [(0.0, 0.0, np.int64(start))], 0
    while heap:
        sofar, cell = heapq.heappop(heap)[1:]
        if sofar != cost[cell]:
            continue
        x, y = _place(cell, stride, start, goal, places)
        origin = parent[cell]
        from_x, from_y = _place(origin, stride, start, goal, places)
        if not known[cell]:
            if is_in_sight(wall, from_x, from_y, x, y):
                known[cell] = True
            else:
                _take_neighbour(cell, walls, extra, cost, parent, known, stride, start, goal, places)
                heapq.heappush(heap, (cost[cell] + math.hypot(x - goal_x, y - goal_y), cost[cell], cell))
                continue
        if cell == goal:
            break
        expanded += 1
        for k in range(8):
            down, across = _ROW_STEP[k] * stride, _COLUMN_STEP[k]
            other = cell + down + across
            if walls[other] or walls[cell + down] or walls[cell + across]:
                continue
            other_x, other_y = _place(other, stride, start, goal, places)
            best, through, is_sure = cost[other] - _SAME, np.int64(-1), True
            reached = cost[origin] + _along(extra, from_x, from_y, other_x, other_y)
            if reached < best and origin != cell:
                is_sure = not is_lazy or known[other]
                if not is_sure or is_in_sight(wall, from_x, from_y, other_x, other_y):
                    best, through = reached, origin
            if through < 0 or extra is not None:
                reached = cost[cell] + _along(extra, x, y, other_x, other_y)
                if reached < best:
                    best, through, is_sure = reached, cell, True
            if through >= 0:
                cost[other], parent[other], known[other] = best, through, is_sure
                ahead = math.hypot(other_x - goal_x, other_y - goal_y)
                heapq.heappush(heap, (best + ahead, best, other))
    return expanded


def warm_up() -> None:
    """Compile the kernels, with and without extra costs."""
    free = np.ones((2, 2), dtype=np.bool_)
    ThetaSearch((2, 2)).shortest(free, (0, 0), (1, 1))
    ThetaSearch((2, 2)).shortest(free, (0, 0), (1, 1), np.zeros((2, 2), dtype=np.uint8))
