"""Leaving the inflation: a robot that stands nearer to an obstacle than its inflation allows still wants to go."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from navloom_astar.search import Cell

__all__ = ["way_out"]

Bools = NDArray[np.bool_]

_STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, -1), (-1, 1))


def way_out(occupied: Bools, traversable: Bools, start: Cell, goal: Cell, within: float) -> list[Cell] | None:
    """The shortest way from a cell to the nearest traversable one, if possible one connected with the goal.

    It keeps out of obstacles and does not cut their corners (Dijkstra 1959).

    Args:
        occupied: (rows, columns) obstacles as they are.
        traversable: (rows, columns) obstacles grown by the robot, inverted.
        start, goal: Cells; the goal is traversable.
        within: Longest way out, cells.

    Returns:
        Cells from the start to the first traversable one, or None where there is none within that distance.
    """
    parents = {start: start}
    nearest, is_connected = None, None
    for cell in _explore(occupied, parents, start, within):
        if not traversable[cell]:
            continue
        nearest = cell if nearest is None else nearest
        is_connected = _connection(traversable, goal) if is_connected is None else is_connected
        if is_connected(cell):
            nearest = cell
            break
    if nearest is None:
        return None
    way = [nearest]
    while way[-1] != start:
        way.append(parents[way[-1]])
    way.reverse()
    return way


def _connection(traversable: Bools, goal: Cell) -> Callable[[Cell], bool]:
    """Whether a traversable cell is connected with the goal, as a function of it. Some cell is not traversable.

    Outside of the box round what is blocked, all cells are connected over those next to the box, as far as they are
    connected there at all. So the box with these is enough, and a cell outside counts as the one next to the box.
    """
    rows, columns = (np.flatnonzero((~traversable).any(axis=axis)) for axis in (1, 0))
    low, left = max(int(rows[0]) - 1, 0), max(int(columns[0]) - 1, 0)
    # No diagonal step without both straight ones: what is connected is so by straight steps.
    parts, _ = ndimage.label(traversable[low : rows[-1] + 2, left : columns[-1] + 2])
    high, right = parts.shape[0] - 1, parts.shape[1] - 1

    def part(cell: Cell) -> int:
        return int(parts[min(max(cell[0] - low, 0), high), min(max(cell[1] - left, 0), right)])

    wanted = part(goal)
    return lambda cell: part(cell) == wanted


def _explore(occupied: Bools, parents: dict[Cell, Cell], start: Cell, within: float) -> Iterator[Cell]:
    """The cells within a distance, cells, the nearest first, of those as near by row and column; fills `parents`."""
    rows, columns = occupied.shape
    distances, heap = {start: 0.0}, [(0.0, start)]
    while heap:
        distance, (row, column) = heapq.heappop(heap)
        if distance > distances[row, column]:
            continue
        yield row, column
        for down, across in _STEPS:
            other, further = (row + down, column + across), distance + math.hypot(down, across)
            if not (0 <= other[0] < rows and 0 <= other[1] < columns) or further > within + 1e-9:
                continue
            if occupied[other] or occupied[row, other[1]] or occupied[other[0], column]:
                continue
            if further < distances.get(other, math.inf) - 1e-9:
                distances[other], parents[other] = further, (row, column)
                heapq.heappush(heap, (further, other))
