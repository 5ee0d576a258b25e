"""Cells of a map and the places that they cover."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navloom.geometry.frames import inverse, transform
from navloom.messages import OccupancyGrid

__all__ = ["cells_at", "has_cells", "places_of"]

Floats = NDArray[np.float64]
Cells = NDArray[np.int64]


def cells_at(grid: OccupancyGrid, points: ArrayLike) -> Cells:
    """(n, 2) row and column of the cells that hold points, (n, 2) m, map frame. They may be beyond the grid."""
    in_grid = transform(inverse(_pose(grid)), np.asarray(points, dtype=np.float64))
    # Reversed: x counts columns, y rows. Without floor(), astype() would round -0.5 to cell 0 of the grid.
    cells: Cells = np.floor(in_grid[:, ::-1] / grid.resolution).astype(np.int64)
    return cells


def has_cells(grid: OccupancyGrid, cells: Cells) -> NDArray[np.bool_]:
    """(n,) whether cells, (n, 2) row and column, are within the grid."""
    is_within: NDArray[np.bool_] = (cells >= 0) & (cells < grid.cells.shape)
    return np.logical_and(is_within[:, 0], is_within[:, 1])


def places_of(grid: OccupancyGrid, cells: ArrayLike) -> Floats:
    """(n, 2) centres, m, map frame, of cells, (n, 2) row and column."""
    centres = (np.asarray(cells, dtype=np.float64)[:, ::-1] + 0.5) * grid.resolution
    return transform(_pose(grid), centres)


def _pose(grid: OccupancyGrid) -> tuple[float, float, float]:
    return grid.origin.x, grid.origin.y, grid.origin.heading
