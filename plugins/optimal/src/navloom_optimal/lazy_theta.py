"""Any-angle search on the lattice of a map: Lazy Theta* (Nash, Koenig & Tovey, AAAI 2010)."""

from __future__ import annotations

import heapq
import math

import numpy as np
from navloom.geometry.compiled import compiled
from numpy.typing import NDArray

from navloom_optimal.field_space import Field, FieldSpace, segment_is_free_in_field
from navloom_optimal.free_space import TOLERANCE

__all__ = ["any_angle_path"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_REACH = 3
"""Distance from the true start and goal within which the search joins the lattice, lattice steps."""


def any_angle_path(space: FieldSpace, start: Floats, goal: Floats) -> Floats | None:
    """A free path whose corners are lattice nodes, or None if there is none.

    It is never shorter than the shortest path, and the method does not always choose the shortest side of an obstacle.

    Args:
        space: Free space of the disc's centre.
        start, goal: (2,) m, raster frame.

    Returns:
        (n, 2) m, raster frame, with both ends.
    """
    nodes = _search(float(start[0]), float(start[1]), float(goal[0]), float(goal[1]), space.arrays)
    if nodes[0] == -2:
        return None
    cols = space.clear.shape[1]
    inner = np.stack([nodes % cols, nodes // cols], axis=-1) * space.step
    return np.concatenate([start[None], inner[::-1], goal[None]])


@compiled
def _search(sx: float, sy: float, gx: float, gy: float, field: Field) -> Ints:
    """Nodes of the path from the goal to the start; [-2] if there is no path.

    A node's parent is a node, -1 for the true start, or -2 for none. The line of sight to the parent is checked only
    when the node is taken off the heap; without one, the best expanded neighbour becomes the parent.
    """
    step, clear = field[2], field[3]
    cols = clear.shape[1]
    cost = np.full(clear.size, np.inf)
    parent = np.full(clear.size, -2, dtype=np.int64)
    done = np.zeros(clear.size, dtype=np.bool_)
    # The last entry to come off the heap means that there is no path.
    heap = [(np.inf, -1)]
    i, j = round(sy / step), round(sx / step)
    _reach(i, j, _REACH, -1, 0.0, sx, sy, gx, gy, field, cost, parent, done, heap)
    while True:
        n = heapq.heappop(heap)[1]
        if n < 0:
            return np.full(1, -2, dtype=np.int64)
        if done[n]:
            continue
        i, j = n // cols, n % cols
        x, y = j * step, i * step
        px, py = _place(parent[n], sx, sy, cols, step)
        if not segment_is_free_in_field(px, py, x, y, field) and not _take_neighbour(
            n, i, j, field, cost, parent, done
        ):
            continue
        done[n] = True
        if max(abs(x - gx), abs(y - gy)) <= _REACH * step and segment_is_free_in_field(x, y, gx, gy, field):
            break
        p = parent[n]
        px, py = _place(p, sx, sy, cols, step)
        _reach(i, j, 1, p, 0.0 if p < 0 else cost[p], px, py, gx, gy, field, cost, parent, done, heap)
    path = [n]
    while parent[path[-1]] >= 0:
        path.append(parent[path[-1]])
    return np.array(path)


@compiled
def _place(node: int, sx: float, sy: float, cols: int, step: float) -> tuple[float, float]:
    """Position of a node, m; the true start for -1."""
    if node < 0:
        return sx, sy
    return (node % cols) * step, (node // cols) * step


@compiled
def _reach(
    i: int,
    j: int,
    reach: int,
    through: int,
    base: float,
    px: float,
    py: float,
    gx: float,
    gy: float,
    field: Field,
    cost: Floats,
    parent: Ints,
    done: Bools,
    heap: list[tuple[float, int]],
) -> None:
    """Offer the nodes around (i, j) the parent `through`, which is at (px, py) and has the cost `base`, m."""
    step, clear = field[2], field[3]
    rows, cols = clear.shape
    for a in range(max(0, i - reach), min(rows, i + reach + 1)):
        for b in range(max(0, j - reach), min(cols, j + reach + 1)):
            m = a * cols + b
            if done[m] or clear[a, b] < field[7] - TOLERANCE:
                continue
            x, y = b * step, a * step
            total = base + math.hypot(x - px, y - py)
            if total < cost[m]:
                cost[m] = total
                parent[m] = through
                heapq.heappush(heap, (total + math.hypot(x - gx, y - gy), m))


@compiled
def _take_neighbour(n: int, i: int, j: int, field: Field, cost: Floats, parent: Ints, done: Bools) -> bool:
    """Make the best expanded neighbour in sight the parent of node n, at (i, j); False if there is none."""
    step, clear = field[2], field[3]
    rows, cols = clear.shape
    cost[n] = np.inf
    parent[n] = -2
    for a in range(max(0, i - 1), min(rows, i + 2)):
        for b in range(max(0, j - 1), min(cols, j + 2)):
            m = a * cols + b
            total = cost[m] + step * math.hypot(a - i, b - j)
            if done[m] and total < cost[n] and segment_is_free_in_field(b * step, a * step, j * step, i * step, field):
                cost[n] = total
                parent[n] = m
    return bool(parent[n] >= 0)
