"""The framework's map to the field that scans are matched with."""

from __future__ import annotations

from navloom import InputError, OccupancyGrid

from navloom_scan_localizer.field import DistanceField, distance_field
from navloom_scan_localizer.params import ScanMatchingParams

__all__ = ["field_of_map"]

_MAX_CELLS = 16_000_000
"""A larger map is refused: its field, with four nodes a cell, would need some gigabytes to be made."""


def field_of_map(grid: OccupancyGrid | None, params: ScanMatchingParams) -> DistanceField:
    """The field of a map, cut at twice the reach.

    Raises:
        InputError: There is no map, or it has no cells or too many of them.
    """
    if grid is None:
        raise InputError('scan_matching: got no map, expected one; name it in [map], as in ref = "world"')
    if not 0 < grid.cells.size <= _MAX_CELLS or not grid.resolution > 0.0:
        given = f"a map of {grid.cells.shape} cells of {grid.resolution:g} m"
        raise InputError(f"scan_matching: got {given}, expected 1 to {_MAX_CELLS} cells of more than 0 m")
    walls = grid.cells >= params.occupied_from
    if params.unknown_is_wall:
        walls |= grid.cells < 0
    origin = (grid.origin.x, grid.origin.y, grid.origin.heading)
    return distance_field(walls, grid.resolution, origin, 2.0 * params.reach)
