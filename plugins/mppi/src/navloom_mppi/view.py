"""The obstacles of one tick as a picture, for the diagnostics."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

PIXEL = 0.1  # m: side of a cell
OCCUPIED = 15


def in_map(points: NDArray[np.float64], pose: tuple[float, float, float]) -> NDArray[np.float64]:
    """(..., 2) points of the base frame in the map frame, m. pose: x, y, m, heading, rad, of the base."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = points[..., 0], points[..., 1]
    return np.stack([pose[0] + c * x - s * y, pose[1] + s * x + c * y], axis=-1)


def picture(
    obstacles: NDArray[np.float64], pose: tuple[float, float, float], reach: float
) -> tuple[NDArray[np.uint8], float, float, float]:
    """Picture of the obstacles around the robot.

    Args:
        obstacles: (n, >= 2) x, y, m, base frame. pose: x, y, m, heading, rad, map frame. reach: Half width, m.

    Returns:
        (rows, cols) 15 in cells with an obstacle, else 0; side of a cell, m; lower left corner x, y, m, map frame.
    """
    size = round(2.0 * reach / PIXEL)
    x, y = in_map(obstacles[:, :2], pose).T
    left, low = math.floor(pose[0] / PIXEL) - size // 2, math.floor(pose[1] / PIXEL) - size // 2
    columns, rows = np.floor(x / PIXEL).astype(np.int64) - left, np.floor(y / PIXEL).astype(np.int64) - low
    is_inside = (rows >= 0) & (rows < size) & (columns >= 0) & (columns < size)
    cells = np.zeros((size, size), np.uint8)
    cells[rows[is_inside], columns[is_inside]] = OCCUPIED
    return cells, PIXEL, left * PIXEL, low * PIXEL
