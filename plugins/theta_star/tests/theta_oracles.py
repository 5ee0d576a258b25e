"""Shortest any-angle paths on small grids, by visibility graphs that are independent of the searches."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

Bools = NDArray[np.bool_]
Cell = tuple[int, int]


def is_touched(cells: NDArray[np.int64], a: NDArray[np.int64], b: NDArray[np.int64]) -> Bools:
    """Which closed cells (n, 2) the segment from the centre of cell a to that of b meets.

    Exact, in whole half cells: by x, by y, and across the segment (separating axes).
    """
    middle, low, high = 2 * cells, np.minimum(2 * a, 2 * b), np.maximum(2 * a, 2 * b)
    near = ((middle + 1 >= low) & (middle - 1 <= high)).all(axis=1)
    along = 2 * (b - a)
    offset = middle - 2 * a
    across = np.abs(along[0] * offset[:, 1] - along[1] * offset[:, 0])
    return near & (across <= np.abs(along).sum())


def shortest_over_centres(free: Bools, start: Cell) -> NDArray[np.float64]:
    """(rows, columns) lengths, cells, of the shortest paths from a cell that turn at centres of free cells."""
    cells, walls = np.argwhere(free), np.argwhere(~np.pad(free, 1)) - 1
    links = [
        (i, j, math.dist(cells[i], cells[j]))
        for i in range(len(cells))
        for j in range(i)
        if not is_touched(walls, cells[i], cells[j]).any()
    ]
    origins, targets, lengths = np.array(links or np.empty((0, 3))).reshape(-1, 3).T
    graph = csr_array((lengths, (origins.astype(int), targets.astype(int))), shape=(len(cells), len(cells)))
    found = np.full(free.shape, np.inf)
    found[tuple(cells.T)] = dijkstra(graph, directed=False, indices=cells.tolist().index(list(start)))
    return found


def shortest_at_all(free: Bools, start: Cell, goals: list[Cell]) -> NDArray[np.float64]:
    """(n,) lower bounds, cells, of the length of any path of a point within the free cells.

    The paths turn at obstacles' corners and may run along walls, but not through a corner where two obstacles meet.
    """
    wall = ~np.pad(free, 1)
    corners = [
        (row, column)
        for row in range(1, wall.shape[0])
        for column in range(1, wall.shape[1])
        if wall[row - 1 : row + 1, column - 1 : column + 1].sum() == 1
    ]
    ends = [(row + 1.5, column + 1.5) for row, column in (start, *goals)]
    places = np.array(ends + corners, dtype=np.float64)
    lengths = [
        (i, j, math.dist(places[i], places[j]))
        for i in range(len(places))
        for j in range(i)
        if _is_passable(wall, places[i], places[j])
    ]
    origins, targets, weights = np.array(lengths or np.empty((0, 3))).reshape(-1, 3).T
    graph = csr_array((weights, (origins.astype(int), targets.astype(int))), shape=(len(places), len(places)))
    return dijkstra(graph, directed=False, indices=0)[1 : 1 + len(goals)]


def _is_passable(wall: Bools, a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Whether a segment avoids the interiors of walls, the edges between two walls, and corners where two meet."""
    step = b - a
    shares = [0.0, 1.0]
    for axis in range(2):
        if step[axis] != 0.0:
            lines = np.arange(math.ceil(min(a[axis], b[axis])), math.floor(max(a[axis], b[axis])) + 1)
            shares += ((lines - a[axis]) / step[axis]).tolist()
    shares = sorted(shares)
    for share in shares[1:-1]:
        row, column = (a + share * step).round(9)
        if 1e-9 < share < 1.0 - 1e-9 and row % 1 == 0.0 and column % 1 == 0.0:
            quarter = wall[int(row) - 1 : int(row) + 1, int(column) - 1 : int(column) + 1]
            if quarter[0, 0] == quarter[1, 1] != quarter[0, 1] == quarter[1, 0]:
                return False
    for low, high in pairwise(shares):
        if high - low > 1e-9:
            row, column = (a + 0.5 * (low + high) * step).round(9)
            rows = {int(row), int(row) - (row % 1 == 0.0)}
            columns = {int(column), int(column) - (column % 1 == 0.0)}
            if all(wall[r, c] for r in rows for c in columns):
                return False
    return True
