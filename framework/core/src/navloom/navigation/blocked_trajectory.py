"""Checks a trajectory against a map, for replanning while the robot drives and maps."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom.geometry.frames import inverse, transform
from navloom.geometry.world import read_only
from navloom.messages import OccupancyGrid

__all__ = ["OCCUPIED_FROM", "first_blocked", "warm_up"]

Floats = NDArray[np.float64]

OCCUPIED_FROM = 50
"""Smallest occupancy of an obstacle cell, percent; unknown cells are free."""


def first_blocked(samples: Floats, progress: float, radius: float, grid: OccupancyGrid) -> float:
    """Arc length, m, of the first sample at or after `progress` within `radius` of an occupied cell's centre.

    Infinite if there is none. Space outside the grid is free.

    Args:
        samples: (n, 6) of `trajectory.SmoothPath`, map frame.
        progress: Arc length of the robot's reference point, m.
        radius: Radius of the disc that must be free, m.
        grid: The map.
    """
    if not grid.cells.size:
        # A mapper may publish an empty grid before its first data.
        return math.inf
    origin = np.array([grid.origin.x, grid.origin.y, grid.origin.heading])
    places = transform(inverse(origin), samples[:, 1:3]) / grid.resolution
    lengths, cells = read_only(samples)[:, 0], read_only(grid.cells)
    return float(_first_blocked(lengths, places, progress, radius / grid.resolution, cells, OCCUPIED_FROM))


@njit(cache=True, nogil=True, error_model="numpy")
def _first_blocked(lengths, places, progress, radius, cells, occupied_from):  # type: ignore[no-untyped-def]
    """As `first_blocked`; places and radius in cells, with (0, 0) at the corner of the grid."""
    rows, columns = cells.shape
    for k in range(places.shape[0]):
        if lengths[k] < progress:
            continue
        x, y = places[k, 0], places[k, 1]
        # Rows and columns whose cell centres lie in the disc; the centre of cell (0, 0) is at (0.5, 0.5).
        for row in range(max(0, math.ceil(y - radius - 0.5)), min(rows - 1, math.floor(y + radius - 0.5)) + 1):
            dy = row + 0.5 - y
            half = math.sqrt(max(0.0, radius * radius - dy * dy))
            first, last = max(0, math.ceil(x - half - 0.5)), min(columns - 1, math.floor(x + half - 0.5))
            for column in range(first, last + 1):
                if cells[row, column] >= occupied_from:
                    return lengths[k]
    return np.inf


def warm_up() -> None:
    """Compile the kernel for the array types of messages."""
    # Two rows: a column of one row counts as contiguous, and that of a path does not.
    cells, samples = np.zeros((1, 1), np.int8), np.zeros((2, 6))
    cells.flags.writeable = samples.flags.writeable = False
    _first_blocked(samples[:, 0], samples[:, 1:3] / 1.0, 0.0, 1.0, cells, OCCUPIED_FROM)
