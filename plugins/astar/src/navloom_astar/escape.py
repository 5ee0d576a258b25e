"""Leaving the inflation: a robot that stands nearer to an obstacle than its inflation allows still wants to go."""

from __future__ import annotations

import heapq
import math

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
    # No diagonal step without both straight ones: what is connected is so by straight steps.
    parts, _ = ndimage.label(traversable)
    parents, distances = _explore(occupied, start, within)
    exits = [cell for cell in parents if traversable[cell]]
    if not exits:
        return None
    connected = [cell for cell in exits if parts[cell] == parts[goal]]
    cell = min(connected or exits, key=lambda at: (distances[at], at))
    way = [cell]
    while way[-1] != start:
        way.append(parents[way[-1]])
    way.reverse()
    return way


def _explore(occupied: Bools, start: Cell, within: float) -> tuple[dict[Cell, Cell], dict[Cell, float]]:
    """Parents of all cells within a distance, and their distances, cells."""
    rows, columns = occupied.shape
    distances, parents, heap = {start: 0.0}, {start: start}, [(0.0, start)]
    while heap:
        distance, (row, column) = heapq.heappop(heap)
        if distance > distances[row, column]:
            continue
        for down, across in _STEPS:
            other, further = (row + down, column + across), distance + math.hypot(down, across)
            if not (0 <= other[0] < rows and 0 <= other[1] < columns) or further > within + 1e-9:
                continue
            if occupied[other] or occupied[row, other[1]] or occupied[other[0], column]:
                continue
            if further < distances.get(other, math.inf) - 1e-9:
                distances[other], parents[other] = further, (row, column)
                heapq.heappush(heap, (further, other))
    return parents, distances
