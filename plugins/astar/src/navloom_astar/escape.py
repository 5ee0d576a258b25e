"""Leave the inflation: plan for a robot that starts closer to an obstacle than the inflation allows."""

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
    """The shortest way from a cell to the nearest traversable cell that is connected with the goal.

    If no such cell is within the distance, the way leads to the nearest traversable cell. The way keeps out of
    obstacles and does not cut their corners (Dijkstra 1959).

    Args:
        occupied: (rows, columns) obstacles as they are.
        traversable: (rows, columns) cells outside the obstacles after these are grown by the robot.
        start, goal: Cells; the goal is traversable.
        within: Longest way out, cells.

    Returns:
        Cells from the start to the first traversable one, or None if there is none within that distance.
    """
    parents = {start: start}
    nearest, is_connected = None, None
    for cell in _explore(occupied, parents, start, within):
        if not traversable[cell]:
            continue
        nearest = cell if nearest is None else nearest
        # Made when it is first needed, since it labels most of the map.
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
    """A function that returns whether a traversable cell is connected with the goal. At least one cell must be blocked.

    Only the box around the blocked cells is labelled, enlarged by one cell on each side. All cells outside the enlarged
    box are free. So a way outside can be replaced by one along the edge of the box, and a cell outside is connected
    with the nearest cell of that edge and shares its label.
    """
    rows, columns = (np.flatnonzero((~traversable).any(axis=axis)) for axis in (1, 0))
    low, left = max(int(rows[0]) - 1, 0), max(int(columns[0]) - 1, 0)
    # A diagonal step needs both cells beside it, so straight steps alone connect the same cells.
    parts, _ = ndimage.label(traversable[low : rows[-1] + 2, left : columns[-1] + 2])
    high, right = parts.shape[0] - 1, parts.shape[1] - 1

    def part(cell: Cell) -> int:
        return int(parts[min(max(cell[0] - low, 0), high), min(max(cell[1] - left, 0), right)])

    wanted = part(goal)
    return lambda cell: part(cell) == wanted


def _explore(occupied: Bools, parents: dict[Cell, Cell], start: Cell, within: float) -> Iterator[Cell]:
    """Yield the cells within a distance, cells, nearest first; ties go by row, then column. Fills `parents`."""
    rows, columns = occupied.shape
    distances, heap = {start: 0.0}, [(0.0, start)]
    while heap:
        distance, (row, column) = heapq.heappop(heap)
        # An old entry: heapq cannot change one that is in the heap, so a shorter way adds another.
        if distance > distances[row, column]:
            continue
        yield row, column
        for down, across in _STEPS:
            other, further = (row + down, column + across), distance + math.hypot(down, across)
            if not (0 <= other[0] < rows and 0 <= other[1] < columns) or further > within + 1e-9:
                continue
            if occupied[other] or occupied[row, other[1]] or occupied[other[0], column]:
                continue
            # Sums of the same steps in another order differ by rounding, which must not decide a tie.
            if further < distances.get(other, math.inf) - 1e-9:
                distances[other], parents[other] = further, (row, column)
                heapq.heappush(heap, (further, other))
