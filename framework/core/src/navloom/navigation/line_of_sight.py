"""Line of sight on a grid, and the pruning of a planner's path with it.

A segment is free if every cell that it touches is free (closed supercover). A segment through a grid corner touches all
four cells around it, so corners are never cut. Outside the grid nothing is free.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["is_segment_free", "prune", "simplify", "warm_up", "without_repeats"]

Floats = NDArray[np.float64]
Cells = NDArray[np.bool_]

_TOUCH = 1e-6
"""A segment this near to a cell, in cells, touches it, so that rounding does not change the answer."""
_REPEAT = 1e-6
"""Points nearer to each other than this, m, are one point."""
_DENSE = 400
"""Largest path, in points, whose points are all candidates; of longer ones, the turning points and about 250 more."""


@njit(cache=True, nogil=True, error_model="numpy")
def is_segment_free(cells, resolution, x_low, y_low, x0, y0, x1, y1):  # type: ignore[no-untyped-def]
    """Whether all cells that a segment touches are traversable.

    Args:
        cells: (rows, cols) bool, True where the robot's centre may be; row 0 has the lowest y, column 0 the lowest x.
        resolution: Edge of a cell, m.
        x_low, y_low: Lower left corner of cell (0, 0), m.
        x0, y0, x1, y1: Ends of the segment, m, in the frame of the grid.
    """
    rows, cols = cells.shape
    xa, ya, xb, yb = (x0 - x_low) / resolution, (y0 - y_low) / resolution, 0.0, 0.0
    xb, yb = (x1 - x_low) / resolution, (y1 - y_low) / resolution
    # Rows are visited upwards, so that both directions of a segment give the same answer.
    if ya > yb:
        xa, ya, xb, yb = xb, yb, xa, ya
    lowest, highest = math.floor(ya - _TOUCH), math.floor(yb + _TOUCH)
    # Checked once for the whole segment, so that the loop needs no bounds.
    if lowest < 0 or highest >= rows or min(xa, xb) - _TOUCH < 0.0 or max(xa, xb) + _TOUCH >= cols:
        return False
    rise = yb - ya
    for row in range(lowest, highest + 1):
        enter, leave = 0.0, 1.0
        # A segment within one row has no crossing to divide by.
        if rise > _TOUCH:
            enter = max(0.0, (row - _TOUCH - ya) / rise)
            leave = min(1.0, (row + 1.0 + _TOUCH - ya) / rise)
        x_enter, x_leave = xa + enter * (xb - xa), xa + leave * (xb - xa)
        first, last = math.floor(min(x_enter, x_leave) - _TOUCH), math.floor(max(x_enter, x_leave) + _TOUCH)
        for column in range(first, last + 1):
            if not cells[row, column]:
                return False
    return True


def prune(
    points: Floats, traversable: Cells, resolution: float, origin: tuple[float, float], corner_cost: float = 0.05
) -> Floats:
    """The cheapest chain of free segments over a subset of a path's points; the cost is length plus a cost per corner.

    Dynamic programming, exact over its candidates (all points of a path of up to 400 points). The segment between
    consecutive points always counts as free, whatever the grid says: it is the planner's responsibility. The corner
    cost keeps a chain around a round obstacle from following every cell; the result is longer by at most this cost
    for each corner saved.

    Args:
        points: (n, 2) path, m, in the frame of the grid.
        traversable: (rows, cols) bool; row 0 has the lowest y, column 0 the lowest x.
        resolution: Edge of a cell, m.
        origin: x, y of the lower left corner of cell (0, 0), m.
        corner_cost: m, >= 0.

    Returns:
        (m, 2) with m <= n, the first and the last point of the path being its ends.
    """
    path = without_repeats(points)
    if len(path) < 3:
        return path
    candidates = path[_candidates(path)]
    kept: Floats = candidates[_cheapest_chain(candidates, traversable, resolution, origin[0], origin[1], corner_cost)]
    return kept


def simplify(points: Floats, tolerance: float) -> Floats:
    """A path with fewer points, nowhere farther than `tolerance` from the old one (Ramer 1972, Douglas & Peucker 1973).

    For paths without a grid.

    Args:
        points: (n, 2) path, m.
        tolerance: m.

    Returns:
        (m, 2), a subset with both ends.
    """
    path = without_repeats(points)
    if len(path) < 3:
        return path
    kept: Floats = path[_far_points(path, tolerance)]
    return kept


def without_repeats(points: Floats) -> Floats:
    """A path (n, 2), m, without points nearer than 1 µm to the previous one; the last point always stays."""
    path = np.ascontiguousarray(points, dtype=np.float64)
    steps = np.hypot(np.diff(path[:, 0]), np.diff(path[:, 1]))
    kept: Floats = path[np.concatenate([[True], steps > _REPEAT])].copy()
    if len(kept) > 1:
        # The goal is exact, even if it lies within the tolerance of the point before.
        kept[-1] = path[-1]
    return kept


def _candidates(path: Floats) -> NDArray[np.int64]:
    """Indices of the path's points that may become corners."""
    count = len(path)
    if count <= _DENSE:
        return np.arange(count)
    steps = np.diff(path, axis=0)
    steps /= np.hypot(steps[:, 0], steps[:, 1])[:, None]
    turns = np.abs(steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]) > 1e-9
    # Where a path reverses, the cross product is 0 as on a straight line.
    turns |= (steps[:-1] * steps[1:]).sum(axis=1) < 0.0
    chosen = np.concatenate([[True], turns, [True]])
    # Straight parts need points too, as ends of segments that cut across; time grows with their square.
    chosen[:: max(1, count // 250)] = True
    return np.flatnonzero(chosen)


@njit(cache=True, nogil=True, error_model="numpy")
def _cheapest_chain(points, cells, resolution, x_low, y_low, corner_cost):  # type: ignore[no-untyped-def]
    """Indices of the points of the cheapest chain; of equally cheap ones, the one with the longest last segments."""
    count = points.shape[0]
    cost, parent = np.zeros(count), np.zeros(count, np.int64)
    for j in range(1, count):
        x, y = points[j, 0], points[j, 1]
        best, before = np.inf, j - 1
        for step in range(j):
            # The point before comes first, since its segment is allowed whatever the grid says.
            i = j - 1 if step == 0 else step - 1
            dx, dy = x - points[i, 0], y - points[i, 1]
            total = cost[i] + math.sqrt(dx * dx + dy * dy) + corner_cost
            if step > 0 and (
                # The costly look at the grid comes last.
                total > best + 1e-9
                # Equal costs differ by rounding: without a rule for ties, chains would differ between machines.
                or (total > best - 1e-9 and before < i)
                or not is_segment_free(cells, resolution, x_low, y_low, x, y, points[i, 0], points[i, 1])
            ):
                continue
            best, before = total, i
        cost[j], parent[j] = best, before
    chain = [count - 1]
    while chain[-1] != 0:
        chain.append(parent[chain[-1]])
    return np.array(chain[::-1])


@njit(cache=True, nogil=True, error_model="numpy")
def _far_points(points, tolerance):  # type: ignore[no-untyped-def]
    """Mask of the kept points: recursively, the point farthest from each chord if it is beyond the tolerance."""
    kept = np.zeros(points.shape[0], np.bool_)
    kept[0] = kept[-1] = True
    # A stack instead of recursion, which numba compiles slowly and which is as deep as the path is long.
    chords = [(0, points.shape[0] - 1)]
    while chords:
        first, last = chords.pop()
        dx, dy = points[last, 0] - points[first, 0], points[last, 1] - points[first, 1]
        square = dx * dx + dy * dy
        farthest, index = tolerance, -1
        for k in range(first + 1, last):
            px, py = points[k, 0] - points[first, 0], points[k, 1] - points[first, 1]
            share = min(1.0, max(0.0, (px * dx + py * dy) / square)) if square > 0.0 else 0.0
            gap = math.sqrt((px - share * dx) ** 2 + (py - share * dy) ** 2)
            if gap > farthest:
                farthest, index = gap, k
        if index >= 0:
            kept[index] = True
            chords.append((first, index))
            chords.append((index, last))
    return kept


def warm_up() -> None:
    """Compile the kernels."""
    path = np.array([[0.5, 0.5], [0.5, 1.5], [1.5, 1.5]])
    prune(path, np.ones((3, 3), np.bool_), 1.0, (0.0, 0.0))
    simplify(path, 0.01)
