"""Kernels that repair the costs of a search after local changes, so that it can continue instead of starting again.

As in dynamic shortest paths (Ramalingam & Reps 1996), a cell keeps its cost if a neighbour still supports it: one whose
cost and the step sum to at most that. A support has a lower cost, so no cells support each other in a circle. Cells
beside changed ones are tested, those without a support are forgotten, and then those are tested that they supported.
Then all costs are those of real ways again, and only cells beside forgotten or changed ones can improve others: these
are opened. The search goes on from them and from the cells
that were still open, until the bound of `search` holds again. (D* Lite, Koenig & Likhachev 2002, does both in one
queue, whose order must then survive moves of the start; here the open list is sorted again, which is cheaper.)
"""

from __future__ import annotations

import numpy as np
from numba import njit

from navloom_astar.expansion import Bytes, Cells, Costs, Index, OpenList

__all__ = ["changed_cells", "reopened"]

_ROW_STEP = np.array((0, 1, 1, 1, 0, -1, -1, -1))
_COLUMN_STEP = np.array((1, 1, 0, -1, -1, -1, 0, 1))


@njit(cache=True, nogil=True, error_model="numpy")
def changed_cells(free: Bytes, wall: Bytes, extra: Bytes | None, known: Bytes, most: int) -> Cells | None:
    """(n, 2) rows and columns, with the border, of the cells whose state or extra cost differs; None if above `most`.

    Args:
        free, extra: (rows, columns) as they are now; free is 0 or 1.
        wall, known: (rows + 2, columns + 2) as they were; wall is 0 or 1.
    """
    found, count = np.empty((most + 1, 2), np.int64), 0
    for row in range(free.shape[0]):
        new, old = free[row], wall[row + 1, 1:-1]
        differs = np.uint8(0)
        for n in range(len(new)):
            differs |= new[n] ^ old[n] ^ np.uint8(1)
        if extra is not None:
            weights, weighed = extra[row], known[row + 1, 1:-1]
            for n in range(len(new)):
                differs |= weights[n] ^ weighed[n]
        if differs == 0:
            continue
        for n in range(len(new)):
            if new[n] == old[n] or (extra is not None and extra[row, n] != known[row + 1, n + 1]):
                if count == most:
                    return None
                found[count, 0], found[count, 1] = row + 1, n + 1
                count += 1
    return found[:count].copy()


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _step(cell: Index, other: Index, k: int, extra: Bytes | None, step: Costs, weight: Costs) -> int:
    """Cost of a step in direction k. `step` and `weight`: (2,) for straight and diagonal ones; see `expansion`."""
    if extra is None:
        return step[k & 1]
    flat = extra.reshape(-1)
    return step[k & 1] + weight[k & 1] * (np.int64(flat[cell]) + np.int64(flat[other]))


@njit(cache=True, nogil=True, error_model="numpy")
def _is_supported(
    cell: Index, known: int, extra: Bytes | None, legal: Bytes, cost: Costs, offsets: Cells, step: Costs, weight: Costs
) -> bool:
    for k in range(8):
        if legal[cell] >> k & 1:
            other = cell + offsets[k]
            if cost[other] < known and cost[other] + _step(cell, other, k, extra, step, weight) <= known:
                return True
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def reopened(
    steps: Bytes, extra: Bytes | None, cost: Costs, opened: OpenList, used: int, changed: Cells, source: Index,
    top: int, straight: int, diagonal: int, q: int, p: int, most: int,
) -> Cells | None:  # fmt: skip
    """Forget the costs that changes have made void.

    Args:
        steps, extra: (rows, columns) as they are now.
        opened, used: The open list and the number of its entries.
        changed: (n, 2) rows and columns, with the border.
        most: Largest number of cells to forget.

    Returns:
        (n,) open cells; None if more would have to be forgotten, or if the source has changed.
    """
    stride, legal = np.int64(steps.shape[1]), steps.reshape(-1)
    step, weight = np.array((straight, diagonal)), np.array((q, p))
    offsets, centre = _ROW_STEP * stride + _COLUMN_STEP, np.zeros(1, np.int64)
    around = np.concatenate((centre, offsets))
    doubtful = [np.int64(0) for _ in range(0)]
    beside = [np.int64(0) for _ in range(0)]
    for row, column in changed:
        cell = row * stride + column
        if cell == source:
            return None
        beside.append(cell)
        for offset in around:
            if cost[cell + offset] < top:
                doubtful.append(cell + offset)
    forgotten = 0
    while doubtful:
        cell = doubtful.pop()
        known = cost[cell]
        if known >= top or cell == source or _is_supported(cell, known, extra, legal, cost, offsets, step, weight):
            continue
        if forgotten == most:
            return None
        forgotten += 1
        cost[cell] = top
        beside.append(cell)
        for k in range(8):
            other = cell + offsets[k]
            if (
                legal[cell] >> k & 1
                and cost[other] < top
                and known + _step(cell, other, k, extra, step, weight) <= cost[other]
            ):
                doubtful.append(other)
    again = [np.int64(0) for _ in range(0)]
    for cell in beside:
        for offset in around:
            if cost[cell + offset] < top:
                again.append(cell + offset)
    seeds, count = np.empty(used + len(again), np.int64), 0
    for cell in again:
        seeds[count] = cell
        count += 1
    if count:
        seeds[:count].sort()
        last, count = count, 0
        for n in range(last):
            if n == 0 or seeds[n] != seeds[count - 1]:
                seeds[count] = seeds[n]
                count += 1
    entries, _, costs = opened
    for slot in range(used):
        cell = entries[slot] >> 8
        if costs[slot] < top and costs[slot] == cost[cell]:
            seeds[count] = cell
            count += 1
    return seeds[:count].copy()
