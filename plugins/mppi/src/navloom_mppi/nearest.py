"""The nearest obstacle of each cell around the robot, so that a roll-out finds its clearance with one look-up."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Numbers = NDArray[np.int32]


@njit(cache=True, nogil=True)
def fill_nearest(obstacles: Floats, cell: float, reach: float, nearest: Numbers, squares: NDArray[np.float32]) -> None:
    """Find the nearest obstacle of each cell. Distances are those of the obstacle itself, not of its cell.

    Args:
        obstacles: (n, >= 2) x, y, m, base frame. cell: Side of a cell, m. The base is in the middle of the window.
        reach: Obstacles up to this far from a cell's centre are found along each axis, m.
        nearest: (size, size), filled in: row of the obstacle; -1 for none within reach.
        squares: (size, size), filled in: square of its distance from the cell's centre, m².
    """
    size = nearest.shape[0]
    for r in range(size):
        for k in range(size):
            nearest[r, k], squares[r, k] = -1, np.inf
    span = math.ceil(reach / cell)
    for i in range(obstacles.shape[0]):
        x, y = obstacles[i, 0] / cell + 0.5 * size - 0.5, obstacles[i, 1] / cell + 0.5 * size - 0.5
        first, last = max(0, round(x) - span), min(size, round(x) + span + 1)
        for r in range(max(0, round(y) - span), min(size, round(y) + span + 1)):
            if first < last:
                _stamp(squares[r, first:last], nearest[r, first:last], i, x - first, (r - y) ** 2, cell * cell)


@njit(cache=True, nogil=True)
def _stamp(squares: NDArray[np.float32], nearest: Numbers, number: int, x: float, across: float, area: float) -> None:
    """Offer an obstacle to cells of a row. In single precision and without branches, so that it vectorises.

    Args:
        squares, nearest: (n,) of these cells, changed in place. number: Of the obstacle.
        x: Its column from the first of these cells. across: Square of its distance from the row, in cells.
        area: Of a cell, m².
    """
    column, beside, scale, one = np.float32(x), np.float32(across), np.float32(area), np.int32(number)
    for k in range(squares.size):
        dx = np.float32(k) - column
        square = (dx * dx + beside) * scale
        is_nearer = square < squares[k]
        squares[k] = square if is_nearer else squares[k]
        nearest[k] = one if is_nearer else nearest[k]


def gap_beside(obstacles: Floats, point: tuple[float, float]) -> float:
    """Distance, m, from the straight line between base and point, m, to the nearest of the obstacles (n, >= 2), m."""
    end = np.array(point)
    along = (obstacles[:, :2] @ end / max(float(end @ end), 1.0e-9)).clip(0.0, 1.0)
    off = obstacles[:, :2] - along[:, None] * end
    return float(np.hypot(off[:, 0], off[:, 1]).min(initial=np.inf))


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
