"""Cells of the robot's map at places of ROS messages."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["OCCUPIED", "OUTSIDE", "UNKNOWN", "cells_at", "outside"]

OCCUPIED = 65
"""Value from which a cell counts as occupied; map_server's `occupied_thresh`, in percent."""
UNKNOWN = -1
OUTSIDE = -2
"""Value of places outside the map, which are no cell."""


def cells_at(grid: Any, places: NDArray[np.float64]) -> NDArray[np.int16]:
    """Values of a map at places: 0 free to 100 occupied, UNKNOWN, or OUTSIDE.

    Args:
        grid: A `navloom.messages.OccupancyGrid`.
        places: (n, 2), m, map frame.
    """
    cos, sin = math.cos(grid.origin.heading), math.sin(grid.origin.heading)
    moved = np.asarray(places, np.float64).reshape(-1, 2) - (grid.origin.x, grid.origin.y)
    columns = np.floor((moved @ (cos, sin)) / grid.resolution)
    rows = np.floor((moved @ (-sin, cos)) / grid.resolution)
    inside = (rows >= 0) & (rows < grid.cells.shape[0]) & (columns >= 0) & (columns < grid.cells.shape[1])
    values = np.full(len(moved), OUTSIDE, np.int16)
    values[inside] = grid.cells[rows[inside].astype(int), columns[inside].astype(int)]
    return values


def outside(grid: Any, x: float, y: float) -> str:
    """That a place, m, map frame, is outside the map, and where the map is; empty if it is inside, or without a map."""
    if grid is None or cells_at(grid, np.array([[x, y]]))[0] != OUTSIDE:
        return ""
    rows, columns = grid.cells.shape
    size = f"{columns * grid.resolution:g} x {rows * grid.resolution:g} m from ({grid.origin.x:g}, {grid.origin.y:g})"
    return f"({x:g}, {y:g}) is outside the map, which covers {size}"
