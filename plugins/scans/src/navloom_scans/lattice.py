"""Kernels of the search over a whole map: a pyramid of maxima, bounds of its blocks, best first.

A node is a block of 2^level x 2^level positions at one heading. Its bound is the sum, over the end points, of the
largest value within the block's reach, so no position of the block scores more (Olson 2009; Hess et al. 2016). All
scores are integers, so a queue with a list for each score replaces a heap: of equal nodes, the last comes first.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from navloom_scans.sight import is_through

__all__ = ["COMPLETE", "DIVE", "DRAIN", "FULL", "expand", "offsets_of", "pyramid_of"]

FULL = 255
"""Value of a lattice cell at a wall."""
COMPLETE, DIVE, DRAIN = 0, 1, 2
"""How `expand` goes on: every node; the best position of each node only; only nodes whose score is final."""
_FINAL = 0
"""Stage of a node whose score is final; a block of level k has stage k + 1."""
_TRACE_WORK = 60
"""Work of following the beams along the map, in nodes."""
_SILENT = 0.5
"""Weight of a beam without an echo through a wall, as in `sight`."""


@njit(cache=True, nogil=True, error_model="numpy")
def pyramid_of(values, levels):  # type: ignore[no-untyped-def]
    """Largest value in the square of 2^level cells up and right of each cell.

    Args:
        values: (rows, columns) uint8.
        levels: Number of levels; level 0 holds the values.

    Returns:
        (levels, rows + pad, columns + pad) uint8, where pad = 2^(levels - 1) - 1 cells come before the first row and
        column: a square that begins there may reach into the map.
    """
    rows, columns = values.shape
    pad = 2 ** (levels - 1) - 1
    found = np.zeros((levels, rows + pad, columns + pad), dtype=np.uint8)
    found[0, pad:, pad:] = values
    for level in range(1, levels):
        half, below, here = 2 ** (level - 1), found[level - 1], found[level]
        for r in range(rows + pad):
            up = min(r + half, rows + pad - 1)
            for c in range(columns + pad):
                right = min(c + half, columns + pad - 1)
                here[r, c] = max(max(below[r, c], below[r, right]), max(below[up, c], below[up, right]))
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def offsets_of(beams, turns, step):  # type: ignore[no-untyped-def]
    """(headings, n, 2) row and column, int32, of each end point relative to the robot's cell, at each heading.

    Args:
        beams: (n, 4) end point, m, first, base frame. turns: (headings,) rad, raster frame. step: Edge of a cell, m.
    """
    found = np.empty((len(turns), len(beams), 2), dtype=np.int32)
    for k in range(len(turns)):
        c, s = math.cos(turns[k]), math.sin(turns[k])
        for i in range(len(beams)):
            found[k, i, 0] = math.floor((s * beams[i, 0] + c * beams[i, 1]) / step + 0.5)
            found[k, i, 1] = math.floor((c * beams[i, 0] - s * beams[i, 1]) / step + 0.5)
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _bound(layer, offsets, row, column):  # type: ignore[no-untyped-def]
    """Sum of a pyramid's level over the end points, (n, 2) rows and columns, of a block at a padded row and column."""
    rows, columns = layer.shape
    total = np.int64(0)
    for i in range(offsets.shape[0]):
        # Unsigned, so that one comparison also catches what is below 0.
        r, c = np.uint64(row + offsets[i, 0]), np.uint64(column + offsets[i, 1])
        if r < np.uint64(rows) and c < np.uint64(columns):
            total += np.int64(layer[r, c])
    return total


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _push(queue, heads, marks, bound, stage, heading, row, column):  # type: ignore[no-untyped-def]
    """Add a node to the queue."""
    if marks[2] >= 0:
        slot = marks[2]
        marks[2] = queue[slot, 0]
    else:
        slot = marks[1]
        marks[1] += 1
    queue[slot, 0], queue[slot, 1], queue[slot, 2] = heads[bound], stage << 16 | heading, row << 16 | column
    heads[bound] = slot
    marks[3] = max(marks[3], bound)


