"""Whether a map leaves a trajectory free: what a robot that maps while it drives replans by."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom.geometry.frames import inverse, transform
from navloom.messages import OccupancyGrid

__all__ = ["OCCUPIED_FROM", "first_blocked", "warm_up"]

Floats = NDArray[np.float64]

OCCUPIED_FROM = 50
"""Cells of at least this, percent, are obstacles; the unknown is none."""


def first_blocked(samples: Floats, progress: float, radius: float, grid: OccupancyGrid) -> float:
    """Arc length, m, of the first sample from `progress` on that is nearer than `radius` to an occupied cell's centre.

    Infinite where there is none. What lies outside of the grid is free.

    Args:
        samples: (n, 6) of `trajectory.SmoothPath`, map frame.
        progress: Arc length the robot is at, m.
        radius: Of the disc that must be free, m.
        grid: The map.
    """
    if not grid.cells.size:
        return math.inf
    origin = np.array([grid.origin.x, grid.origin.y, grid.origin.heading])
    places = transform(inverse(origin), samples[:, 1:3]) / grid.resolution
    return float(_first_blocked(samples[:, 0], places, progress, radius / grid.resolution, grid.cells, OCCUPIED_FROM))


@njit(cache=True, nogil=True, error_model="numpy")
def _first_blocked(lengths, places, progress, radius, cells, occupied_from):  # type: ignore[no-untyped-def]
    """Places and radius in cells, (0, 0) being the corner of the grid."""
    rows, columns = cells.shape
    for k in range(places.shape[0]):
        if lengths[k] < progress:
            continue
        x, y = places[k, 0], places[k, 1]
        for row in range(max(0, math.ceil(y - radius - 0.5)), min(rows - 1, math.floor(y + radius - 0.5)) + 1):
            dy = row + 0.5 - y
            half = math.sqrt(max(0.0, radius * radius - dy * dy))
            first, last = max(0, math.ceil(x - half - 0.5)), min(columns - 1, math.floor(x + half - 0.5))
            for column in range(first, last + 1):
                if cells[row, column] >= occupied_from:
                    return lengths[k]
    return np.inf


def warm_up() -> None:
    """Compile the kernel for the types messages have."""
    cells, samples = np.zeros((1, 1), np.int8), np.zeros((1, 6))
    for is_writeable in (True, False):
        cells.flags.writeable = samples.flags.writeable = is_writeable
        places = samples[:, 1:3] / 1.0
        _first_blocked(samples[:, 0], places, 0.0, 1.0, cells, OCCUPIED_FROM)
