"""The grid that is searched: drawn from line segments, or taken from a raster map."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navloom_astar.raster import RasterMethod, draw_segments
from navloom_astar.search import Cell

__all__ = ["MAX_CELLS", "PlanningGrid", "RasterMap", "Spot", "enlarged", "grid_of_cells", "grid_of_segments"]

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Spot = tuple[float, float]
"""x, y, m, map frame."""

MAX_CELLS = 16_000_000
"""Segments are not drawn on larger grids."""

_EDGE = 1e-9
"""Places on the outer edge belong to the map, in cells."""


class _Lattice:
    """Cells on the map: `resolution` is their edge, m; `origin` x, y, m, and heading, rad, of the corner of (0, 0)."""

    resolution: float
    origin: tuple[float, float, float]

    def place(self, spot: Spot) -> Spot:
        """A place, m, map frame, as column and row with fractions: cell (r, c) is c..c+1, r..r+1."""
        x, y, heading = self.origin
        cos, sin = math.cos(heading), math.sin(heading)
        along, across = spot[0] - x, spot[1] - y
        return (cos * along + sin * across) / self.resolution, (cos * across - sin * along) / self.resolution

    def places(self, points: Floats) -> Floats:
        """The same of points (n, 2)."""
        x, y, heading = self.origin
        cos, sin = math.cos(heading), math.sin(heading)
        moved = points - (x, y)
        return np.stack([cos * moved[:, 0] + sin * moved[:, 1], cos * moved[:, 1] - sin * moved[:, 0]], axis=-1) / (
            self.resolution
        )

    def corner(self, row: int, column: int) -> Spot:
        """Lower left corner, m, map frame, of a cell, which may be outside."""
        x, y, heading = self.origin
        along, across = column * self.resolution, row * self.resolution
        return (
            x + math.cos(heading) * along - math.sin(heading) * across,
            y + math.sin(heading) * along + math.cos(heading) * across,
        )

    def centres(self, cells: NDArray[np.int64]) -> Floats:
        """(n, 2) centres, m, map frame, of cells (n, 2) by row and column."""
        x, y, heading = self.origin
        cos, sin = math.cos(heading), math.sin(heading)
        along, across = (cells[:, 1] + 0.5) * self.resolution, (cells[:, 0] + 0.5) * self.resolution
        return np.stack([x + cos * along - sin * across, y + sin * along + cos * across], axis=-1)


@dataclass(frozen=True, eq=False)
class RasterMap(_Lattice):
    """A raster map as it comes in.

    Attributes:
        cells: (rows, columns) int8: 0 free to 100 occupied, -1 unknown; row 0 has the lowest y.
        resolution: Edge of a cell, m.
        origin: x, y, m, and heading, rad, of the lower left corner of cell (0, 0) in the map frame.
    """

    cells: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class PlanningGrid(_Lattice):
    """What is searched.

    Attributes:
        occupied, unknown: (rows, columns); row 0 has the lowest y of the grid's frame.
        resolution: Edge of a cell, m.
        origin: x, y, m, and heading, rad, of the lower left corner of cell (0, 0) in the map frame.
    """

    occupied: Bools
    unknown: Bools
    resolution: float
    origin: tuple[float, float, float]

    def cell_at(self, spot: Spot) -> Cell | None:
        """The cell that holds a place, or None outside."""
        inside = []
        for value, count in zip(self.place(spot), self.occupied.shape[::-1], strict=True):
            if not -_EDGE <= value <= count + _EDGE or count == 0:
                return None
            inside.append(min(max(math.floor(value), 0), count - 1))
        return inside[1], inside[0]


def grid_of_cells(given: RasterMap, occupied_from: int) -> PlanningGrid:
    """A raster map's own cells, occupied from a value in percent."""
    return PlanningGrid(given.cells >= occupied_from, given.cells < 0, given.resolution, given.origin)


