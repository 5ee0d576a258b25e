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
"""Largest number of cells of a grid that is drawn from segments or enlarged."""

_EDGE = 1e-9
"""Tolerance at cell edges, cells: points on the outer edge belong to the map."""


class _Lattice:
    """Square cells placed in the map frame.

    `resolution` is the edge of a cell, m. `origin` is x, y, m, and heading, rad, of the lower left corner of cell
    (0, 0).
    """

    resolution: float
    origin: tuple[float, float, float]

    def place(self, spot: Spot) -> Spot:
        """Column and row, with fractions, of a point, m, map frame. Cell (r, c) spans c..c+1 by r..r+1."""
        x, y, heading = self.origin
        cos, sin = math.cos(heading), math.sin(heading)
        along, across = spot[0] - x, spot[1] - y
        return (cos * along + sin * across) / self.resolution, (cos * across - sin * along) / self.resolution

    def places(self, points: Floats) -> Floats:
        """(n, 2) columns and rows, with fractions, of points (n, 2), m, map frame."""
        x, y, heading = self.origin
        cos, sin = math.cos(heading), math.sin(heading)
        moved = points - (x, y)
        return np.stack([cos * moved[:, 0] + sin * moved[:, 1], cos * moved[:, 1] - sin * moved[:, 0]], axis=-1) / (
            self.resolution
        )

    def corner(self, row: int, column: int) -> Spot:
        """Lower left corner of a cell, m, map frame. The cell may be outside the grid."""
        x, y, heading = self.origin
        along, across = column * self.resolution, row * self.resolution
        return (
            x + math.cos(heading) * along - math.sin(heading) * across,
            y + math.sin(heading) * along + math.cos(heading) * across,
        )

    def centres(self, cells: NDArray[np.int64]) -> Floats:
        """(n, 2) centres of cells, m, map frame. `cells`: (n, 2) rows and columns."""
        x, y, heading = self.origin
        cos, sin = math.cos(heading), math.sin(heading)
        along, across = (cells[:, 1] + 0.5) * self.resolution, (cells[:, 0] + 0.5) * self.resolution
        return np.stack([x + cos * along - sin * across, y + sin * along + cos * across], axis=-1)


@dataclass(frozen=True, eq=False)
class RasterMap(_Lattice):
    """A raster map as received.

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
    """The grid that is searched.

    Attributes:
        occupied, unknown: (rows, columns); row 0 has the lowest y in the grid's own frame.
        resolution: Edge of a cell, m.
        origin: x, y, m, and heading, rad, of the lower left corner of cell (0, 0) in the map frame.
    """

    occupied: Bools
    unknown: Bools
    resolution: float
    origin: tuple[float, float, float]

    def cell_at(self, spot: Spot) -> Cell | None:
        """The cell that contains a point, m, map frame, or None if the point is outside the grid."""
        inside = []
        for value, count in zip(self.place(spot), self.occupied.shape[::-1], strict=True):
            if not -_EDGE <= value <= count + _EDGE or count == 0:
                return None
            inside.append(min(max(math.floor(value), 0), count - 1))
        return inside[1], inside[0]


def grid_of_cells(given: RasterMap, occupied_from: int) -> PlanningGrid:
    """The cells of a raster map as a planning grid; cells of at least `occupied_from` percent are occupied."""
    return PlanningGrid(given.cells >= occupied_from, given.cells < 0, given.resolution, given.origin)


def enlarged(grid: PlanningGrid, include: tuple[Spot, ...], margin: float) -> PlanningGrid | None:
    """The grid, enlarged to contain the points to include, m, map frame, and a margin around all, m.

    New cells are unknown. Returns None if the result would have more than `MAX_CELLS` cells.
    """
    rows, columns = grid.occupied.shape
    places = np.array([grid.place(spot) for spot in include] + [(0.0, 0.0), (columns, rows)])
    reach = margin / grid.resolution
    left, low = np.maximum(0.0, np.ceil(reach - places.min(axis=0)))
    right, high = np.maximum(0.0, np.ceil(places.max(axis=0) + reach - (columns, rows)))
    # Negated, and before int(), so that infinity and NaN are refused too.
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
    """A grid drawn from outlines (Hoang et al. 2013, III.A).

    It contains the outlines, the raster map and the points to include.

    Args:
        segments: (n, 4) x1, y1, x2, y2, m, map frame.
        given: The raster map. A cell of the new grid is unknown if its centre is unknown on this map or outside it.
        cell: Edge of a cell, m.
        anchor: Point that is the centre of a cell, m, map frame: the start S.
        include: Other points that the grid must contain, m, map frame: start and goal.
        margin: Margin added on all sides, m.
        method, paper_t: See `raster.draw_segments`.

    Returns:
        The smallest such grid, or None if that has more than `MAX_CELLS` cells.
    """
    ends = np.concatenate(
        [segments.reshape(-1, 2), np.array(include, dtype=np.float64).reshape(-1, 2), _corners(given)]
    )
    low = np.floor((ends.min(axis=0) - margin - anchor) / cell + 0.5 + _EDGE)
    high = np.floor((ends.max(axis=0) + margin - anchor) / cell + 0.5 - _EDGE)
    columns, rows = np.maximum(high - low, 0.0) + 1.0
    # Negated, and before int(), so that infinity and NaN are refused too.
    if not columns * rows <= MAX_CELLS:
        return None
    corner = np.array(anchor) + (low - 0.5) * cell
    occupied = np.zeros((int(rows), int(columns)), dtype=np.bool_)
    in_cells = (segments.reshape(-1, 2) - anchor) / cell - low
    draw_segments(occupied, in_cells.reshape(-1, 4), method, paper_t)
    blank = PlanningGrid(occupied, np.ones_like(occupied), cell, (float(corner[0]), float(corner[1]), 0.0))
    return PlanningGrid(occupied, _unknown_on(given, blank), cell, blank.origin)


def _corners(given: RasterMap) -> Floats:
    """(4, 2) corners of the map, m, map frame; (0, 2) for a map without cells."""
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
    """(rows, columns) of the grid: True where the cell's centre is unknown on the map or outside it."""
    index = np.indices(grid.occupied.shape).reshape(2, -1).T
    places = np.floor(given.places(grid.centres(index)) + _EDGE).astype(np.int64)
    inside = ((places >= 0) & (places < given.cells.shape[::-1])).all(axis=1)
    unknown = np.ones(len(index), dtype=np.bool_)
    unknown[inside] = given.cells[places[inside, 1], places[inside, 0]] < 0
    return unknown.reshape(grid.occupied.shape)
