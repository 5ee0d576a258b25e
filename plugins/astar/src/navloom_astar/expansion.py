"""Kernels of `search`: the steps of a grid, the expansion of cells, and the way that is read from their costs.

All work on a flat grid with a border of walls. Cells are flat indices. The costs of a query are below `top`; a cell
with another value has not been reached.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["CHOICES", "COUNTS", "START", "direct_way", "expand", "far_index", "nearest", "new_open_list",
           "set_mixed", "set_steps", "way_down"]  # fmt: skip

Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Cells = NDArray[np.int64]
Costs = NDArray[np.int64]
Index = int | np.int64
"""Index of a cell or a direction: kernels mix both integer types."""
OpenList = tuple[Cells, NDArray[np.int32], Costs]
"""Entries of the open list: (n,) 256 x cell + the set of its steps that are not pruned, (n,) links to the next entry of
the bucket, (n,) costs of the cells when they were entered. An entry is void if its cell has another cost now."""

START = 8
"""Direction of arrival of the cell that the search begins from, which has no parent."""
_VOID = 1 << 62
_ROW_STEP = np.array((0, 1, 1, 1, 0, -1, -1, -1))
_COLUMN_STEP = np.array((1, 1, 0, -1, -1, -1, 0, 1))
"""Directions: even ones are straight, odd ones diagonal, anticlockwise."""
_TURNS = np.array((0, 1, -1, 2, -2, 3, -3, 4))
"""Directions relative to that of the last step, in the order in which a way prefers them."""
_LOWEST = np.array([0, *((n & -n).bit_length() - 1 for n in range(1, 256))], dtype=np.uint8)
"""Lowest direction in a set of directions. Bit k of a set is direction k."""


def _successors() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Directions that are not pruned.

    Returns:
        (33, 8) and (33,), indexed by 4 x (direction from the parent) + 1 if a wall is left of the parent + 2 if a wall
        is right of it.
    """
    table, counts = np.zeros((33, 8), np.int64), np.zeros(33, np.int64)
    for case in range(33):
        k, walls = divmod(case, 4)
        if k == START:
            chosen = list(range(8))
        elif k % 2:
            chosen = [k - 1, k + 1, k]
        else:
            chosen = [k + 2, k + 1] * (walls & 1) + [k - 2, k - 1] * (walls >> 1) + [k]
        table[case, : len(chosen)], counts[case] = np.array(chosen) % 8, len(chosen)
    return table, counts


CHOICES, COUNTS = _successors()
_SETS = np.array([
    [
        sum(1 << k for k in CHOICES[case, : COUNTS[case]].tolist())
        for legal in range(256)
        for case in [4 * k + (0 if k % 2 else 3 - (legal >> (k + 2) % 8 & 1) - 2 * (legal >> (k - 2) % 8 & 1))]
    ]
    for k in range(8)
], dtype=np.uint8)  # fmt: skip
"""(8, 256) set of directions that are not pruned after a step in direction k from a cell with a set of legal steps."""


@njit(cache=True, nogil=True, error_model="numpy")
def set_steps(wall: Bools, steps: Bytes, first: int, last: int, left: int, right: int) -> None:
    """Set the legal steps of the cells in rows first..last - 1 and columns left..right - 1, which count the border.

    Args:
        wall: (rows, columns).
        steps: (rows, columns) sets of directions.
    """
    for row in range(first, last):
        out = steps[row, left:right]
        low, level, high = wall[row - 1, left - 1 :], wall[row, left - 1 :], wall[row + 1, left - 1 :]
        for n in range(right - left):
            east, west = np.uint8(not level[n + 2]), np.uint8(not level[n])
            north, south = np.uint8(not high[n + 1]), np.uint8(not low[n + 1])
            legal = east | north << 2 | west << 4 | south << 6
            legal |= (east & north & np.uint8(not high[n + 2])) << 1 | (west & north & np.uint8(not high[n])) << 3
            legal |= (west & south & np.uint8(not low[n])) << 5 | (east & south & np.uint8(not low[n + 2])) << 7
            out[n] = np.uint8(legal) * np.uint8(not level[n + 1])


