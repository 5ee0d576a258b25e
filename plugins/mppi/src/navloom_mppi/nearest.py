"""The nearest obstacle of each cell around the robot, so that a roll-out finds its clearance with one look-up."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Numbers = NDArray[np.int16]


@njit(cache=True, nogil=True)
def _offer(nearest: Numbers, squares: NDArray[np.float32], obstacles: Floats, cell: float, r: int, k: int, number: int,
           farthest: float) -> None:  # fmt: skip
    """Make an obstacle the nearest one of a cell if it is nearer than that so far, and than the square `farthest`, m²."""
    half = 0.5 * nearest.shape[0]
    dx, dy = (k + 0.5 - half) * cell - obstacles[number, 0], (r + 0.5 - half) * cell - obstacles[number, 1]
    square = dx * dx + dy * dy
    if square < min(farthest, squares[r, k]):
        nearest[r, k], squares[r, k] = number, square


@njit(cache=True, nogil=True)
def fill_nearest(obstacles: Floats, cell: float, reach: float, nearest: Numbers, squares: NDArray[np.float32]) -> None:
    """Find the nearest obstacle of each cell by propagation (Danielsson 1980, the four scans of 8SED).

    Distances are those of the obstacle itself, not of the cell that it is in.

    Args:
        obstacles: (n, >= 2) x, y, m, base frame. cell: Side of a cell, m. The base is in the middle of the window.
        reach: Obstacles farther from a cell's centre than this do not count, m.
        nearest: (size, size), filled in: row of the obstacle; -1 for none within reach.
        squares: (size, size), filled in: square of its distance from the cell's centre, m².
    """
    size = nearest.shape[0]
    for r in range(size):
        for k in range(size):
            nearest[r, k], squares[r, k] = -1, np.inf
    # An obstacle is at most half a diagonal from the centre of its own cell.
    farthest = max(reach, cell) ** 2
    for i in range(obstacles.shape[0]):
        k, r = math.floor(obstacles[i, 0] / cell) + size // 2, math.floor(obstacles[i, 1] / cell) + size // 2
        if 0 <= r < size and 0 <= k < size:
            _offer(nearest, squares, obstacles, cell, r, k, i, farthest)
    for down in (True, False):
        for j in range(size):
            r = j if down else size - 1 - j
            before = r - 1 if down else r + 1
            if j > 0:
                for k in range(size):
                    for beside in range(max(0, k - 1), min(size, k + 2)):
                        if nearest[before, beside] >= 0:
                            _offer(nearest, squares, obstacles, cell, r, k, nearest[before, beside], farthest)
            for k in range(1, size):
                if nearest[r, k - 1] >= 0:
                    _offer(nearest, squares, obstacles, cell, r, k, nearest[r, k - 1], farthest)
            for k in range(size - 2, -1, -1):
                if nearest[r, k + 1] >= 0:
                    _offer(nearest, squares, obstacles, cell, r, k, nearest[r, k + 1], farthest)


def body_points(footprint: Floats) -> tuple[Floats, float]:
    """Points along the footprint's longer side whose discs cover it: a long body needs several look-ups.

    Args:
        footprint: (k, 2) corners, m, base frame.

    Returns:
        (n, 2) centres, m, base frame, and the radius of the discs, m.
    """
    low, high = footprint.min(axis=0), footprint.max(axis=0)
    size, middle = high - low, 0.5 * (low + high)
    along = int(size[1] > size[0])
    count = max(1, round(float(size[along] / size[1 - along])))
    points = np.tile(middle, (count, 1))
    points[:, along] = low[along] + size[along] * (np.arange(count) + 0.5) / count
    return points, float(np.hypot(0.5 * size[along] / count, 0.5 * size[1 - along]))
