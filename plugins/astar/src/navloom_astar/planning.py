"""Plan a path from a map, a start and a goal. If there is none, report why and where."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from navloom_astar import inflation, jump, raster, search
from navloom_astar.escape import way_out
from navloom_astar.grids import PlanningGrid, RasterMap, Spot, enlarged, grid_of_cells, grid_of_segments
from navloom_astar.raster import RasterMethod
from navloom_astar.search import EXTRA_UNIT, Cell, Closed, Ends, GridSearch

__all__ = ["Failure", "Found", "GoalOccupied", "GridPlanner", "NoPath", "OutsideMap", "Search", "Settings",
           "StartOccupied", "WayOfCells", "warm_up"]  # fmt: skip

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
_OUT_OF_A_CORNER = 1.5
"""Longest way out of the inflation, in multiples of its reach plus one cell.

The way out at a corner is up to sqrt(2) times as long as at a wall, and cells are coarse.
"""
_SQUEEZE_COST = 3
"""Extra cost of each metre that is nearer to obstacles than the inflation allows, m per m.

A robot that must fit its heading to a passage drives it slowly, and has no room to avoid anything there.
"""
_SMOOTHING_CELLS = 3
"""Half width of the corridor around such a part of a way, cells. The framework smooths the path within it."""
FailureKind = Literal["start_occupied", "goal_occupied", "outside_map", "no_path"]


@dataclass(frozen=True)
class Settings:
    """How maps are turned into grids and how the grids are searched.

    Attributes:
        source: Map content to plan on. "auto": segments if there are any, otherwise the map's own cells.
        cell: Edge of a cell of the grid that segments are drawn on, m.
        raster, paper_t: See `raster.draw_segments`.
        margin: Margin around everything the grid must contain, m. Used for grids of segments and for enlarged grids.
        outside: What happens if the start or goal is outside the map's own cells. "refused": planning fails.
            "unknown": the grid is enlarged with unknown cells.
        occupied_from: Lowest value of a cell that counts as an obstacle, percent.
        inflation: How obstacles are grown. "cells": by a square. "metres": by a disc. "auto": "cells" on segments,
            "metres" on the map's cells.
        dilation_cells: Half width of the square of "cells", cells.
        radius: Radius of the disc of "metres", m.
        unknown: Unknown cells are free, are obstacles, or have an extra cost of `unknown_cost` times their length.
        unknown_cost: Extra cost per length on unknown cells, no unit; rounded to eighths, up to 31.
        squeeze: Smaller radius for "metres", m. Ground between it and `radius` has an extra cost. None: it is closed.
        escape: Longest way out of the inflation from the start, m. None: 1.5 times the sum of its reach and one cell.
    """

    source: Literal["auto", "segments", "cells"] = "auto"
    cell: float = 0.40
    raster: RasterMethod = "distance"
    paper_t: float = 2.0
    margin: float = 0.0
    outside: Literal["refused", "unknown"] = "refused"
    occupied_from: int = 50
    inflation: Literal["auto", "cells", "metres", "none"] = "auto"
    dilation_cells: int = 2
    radius: float = 0.0
    unknown: Literal["free", "blocked", "cost"] = "free"
    unknown_cost: float = 1.0
    squeeze: float | None = None
    escape: float | None = None


@dataclass(frozen=True, eq=False)
class Found:
    """A path.

    Attributes:
        points: (n, 2) start, centres of the cells along the way or at its turns, goal; m, map frame; n >= 2.
        length: Length of that polyline, m.
        traversable: (rows, columns) of the grid: cells in which the centre of the robot may be.
        grid: The grid that was searched.
    """

    points: Floats
    length: float
    traversable: Bools
    grid: PlanningGrid


@dataclass(frozen=True)
class Failure:
    """Why there is no path. `place` is the point it concerns, m, map frame; `detail` is one sentence for people."""

    kind: ClassVar[FailureKind]
    place: Spot
    detail: str


class StartOccupied(Failure):
    """The start is in an obstacle, or deeper in the inflation than `Settings.escape`."""

    kind = "start_occupied"


class GoalOccupied(Failure):
    """The goal is in an obstacle or its inflation."""

    kind = "goal_occupied"


class OutsideMap(Failure):
    """The start or goal is outside the map, or too far away to create a grid that contains it."""

    kind = "outside_map"


class NoPath(Failure):
    """Start and goal are not connected; `place` is the reachable point that is nearest to the goal."""

    kind = "no_path"


class WayOfCells(Protocol):
    """Result of a search: `cells` (n, 2), rows and columns from start to goal, each next to or in sight of the last."""

    @property
    def cells(self) -> NDArray[np.int64]: ...


class Search(Protocol):
    """Search on grids of one shape. For arguments and results, see `GridSearch.shortest`."""

    shape: tuple[int, int]

    def __init__(self, shape: tuple[int, int]) -> None: ...

    def shortest(
        self, free: Bools, start: Cell, goal: Cell, extra: NDArray[np.uint8] | None, ends: Ends
    ) -> WayOfCells | Closed: ...


class GridPlanner:
    """Planner for any number of maps. It keeps the work arrays of the last grid size.

    Args:
        settings: How maps become grids and how these are searched.
        anchor: Point that is the centre of a cell of the grid of segments, m, map frame. None: the lowest x and y of
            the segments, the x_min and y_min of Hoang et al. 2013, III.A.
        search: Class of the search, which is created with a grid's shape (rows, columns).
    """

    def __init__(self, settings: Settings, anchor: Spot | None, search: type[Search] = GridSearch) -> None:
        self.settings = settings
        self.anchor = anchor
        self._make_search = search
        self._search: Search | None = None

    def plan(self, start: Spot, goal: Spot, segments: Floats, given: RasterMap) -> Found | Failure:
        """A shortest path on the grid.

        Args:
            start, goal: m, map frame.
            segments: (n, 4) x1, y1, x2, y2 of outlines, m, map frame.
            given: The raster map.
        """
        use = self.settings
        on_segments = use.source == "segments" or (use.source == "auto" and len(segments) > 0)
        grid: PlanningGrid | None
        if on_segments:
            anchor = self.anchor or _lowest(segments, start)
            grid = grid_of_segments(segments, given, use.cell, anchor, (start, goal), use.margin, use.raster,
                                    use.paper_t)  # fmt: skip
            if grid is None:
                return OutsideMap(goal, f"the goal {_at(goal)} is too far from the map for cells of {use.cell:g} m")
        else:
            grid = grid_of_cells(given, use.occupied_from)
            if use.outside == "unknown":
                grid = enlarged(grid, (start, goal), use.margin)
                if grid is None:
                    return OutsideMap(goal, f"the goal {_at(goal)} is too far from the map for its cells")
        occupied = grid.occupied | grid.unknown if use.unknown == "blocked" else grid.occupied
        ends = _ends(grid, start, goal)
        if isinstance(ends, Failure):
            return ends
        reach, wide = self._reach(grid.resolution, on_segments), None
        traversable = _outside(occupied, reach)
        if self._inflation(on_segments) == "metres" and use.squeeze is not None and use.squeeze < use.radius:
            reach, wide = inflation.disc_reach(use.squeeze / grid.resolution), traversable
            traversable = _outside(occupied, reach)
        return self._attempt(grid, occupied, traversable, reach, ends, (start, goal), wide)

    def _attempt(
        self,
        grid: PlanningGrid,
        occupied: Bools,
        traversable: Bools,
        reach: NDArray[np.int32],
        cells: tuple[Cell, Cell],
        ends: tuple[Spot, Spot],
        wide: Bools | None,
    ) -> Found | Failure:
        """Plan on traversable cells. Those outside `wide`, if given, have an extra cost."""
        start, goal = ends
        if not traversable[cells[1]]:
            return GoalOccupied(goal, f"the goal {_at(goal)} is {_where(grid, occupied, cells[1])}")
        way = [cells[0]]
        if not traversable[cells[0]]:
            away = _OUT_OF_A_CORNER * (float(reach[0]) + 1.0) * grid.resolution
            away = away if self.settings.escape is None else self.settings.escape
            found = None if occupied[cells[0]] else way_out(occupied, traversable, *cells, away / grid.resolution)
            if found is None:
                return StartOccupied(start, f"the start {_at(start)} is {_where(grid, occupied, cells[0])}")
            way = found
        return self._connect(grid, traversable, way, cells[1], ends, wide)

    def _inflation(self, on_segments: bool) -> str:
        chosen = self.settings.inflation
        return ("cells" if on_segments else "metres") if chosen == "auto" else chosen

    def _reach(self, resolution: float, on_segments: bool) -> NDArray[np.int32]:
        use, chosen = self.settings, self._inflation(on_segments)
        if chosen == "cells":
            return inflation.square_reach(use.dilation_cells)
        return inflation.disc_reach(use.radius / resolution if chosen == "metres" else 0.0)

    def _connect(
        self,
        grid: PlanningGrid,
        traversable: Bools,
        way: list[Cell],
        goal: Cell,
        ends: tuple[Spot, Spot],
        wide: Bools | None,
    ) -> Found | Failure:
        """Search from the last cell of the way out of the inflation to the goal, and join both."""
        if self._search is None or self._search.shape != traversable.shape:
            self._search = self._make_search((traversable.shape[0], traversable.shape[1]))
        leave = ends[0] if len(way) == 1 else tuple(grid.centres(np.array(way[-1:]))[0].tolist())
        places = grid.place(leave), grid.place(ends[1])
        answer = self._search.shortest(traversable, way[-1], goal, self._extra(grid, wide), places)
        if isinstance(answer, Closed):
            x, y = grid.centres(np.array([answer.nearest]))[0].tolist()
            gap = math.dist((x, y), ends[1])
            reached = f"the nearest point to it that can be reached is {_at((x, y))}, {gap:.2f} m away"
            return NoPath((x, y), f"no free path to the goal {_at(ends[1])}: {reached}")
        cells = np.concatenate([np.array(way[:-1], dtype=np.int64).reshape(-1, 2), answer.cells])
        points = np.concatenate([grid.centres(cells[:1]), grid.centres(cells)])[-max(2, len(cells)) :]
        points[0], points[-1] = ends
        if wide is not None:
            traversable = _with_passages(wide, traversable, grid.places(points) - 0.5)
        _open_way(traversable, way)
        return Found(points, float(np.hypot(*np.diff(points, axis=0).T).sum()), traversable, grid)

    def _extra(self, grid: PlanningGrid, wide: Bools | None) -> NDArray[np.uint8] | None:
        """(rows, columns) extra cost per length, in units of 1 / `EXTRA_UNIT`; None if no cell has any."""
        if self.settings.unknown != "cost" and wide is None:
            return None
        extra = np.zeros(grid.occupied.shape, dtype=np.uint8)
        if self.settings.unknown == "cost":
            extra[grid.unknown] = min(255, round(self.settings.unknown_cost * EXTRA_UNIT))
        if wide is not None:
            extra[~wide] = _SQUEEZE_COST * EXTRA_UNIT
        return extra if extra.any() else None


def _lowest(segments: Floats, otherwise: Spot) -> Spot:
    """Lowest x and y of segments, m, map frame; without segments another point."""
    if not len(segments):
        return otherwise
    low = segments.reshape(-1, 2).min(axis=0)
    return float(low[0]), float(low[1])


def _outside(occupied: Bools, reach: NDArray[np.int32]) -> Bools:
    grown = inflation.grow(occupied, reach)
    return np.logical_not(grown, out=grown)


def _with_passages(wide: Bools, narrow: Bools, points: Floats) -> Bools:
    """The cells of `wide`, and those of `narrow` around the parts of a polyline that are outside `wide`.

    Args:
        points: (n, 2) columns and rows of its corners; whole numbers are cell centres.
    """
    segments, touched = np.concatenate([points[:-1], points[1:]], axis=1), np.zeros(wide.shape, dtype=np.bool_)
    raster.draw_segments(touched, segments, "supercover")
    touched &= ~wide
    if touched.any():
        entered = np.zeros_like(wide)
        raster.draw_segments(entered, segments)
        # A cell of which only a corner is touched, beside a diagonal step, is no passage to smooth the path in.
        entered &= touched
        touched |= inflation.grow(entered, inflation.square_reach(_SMOOTHING_CELLS)) & narrow
    touched |= wide
    return touched


def _ends(grid: PlanningGrid, start: Spot, goal: Spot) -> tuple[Cell, Cell] | Failure:
    first, last = grid.cell_at(start), grid.cell_at(goal)
    if first is None:
        return OutsideMap(start, f"the start {_at(start)} is outside the map")
    if last is None:
        return OutsideMap(goal, f"the goal {_at(goal)} is outside the map")
    return first, last


def _open_way(traversable: Bools, way: list[Cell]) -> None:
    """Mark a way out of the inflation, and the cells beside its diagonal steps, as traversable, in place."""
    for step in pairwise(way):
        (low, left), (high, right) = np.min(step, axis=0), np.max(step, axis=0)
        traversable[low : high + 1, left : right + 1] = True


def _where(grid: PlanningGrid, occupied: Bools, cell: Cell) -> str:
    if occupied[cell] and not grid.occupied[cell]:
        return "in unknown space, which is blocked"
    return "in an obstacle" if occupied[cell] else "too near to an obstacle for the robot"


def _at(spot: Spot) -> str:
    return f"({spot[0]:.2f}, {spot[1]:.2f})"


def warm_up() -> None:
    """Compile all kernels."""
    search.warm_up()
    jump.warm_up()
    inflation.warm_up()
    raster.warm_up()
