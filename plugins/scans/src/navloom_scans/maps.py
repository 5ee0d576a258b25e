"""Converts the framework's map to the distance field for scan matching."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from navloom import InputError, OccupancyGrid
from numpy.typing import NDArray

from navloom_scans.field import DistanceField, distance_field

__all__ = ["MapReading", "field_of_map", "free_of_map", "is_same_map"]

_MAX_CELLS = 16_000_000
"""Most cells of a map. Computing the field of a larger one, with four nodes per cell, would take some gigabytes."""


class MapReading(Protocol):
    """How a map is read: cells of at least `occupied_from` percent are walls, and unknown ones if `unknown_is_wall`.

    `reach` is the longest distance from a beam's end at which a wall is searched, m.
    """

    @property
    def occupied_from(self) -> int: ...
    @property
    def unknown_is_wall(self) -> bool: ...
    @property
    def reach(self) -> float: ...


def field_of_map(grid: OccupancyGrid | None, params: MapReading) -> DistanceField:
    """Distance field of a map, limited to ± twice the reach.

    Raises:
        InputError: There is no map, its cells have no size, or it has no cells or too many of them.
    """
    if grid is None:
        raise InputError('localizer: got no map, expected one; name it in [map], as in ref = "world"')
    if not 0 < grid.cells.size <= _MAX_CELLS or not grid.resolution > 0.0:
        given = f"a map of {grid.cells.shape} cells of {grid.resolution:g} m"
        raise InputError(f"localizer: got {given}, expected 1 to {_MAX_CELLS} cells of more than 0 m")
    walls = grid.cells >= params.occupied_from
    if params.unknown_is_wall:
        walls |= grid.cells < 0
    origin = (grid.origin.x, grid.origin.y, grid.origin.heading)
    return distance_field(walls, grid.resolution, origin, 2.0 * params.reach)


def free_of_map(grid: OccupancyGrid, params: MapReading) -> NDArray[np.bool_]:
    """(rows, columns) cells that are known to be free of walls: where a robot may stand."""
    return (grid.cells >= 0) & (grid.cells < params.occupied_from)


def is_same_map(grid: OccupancyGrid, other: OccupancyGrid) -> bool:
    """Whether two maps have the same cells at the same place."""
    place = (grid.origin, grid.resolution) == (other.origin, other.resolution)
    return place and np.array_equal(grid.cells, other.cells)
