"""Theta* and Lazy Theta* on the cells of a grid.

Both are A* on an 8-connected grid without corner cutting, but a cell's parent need not be its neighbour. When a cell is
expanded, each neighbour is offered that cell's parent as its own parent: the way from there is never longer.
**Theta*** (Nash, Daniel, Koenig & Felner 2007) checks at once that this parent is in sight. **Lazy Theta*** (Nash,
Koenig & Tovey 2010) assumes it until the neighbour is expanded itself. If the parent is then not in sight, the best
adjacent cell becomes the parent.

**Never longer than A*.** A cell is reopened when a shorter way to it is found. In Lazy Theta*, a cell whose cost had to
be corrected goes back to the open list. Every cell on a shortest way over neighbouring cells is therefore open or was
expanded, with at most its cost on that way, and the result is no longer than that way. (The papers never reopen a
cell. The straight-line distance is consistent only between neighbours, so on some grids A* then finds a shorter way.)
Lazy Theta* checks the sight at once if the cell's current cost is sure, so a sure cost is never replaced by an assumed
one.

On ground of varying cost, the cost of a segment is the integral along it. A cell is then offered both the expanded cell
and that cell's parent, since the straight segment may cost more.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from navloom_astar.expansion import Index
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
"""Smallest improvement of a cost that counts, cells, so that rounding does not make equal ways reopen each other."""
_NOT_ABOVE = 1.0 - 1e-14
"""Factor that keeps a square root at or below `math.hypot`, however both round. The loss is far below `_SAME`."""
_NEW, _ASSUMED, _SURE = 0, 1, 2
"""States of a cell: not reached; its parent is assumed to be in sight; its parent is in sight or is a neighbour."""


@dataclass(frozen=True, eq=False)
class Taut:
    """An any-angle way.

    Attributes:
        cells: (n, 2) rows and columns of its ends and turns, int64.
        length: Length from the requested start through the centres of the turns' cells to the requested goal, cells.
        cost: Integral of 1 + extra along it, cells; equal to the length if there are no extra costs.
        expanded: Number of expansions; a cell that was reopened counts each time.
    """

    cells: NDArray[np.int64]
    length: float
    cost: float
    expanded: int


class ThetaSearch:
    """Theta* on grids of one size. It reuses its work arrays; each query clears the cells it reached."""

    _is_lazy = False

    def __init__(self, shape: tuple[int, int]) -> None:
        self.shape = shape
        self._on_cells = GridSearch(shape)
        size = self._on_cells.wall.size
        self._cost = np.empty(size)
        self._parent, self._reached = np.empty((2, size), dtype=np.int32)
        self._state = np.zeros(size, dtype=np.uint8)

    def shortest(
        self, free: Bools, start: Cell, goal: Cell, extra: NDArray[np.uint8] | None = None, ends: Ends | None = None
    ) -> Taut | Closed:
        """A short way between two cells, made of straight segments that touch only free cells.

        A* runs first, because it finds out much sooner if there is no way at all.

        Args:
            free: (rows, columns) of this search's shape.
            start, goal: Free cells.
            extra: (rows, columns) extra cost per length, in units of 1 / `EXTRA_UNIT`.
            ends: x, y of start and goal within their cells, cells; default: the centres.

        Raises:
            ValueError: The grid has another shape, or the start or goal is outside or not free.
        """
        on_cells = self._on_cells.shortest(free, start, goal, extra)
        if isinstance(on_cells, Closed):
            return on_cells
        wall, weights = self._on_cells.wall, None if extra is None else self._on_cells.extra
        if extra is not None and not _touches(extra, on_cells.cells):
            # A* keeps out of the ground that costs more. So does this search, which then needs no integrals.
            wall, weights = wall | (self._on_cells.extra > 0), None
        stride = self.shape[1] + 2
        first, last = ((row + 1) * stride + column + 1 for row, column in (start, goal))
        centres = tuple((column + 0.5, row + 0.5) for row, column in (start, goal))
        places = np.array(centres if ends is None else ends) + 1.0
        cells, expanded = _search(wall, weights, self._cost, self._parent, self._state, self._reached, first, last,
                                  places, self._is_lazy)  # fmt: skip
        corners = np.concatenate([places[:1], cells[1:-1, ::-1] + 1.5, places[1:]])
        length = float(np.hypot(*np.diff(corners, axis=0).T).sum())
        cost = (
            length if weights is None else sum(ground_cost(weights, EXTRA_UNIT, *a, *b) for a, b in pairwise(corners))
        )
        return Taut(cells, length, cost, expanded)


def _touches(extra: NDArray[np.uint8], cells: NDArray[np.int64]) -> bool:
    """Whether a cell of a way, or one beside a diagonal step, has an extra cost."""
    rows, columns = cells.T
    return bool(
        extra[rows, columns].any() or extra[rows[:-1], columns[1:]].any() or extra[rows[1:], columns[:-1]].any()
    )


class LazyThetaSearch(ThetaSearch):
    """Lazy Theta* on grids of one size."""

    _is_lazy = True


@njit(cache=True, nogil=True, error_model="numpy")
def _place(cell: Index, stride: Index, start: Index, goal: Index, places: Floats) -> tuple[float, float]:
    """x, y of a cell, cells: its centre, or the start or goal that lies in it."""
    if cell == start:
        return places[0, 0], places[0, 1]
    if cell == goal:
        return places[1, 0], places[1, 1]
    row = np.int64(np.uint32(cell) // np.uint32(stride))
    return cell - row * stride + 0.5, row + 0.5


@njit(cache=True, nogil=True, error_model="numpy")
def _along(extra: NDArray[np.uint8] | None, x0: float, y0: float, x1: float, y1: float) -> float:
    """Cost of a segment, cells."""
    if extra is None:
        return math.hypot(x1 - x0, y1 - y0)
    return ground_cost(extra, EXTRA_UNIT, x0, y0, x1, y1)


@njit(cache=True, nogil=True, error_model="numpy")
def _at_least(x0: float, y0: float, x1: float, y1: float) -> float:
    """Lower bound of `_along` on any ground, cells. It rejects most offers, in a fifth of the time of `math.hypot`."""
    return _NOT_ABOVE * math.sqrt((x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0))


@njit(cache=True, nogil=True, error_model="numpy")
def _take_neighbour(
    cell: Index, walls: Bools, extra: NDArray[np.uint8] | None, cost: Floats, parent: NDArray[np.int32],
    state: NDArray[np.uint8], stride: Index, start: Index, goal: Index, places: Floats,
) -> None:  # fmt: skip
    """Set a cell's parent to the best neighbour whose cost is sure. The cell's cost is then sure too."""
    x, y = _place(cell, stride, start, goal, places)
    cost[cell], state[cell] = np.inf, _SURE
    for k in range(8):
        other = cell + _ROW_STEP[k] * stride + _COLUMN_STEP[k]
        if state[other] != _SURE or walls[cell + _ROW_STEP[k] * stride] or walls[cell + _COLUMN_STEP[k]]:
            continue
        other_x, other_y = _place(other, stride, start, goal, places)
        reached = cost[other] + _along(extra, other_x, other_y, x, y)
        if reached < cost[cell]:
            cost[cell], parent[cell] = reached, other


@njit(cache=True, nogil=True, error_model="numpy")
def _search(
    wall: Bools, extra: NDArray[np.uint8] | None, cost: Floats, parent: NDArray[np.int32], state: NDArray[np.uint8],
    reached_cells: NDArray[np.int32], start: int, goal: int, places: Floats, is_lazy: bool,
) -> tuple[NDArray[np.int64], int]:  # fmt: skip
    """(n, 2) rows and columns of the way, not counting the border, and the number of expansions.

    The goal must be reachable. `state` is `_NEW` everywhere before and after; `cost` and `parent` are valid only where
    it is not. `reached_cells` lists those cells.
    """
    stride, walls, count = np.int64(wall.shape[1]), wall.reshape(-1), 1
    goal_x, goal_y = places[1, 0], places[1, 1]
    cost[start], parent[start], state[start], reached_cells[0] = 0.0, start, _SURE, start
    heap, expanded = [(0.0, 0.0, np.int64(start))], 0
    while heap:
        sofar, cell = heapq.heappop(heap)[1:]
        if sofar != cost[cell]:
            continue
        x, y = _place(cell, stride, start, goal, places)
        origin = np.int64(parent[cell])
        from_x, from_y = _place(origin, stride, start, goal, places)
        if state[cell] != _SURE:
            if is_in_sight(wall, from_x, from_y, x, y):
                state[cell] = _SURE
            else:
                _take_neighbour(cell, walls, extra, cost, parent, state, stride, start, goal, places)
                heapq.heappush(heap, (cost[cell] + math.hypot(x - goal_x, y - goal_y), cost[cell], cell))
                continue
        if cell == goal:
            break
        expanded += 1
        row = np.int64(np.uint32(cell) // np.uint32(stride))
        column = cell - row * stride
        for k in range(8):
            down, across = _ROW_STEP[k] * stride, _COLUMN_STEP[k]
            other = cell + down + across
            if walls[other] or walls[cell + down] or walls[cell + across]:
                continue
            other_x, other_y = column + _COLUMN_STEP[k] + 0.5, row + _ROW_STEP[k] + 0.5
            if other == goal:
                other_x, other_y = goal_x, goal_y
            elif other == start:
                other_x, other_y = places[0, 0], places[0, 1]
            best, through, becomes = np.inf, np.int64(-1), _SURE
            if state[other] != _NEW:
                best = cost[other] - _SAME
            if origin != cell and cost[origin] + _at_least(from_x, from_y, other_x, other_y) < best:
                reached = cost[origin] + _along(extra, from_x, from_y, other_x, other_y)
                if reached < best:
                    becomes = _ASSUMED if is_lazy and state[other] != _SURE else _SURE
                    if becomes == _ASSUMED or is_in_sight(wall, from_x, from_y, other_x, other_y):
                        best, through = reached, origin
            if (through < 0 or extra is not None) and sofar + _at_least(x, y, other_x, other_y) < best:
                reached = sofar + _along(extra, x, y, other_x, other_y)
                if reached < best:
                    best, through, becomes = reached, cell, _SURE
            if through >= 0:
                if state[other] == _NEW:
                    reached_cells[count] = other
                    count += 1
                cost[other], parent[other], state[other] = best, through, becomes
                ahead = math.hypot(other_x - goal_x, other_y - goal_y)
                heapq.heappush(heap, (best + ahead, best, other))
    state[reached_cells[:count]] = _NEW
    return _trace(parent, stride, start, goal), expanded


@njit(cache=True, nogil=True, error_model="numpy")
def _trace(parent: NDArray[np.int32], stride: Index, start: Index, goal: Index) -> NDArray[np.int64]:
    """(n, 2) rows and columns of the ends and turns of the way, not counting the border."""
    count, cell = 1, goal
    while cell != start:
        count, cell = count + 1, np.int64(parent[cell])
    way, cell = np.empty((count, 2), np.int64), goal
    for n in range(count - 1, -1, -1):
        way[n, 0], way[n, 1] = cell // stride - 1, cell % stride - 1
        cell = np.int64(parent[cell])
    return way


def warm_up() -> None:
    """Compile the kernels, with and without extra costs."""
    free = np.ones((2, 2), dtype=np.bool_)
    ThetaSearch((2, 2)).shortest(free, (0, 0), (1, 1))
    ThetaSearch((2, 2)).shortest(free, (0, 0), (1, 1), np.ones((2, 2), dtype=np.uint8))