def enlarged(grid: PlanningGrid, include: tuple[Spot, ...], margin: float) -> PlanningGrid | None:
    """A grid that also holds some places, m, and a margin, m, round all; what is new is unknown.

    None where that is more than `MAX_CELLS`.
    """
    rows, columns = grid.occupied.shape
    places = np.array([grid.place(spot) for spot in include] + [(0.0, 0.0), (columns, rows)])
    reach = margin / grid.resolution
    left, low = np.maximum(0.0, np.ceil(reach - places.min(axis=0)))
    right, high = np.maximum(0.0, np.ceil(places.max(axis=0) + reach - (columns, rows)))
    if not (rows + low + high) * (columns + left + right) <= MAX_CELLS:
        return None
    if not (left or right or low or high):
        return grid
    down, across = int(low), int(left)
    shape = rows + down + int(high), columns + across + int(right)
    old = slice(down, down + rows), slice(across, across + columns)
    occupied, unknown = np.zeros(shape, dtype=np.bool_), np.ones(shape, dtype=np.bool_)
    occupied[old], unknown[old] = grid.occupied, grid.unknown
    return PlanningGrid(occupied, unknown, grid.resolution, (*grid.corner(-down, -across), grid.origin[2]))


def grid_of_segments(
    segments: Floats,
    given: RasterMap,
    cell: float,
    anchor: Spot,
    include: tuple[Spot, ...],
    margin: float = 0.0,
    method: RasterMethod = "distance",
    paper_t: float = 2.0,
) -> PlanningGrid | None:
    """A grid drawn from outlines (Hoang et al. 2013, III.A). It holds them, the raster map and the places to include.

    Args:
        segments: (n, 4) x1, y1, x2, y2, m, map frame.
        given: The raster map. It tells what is unknown: cells whose centre is so there, or outside of it.
        cell: Edge of a cell, m.
        anchor: A cell centre: the start S.
        include: Further places it must hold: start and goal.
        margin: Added on all sides, m.
        method, paper_t: As of `raster.draw_segments`.

    Returns:
        The smallest such grid, or None where that is larger than `MAX_CELLS`.
    """
    ends = np.concatenate(
        [segments.reshape(-1, 2), np.array(include, dtype=np.float64).reshape(-1, 2), _corners(given)]
    )
    low = np.floor((ends.min(axis=0) - margin - anchor) / cell + 0.5 + _EDGE)
    high = np.floor((ends.max(axis=0) + margin - anchor) / cell + 0.5 - _EDGE)
    columns, rows = np.maximum(high - low, 0.0) + 1.0
    if not columns * rows <= MAX_CELLS:
        return None
    corner = np.array(anchor) + (low - 0.5) * cell
    occupied = np.zeros((int(rows), int(columns)), dtype=np.bool_)
    in_cells = (segments.reshape(-1, 2) - anchor) / cell - low
    draw_segments(occupied, in_cells.reshape(-1, 4), method, paper_t)
    blank = PlanningGrid(occupied, np.ones_like(occupied), cell, (float(corner[0]), float(corner[1]), 0.0))
    return PlanningGrid(occupied, _unknown_on(given, blank), cell, blank.origin)


def _corners(given: RasterMap) -> Floats:
    """(4, 2) m, map frame; (0, 2) of a map without cells."""
    if given.cells.size == 0:
        return np.empty((0, 2))
    x, y, heading = given.origin
    high, wide = (count * given.resolution for count in given.cells.shape)
    along, across = (
        np.array((math.cos(heading), math.sin(heading))),
        np.array((-math.sin(heading), math.cos(heading))),
    )
    return np.array([(x, y) + a * along + b * across for a in (0.0, wide) for b in (0.0, high)])


def _unknown_on(given: RasterMap, grid: PlanningGrid) -> Bools:
    """(rows, columns) of the grid, True where its cell's centre is unknown on the map or outside of it."""
    index = np.indices(grid.occupied.shape).reshape(2, -1).T
    places = np.floor(given.places(grid.centres(index)) + _EDGE).astype(np.int64)
    inside = ((places >= 0) & (places < given.cells.shape[::-1])).all(axis=1)
    unknown = np.ones(len(index), dtype=np.bool_)
    unknown[inside] = given.cells[places[inside, 1], places[inside, 0]] < 0
    return unknown.reshape(grid.occupied.shape)