@njit(cache=True, nogil=True, error_model="numpy")
def set_mixed(extra: Bytes, mixed: Bytes, first: int, last: int, left: int, right: int) -> None:
    """Set `mixed` to 0 where all neighbours of a cell have its extra cost; ranges as in `set_steps`."""
    for row in range(first, last):
        out = mixed[row, left:right]
        low, level, high = extra[row - 1, left - 1 :], extra[row, left - 1 :], extra[row + 1, left - 1 :]
        for n in range(right - left):
            here = level[n + 1]
            other = (low[n] ^ here) | (low[n + 1] ^ here) | (low[n + 2] ^ here) | (level[n] ^ here)
            out[n] = other | (level[n + 2] ^ here) | (high[n] ^ here) | (high[n + 1] ^ here) | (high[n + 2] ^ here)


def new_open_list(size: int) -> OpenList:
    """An open list without entries."""
    return np.empty(size, np.int64), np.empty(size, np.int32), np.empty(size, np.int64)


@njit(cache=True, nogil=True, error_model="numpy")
def far_index(cell: Index, target: Index, stride: Index, ahead_long: int, ahead_short: int) -> int:
    """The heuristic: cost of the way from a cell to the target on an empty grid."""
    row, target_row = np.int64(np.uint32(cell) // np.uint32(stride)), np.int64(np.uint32(target) // np.uint32(stride))
    down, across = abs(row - target_row), abs(cell - row * stride - (target - target_row * stride))
    return ahead_long * max(down, across) + ahead_short * min(down, across)


@njit(cache=True, nogil=True, error_model="numpy")
def expand(
    steps: Bytes, extra: Bytes | None, mixed: Bytes, cost: Costs, opened: OpenList, buckets: int,
    seeds: Cells, source: Index, target: Index, straight: int, diagonal: int, q: int, p: int,
    ahead_long: int, ahead_short: int, shift: int,
) -> int:  # fmt: skip
    """Set `cost` until it is final on all shortest ways from the source to the target.

    A target that is reached at the cost of the heuristic ends the search at once.

    Args:
        steps, extra, mixed: (rows, columns); see `set_steps` and `set_mixed`.
        opened: Its entries are overwritten.
        seeds: (n,) open cells, whose costs are known.
        ahead_long, ahead_short: The heuristic per cell along the longer side of the box from a cell to the target, and
            per cell along the shorter side. With q and p - q it is the octile distance; with 0 and 0 there is none.

    Returns:
        The number of entries of the open list that were used, or -1 if it is too short.
    """
    cells, links, costs = opened
    mask, stride, legal = buckets - 1, np.int64(steps.shape[1]), steps.reshape(-1)
    offsets = _ROW_STEP * stride + _COLUMN_STEP
    target_row, target_column = target // stride, target % stride
    bottom = cost[source] + far_index(source, target, stride, ahead_long, ahead_short)
    if len(seeds) >= len(cells):
        return -1
    most = len(cells) - 1  # one is left for `held`
    heads = np.full(buckets + 1, -1, np.int32)  # the last one holds what is too far for the ring
    used, vacant, empty, held, nothing = np.int64(0), np.int64(-1), 0, np.int64(0), np.int64(_VOID)
    bucket, far = nothing, nothing  # the first place in the ring, and beyond it
    places = np.empty(len(seeds), np.int64)
    for n, cell in enumerate(seeds):
        ahead = far_index(cell, target, stride, ahead_long, ahead_short)
        places[n] = (cost[cell] + ahead - bottom) >> shift
        bucket = min(bucket, places[n])
    for n, cell in enumerate(seeds):
        place = places[n]
        head = place & mask
        if place - bucket >= buckets:
            head, far = np.int64(buckets), min(far, place)
        cells[used], costs[used], links[used], heads[head] = cell << 8 | legal[cell], cost[cell], heads[head], used
        used += 1
    while bucket < nothing and bottom + (bucket << shift) <= cost[target] and cost[target] != bottom:
        if held != 0:
            entry, held = held, np.int64(0)
            cell = entry >> 8
            sofar = cost[cell]
        else:
            slot = np.int64(heads[bucket & mask])
            if slot < 0:
                bucket, empty = bucket + 1, empty + 1
                if empty == buckets:
                    bucket = far
                if bucket == far and far < nothing:
                    empty = 0
                    far = _bring_near(heads, cells, links, costs, bucket, target, stride, ahead_long, ahead_short,
                                      bottom, shift)  # fmt: skip
                continue
            empty, entry, sofar = 0, cells[slot], costs[slot]
            heads[bucket & mask], links[slot], costs[slot], vacant = links[slot], vacant, _VOID, slot
            cell = entry >> 8
            if sofar != cost[cell]:
                continue
        row = np.int64(np.uint32(cell) // np.uint32(stride))
        column, todo, around = cell - row * stride, entry & 255, np.uint64(legal[cell])
        while todo:
            k = np.int64(_LOWEST[np.uint64(todo)])
            todo &= todo - 1
            other = np.uint64(cell + offsets[k])  # unsigned: an index from the end would be tested for
            reached = sofar + (diagonal if k & 1 else straight)
            if extra is not None:
                flat = extra.reshape(-1)
                reached += (p if k & 1 else q) * (np.int64(flat[cell]) + np.int64(flat[other]))
            if reached >= cost[other]:
                continue
            cost[other] = reached
            steps_on = np.int64(legal[other])
            if extra is None or mixed.reshape(-1)[other] == 0:
                steps_on &= np.int64(_SETS[np.uint64(k), around])
            if steps_on == 0:
                continue
            down, across = abs(row + _ROW_STEP[k] - target_row), abs(column + _COLUMN_STEP[k] - target_column)
            place = (reached + ahead_long * max(down, across) + ahead_short * min(down, across) - bottom) >> shift
            if todo == 0 and place == bucket:
                held = np.int64(other) << 8 | steps_on
                continue
            slot = vacant
            if slot >= 0:
                vacant = np.int64(links[slot])
            else:
                if used == most:
                    return -1
                slot = used
                used += 1
            head = place & mask
            if place - bucket >= buckets:
                head, far = np.int64(buckets), min(far, place)
            cells[slot], costs[slot] = np.int64(other) << 8 | steps_on, reached
            links[slot], heads[head] = heads[head], slot
    if held != 0:
        cells[used], costs[used] = held, cost[held >> 8]
        used += 1
    return used


@njit(cache=True, nogil=True, error_model="numpy")
def _bring_near(
    heads: NDArray[np.int32], cells: NDArray[np.int32], links: NDArray[np.int32], costs: Costs, bucket: Index,
    target: Index, stride: Index, ahead_long: int, ahead_short: int, bottom: Index, shift: int,
) -> Index:  # fmt: skip
    """Move entries that were too far for the ring into it. Returns the first place of those that still are."""
    buckets, far = len(heads) - 1, np.int64(_VOID)
    slot, heads[buckets] = np.int64(heads[buckets]), -1
    while slot >= 0:
        following = np.int64(links[slot])
        place = (costs[slot] + far_index(cells[slot] >> 8, target, stride, ahead_long, ahead_short) - bottom) >> shift
        head = place & (buckets - 1)
        if place - bucket >= buckets:
            head, far = np.int64(buckets), min(far, place)
        links[slot], heads[head] = heads[head], slot
        slot = following
    return far


@njit(cache=True, nogil=True, error_model="numpy")
def way_down(
    steps: Bytes, extra: Bytes | None, cost: Costs, start: Index, goal: Index, straight: int, diagonal: int,
    q: int, p: int,
) -> tuple[Cells, int]:  # fmt: skip
    """(n, 2) rows and columns of the way from the start to the goal, not counting the border, and its diagonal steps.

    `cost` has the costs to the goal.
    """
    stride, legal = np.int64(steps.shape[1]), steps.reshape(-1)
    way, count, diagonals, cell = np.empty((256, 2), np.int64), 1, 0, np.int64(start)
    down, across = goal // stride - start // stride, goal % stride - start % stride
    came, offsets = 0, _ROW_STEP * stride + _COLUMN_STEP
    for k in range(8):
        if _ROW_STEP[k] == np.sign(down) and _COLUMN_STEP[k] == np.sign(across):
            came = k
    row, column = cell // stride - 1, cell % stride - 1
    way[0, 0], way[0, 1] = row, column
    while cell != goal:
        for turn in _TURNS:
            k = (came + turn) & 7
            if not legal[cell] >> k & 1:
                continue
            other = cell + offsets[k]
            further = diagonal if k & 1 else straight
            if extra is not None:
                flat = extra.reshape(-1)
                further += (p if k & 1 else q) * (np.int64(flat[cell]) + np.int64(flat[other]))
            if cost[other] + further == cost[cell]:
                break
        came, cell, diagonals = k, other, diagonals + (k & 1)
        if count == len(way):
            way = np.concatenate((way, np.empty_like(way)))
        row, column = row + _ROW_STEP[k], column + _COLUMN_STEP[k]
        way[count, 0], way[count, 1] = row, column
        count += 1
    return way[:count].copy(), diagonals


@njit(cache=True, nogil=True, error_model="numpy")
def direct_way(steps: Bytes, extra: Bytes | None, start: Index, goal: Index) -> tuple[Cells, int]:
    """As `way_down`, if there is a way as short as on an empty grid and without extra costs: a depth-first search."""
    stride, legal = np.int64(steps.shape[1]), steps.reshape(-1)
    down, across = goal // stride - start // stride, goal % stride - start % stride
    diagonals = min(abs(down), abs(across))
    straights = max(abs(down), abs(across)) - diagonals
    pair = np.zeros(2, np.int64)  # the straight direction and the diagonal one
    for k in range(8):
        if _ROW_STEP[k] == np.sign(down) * (k & 1 or abs(down) > abs(across)) and _COLUMN_STEP[k] == np.sign(across) * (
            k & 1 or abs(across) >= abs(down)
        ):
            pair[k & 1] = k
    most = np.array((straights, diagonals))
    is_dead = np.zeros((straights + 1, diagonals + 1), np.bool_)
    taken, done = np.zeros(straights + diagonals + 1, np.int64), np.zeros(2, np.int64)
    way, n, cell = np.empty((straights + diagonals + 1, 2), np.int64), 0, np.int64(start)
    taken[0] = np.argmax(pair)
    while n < straights + diagonals:
        found = False
        for turn in range(2):
            kind = taken[n] ^ turn
            k = pair[kind]
            other = cell + _ROW_STEP[k] * stride + _COLUMN_STEP[k]
            if done[kind] == most[kind] or not legal[cell] >> k & 1:
                continue
            if extra is not None and extra.reshape(-1)[other] != 0:
                continue
            if is_dead[done[0] + (kind == 0), done[1] + (kind == 1)]:
                continue
            done[kind] += 1
            n, cell, found = n + 1, other, True
            taken[n] = kind
            break
        if not found:
            is_dead[done[0], done[1]] = True
            k = pair[taken[n]]
            done[taken[n]] -= 1
            n, cell = n - 1, cell - _ROW_STEP[k] * stride - _COLUMN_STEP[k]
    cell = np.int64(start)
    way[0, 0], way[0, 1] = cell // stride - 1, cell % stride - 1
    for n in range(1, straights + diagonals + 1):
        k = pair[taken[n]]
        way[n, 0], way[n, 1] = way[n - 1, 0] + _ROW_STEP[k], way[n - 1, 1] + _COLUMN_STEP[k]
    return way, diagonals


@njit(cache=True, nogil=True, error_model="numpy")
def nearest(steps: Bytes, cost: Costs, base: int, start: Index, goal: Index) -> Cells:
    """(n,) the cells connected with the start that are nearest to the goal in a straight line, in ascending order.

    Sets `cost` to `base` on all connected cells; it must be above that before.
    """
    stride, legal = np.int64(steps.shape[1]), steps.reshape(-1)
    goal_row, goal_column = goal // stride, goal % stride
    waiting, count, closest = np.empty(cost.size, np.int32), 1, np.int64(_VOID)
    best = [np.int64(0) for _ in range(0)]
    waiting[0], cost[start] = start, base
    while count:
        count -= 1
        cell = np.int64(waiting[count])
        row = np.int64(np.uint32(cell) // np.uint32(stride))
        away = (row - goal_row) ** 2 + (cell - row * stride - goal_column) ** 2
        if away < closest:
            closest = away
            best.clear()
        if away == closest:
            best.append(cell)
        # A diagonal step needs both cells beside it, so straight steps alone connect the same cells.
        for k in range(0, 8, 2):
            other = np.uint64(cell + _ROW_STEP[k] * stride + _COLUMN_STEP[k])
            if legal[np.uint64(cell)] >> k & 1 and cost[other] != base:
                waiting[count], cost[other] = other, base
                count += 1
    return np.sort(np.array(best))