@njit(cache=True, nogil=True, error_model="numpy")
def _through(field, frame, rays, echoes, x, y, heading, gate, most):  # type: ignore[no-untyped-def]
    """Number of beams that pass through a wall, counted up to a most; those without an echo count half."""
    c, s, total = math.cos(heading), math.sin(heading), 0.0
    for i in range(rays.shape[0]):
        dx, dy = c * rays[i, 2] - s * rays[i, 3], s * rays[i, 2] + c * rays[i, 3]
        px, py = x + c * rays[i, 0] - s * rays[i, 1], y + s * rays[i, 0] + c * rays[i, 1]
        back = max(0.0, rays[i, 0] * rays[i, 2] + rays[i, 1] * rays[i, 3])
        if is_through(field, frame, px, py, dx, dy, back, gate):
            total += 1.0 if i < echoes else _SILENT
            if total > most:
                break
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _bound_within(pyramid, standing, corners, offsets, level, row, column):  # type: ignore[no-untyped-def]
    """Bound of a block; -1 if the robot cannot stand in it, or if it is not searched."""
    size, pad = 2**level, 2 ** (pyramid.shape[0] - 1) - 1
    if row > corners[1, 0] or column > corners[1, 1] or row + size <= corners[0, 0] or column + size <= corners[0, 1]:
        return -1
    if not standing[level, row // size, column // size]:
        return -1
    return _bound(pyramid[level], offsets, row + pad, column + pad)


@njit(cache=True, nogil=True, error_model="numpy")
def _dive(pyramid, standing, corners, offsets, level, row, column):  # type: ignore[no-untyped-def]
    """Go from a block to the position of the largest bound: row, column, and bound, -1 if there is none; and work."""
    bound, work = -1, 0
    while level > 0:
        level -= 1
        size, bound, best_row, best_column = 2**level, -1, row, column
        for k in range(4):
            r, c = row + k // 2 * size, column + k % 2 * size
            value = _bound_within(pyramid, standing, corners, offsets, level, r, c)
            work += 1
            if value > bound:
                bound, best_row, best_column = value, r, c
        if bound < 0:
            break
        row, column = best_row, best_column
    return row, column, bound, work


@njit(cache=True, nogil=True, error_model="numpy")
def _is_near(found, count, turns, limits, heading, row, column):  # type: ignore[no-untyped-def]
    """Whether one of the results is near a position and a heading."""
    for k in range(count):
        off = math.hypot(found[k, 1] - row, found[k, 2] - column) * limits[0]
        turned = abs(turns[np.int64(found[k, 0])] - turns[heading]) % math.tau
        if off < limits[3] and min(turned, math.tau - turned) < limits[4]:
            return True
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def expand(  # type: ignore[no-untyped-def]
    pyramid, standing, corners, offsets, turns, field, frame, rays, echoes, limits, queue, heads, marks, found, mode,
    budget,
):  # fmt: skip
    """Expand nodes until the budget is used or no node is left.

    Args:
        pyramid: As `pyramid_of` returns it.
        standing: (levels, rows, columns) whether the robot may stand in a block; level k is filled at its first
            rows / 2^k rows and columns / 2^k columns.
        corners: (2, 2) first and last row and column of the positions that are searched.
        offsets: (headings, n, 2) row and column of each end point, in cells, relative to the robot's cell.
        turns: (headings,) rad, raster frame.
        field, frame: Attributes of a `DistanceField`.
        rays: (m, 4) end point, m, and direction, base frame, of the beams that are followed along the map: first
            `echoes` beams with an echo, then those without one.
        limits: (7,) edge of a cell, m; depth behind a wall's front from which a beam passes through it, m; score of one
            beam through a wall; least distance of two results, m and rad; least score; largest difference from the
            best score.
        queue: (capacity, 3) int32: next node of the same bound, stage and heading, row and column, in 16 bits each.
        heads: (bounds,) first node.
        marks: (5,) next root, slots used, first free slot, largest bound, number of results.
        found: (k, 4) filled: heading, row, column, score of each result.
        mode: `COMPLETE`; `DIVE` to follow only the best position of each node; `DRAIN` to take only nodes whose score
            is final.
        budget: Nodes to score.

    Returns:
        Work done, in nodes, and whether no node is left. It ends early if the queue is nearly full.
    """
    top, least, work = pyramid.shape[0] - 1, np.int64(limits[5]), 0
    size = 2**top
    first_row, first_column = corners[0, 0] // size, corners[0, 1] // size
    high, wide = corners[1, 0] // size - first_row + 1, corners[1, 1] // size - first_column + 1
    roots = offsets.shape[0] * high * wide
    while work < budget and marks[1] + 8 < queue.shape[0]:
        work += 1
        if marks[0] < roots:
            # Headings vary fastest: the end points then stay near one another in memory.
            block, heading = marks[0] // offsets.shape[0], marks[0] % offsets.shape[0]
            marks[0] += 1
            row, column = (first_row + block // wide) * size, (first_column + block % wide) * size
            bound = _bound_within(pyramid, standing, corners, offsets[heading], top, row, column)
            if bound >= least:
                _push(queue, heads, marks, bound, top + 1, heading, row, column)
            continue
        while marks[3] >= least and heads[marks[3]] < 0:
            marks[3] -= 1
        if marks[3] < least:
            return work, True
        bound = marks[3]
        slot = heads[bound]
        stage, heading = int(queue[slot, 1] >> 16), int(queue[slot, 1] & 0xFFFF)
        row, column = int(queue[slot, 2] >> 16), int(queue[slot, 2] & 0xFFFF)
        heads[bound] = queue[slot, 0]
        queue[slot, 0] = marks[2]
        marks[2] = slot
        if stage == _FINAL:
            if not _is_near(found, marks[4], turns, limits, heading, row, column):
                k = marks[4]
                found[k, 0], found[k, 1], found[k, 2], found[k, 3] = heading, row, column, bound
                marks[4] += 1
                if k == 0:
                    limits[5] = max(limits[5], bound - limits[6])
                    least = np.int64(limits[5])
                if marks[4] == found.shape[0]:
                    return work, True
            continue
        if mode == DRAIN:
            continue
        if stage > 1 and mode == DIVE:
            row, column, bound, done = _dive(pyramid, standing, corners, offsets[heading], stage - 1, row, column)
            work += done
            if bound < least:
                continue
            stage = 1
        if stage == 1:
            if _is_near(found, marks[4], turns, limits, heading, row, column):
                continue
            u, v, c, s = (column + 0.5) * limits[0], (row + 0.5) * limits[0], frame[2], frame[3]
            x, y = frame[0] + c * u - s * v, frame[1] + s * u + c * v
            turn = turns[heading] + math.atan2(s, c)
            most = (bound - least) / limits[2]
            bound -= np.int64(limits[2] * _through(field, frame, rays, echoes, x, y, turn, limits[1], most))
            work += _TRACE_WORK
            if bound >= least:
                _push(queue, heads, marks, bound, _FINAL, heading, row, column)
            continue
        level = stage - 2
        half = 2**level
        for k in range(4):
            r, c = row + k // 2 * half, column + k % 2 * half
            bound = _bound_within(pyramid, standing, corners, offsets[heading], level, r, c)
            work += 1
            if bound >= least:
                _push(queue, heads, marks, bound, level + 1, heading, r, c)
    return work, False
