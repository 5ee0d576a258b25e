"""From a map, a start and a goal to a path, or the reason why there is none and where."""

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
"""The way out of the inflation of a corner is sqrt(2) times as long as out of that of a wall, and cells are coarse."""
_SQUEEZE_COST = 3
"""A metre through a passage narrower than the inflation counts as this many more."""
_SMOOTHING_CELLS = 3
"""How far beside its way through such a passage the robot may be, cells."""
FailureKind = Literal["start_occupied", "goal_occupied", "outside_map", "no_path"]


@dataclass(frozen=True)
class Settings:
    """How maps become grids, and grids are searched.

    Attributes:
        source: What is planned on; "auto": segments where there are any, else the map's own cells.
        cell: Edge of a cell of the grid that segments are drawn on, m.
        raster, paper_t: As of `raster.draw_segments`.
        margin: Round everything the grid must hold, m: that of segments, and one that is enlarged.
        outside: Start and goal beyond the map's own cells are refused, or it is enlarged by what is unknown.
        occupied_from: Cells of at least this value are obstacles, percent.
        inflation: "auto": "cells" on segments, "metres" on the map's cells.
        dilation_cells: Half width of the square of "cells".
        radius: Of the disc of "metres", m.
        unknown: What is not known is free, an obstacle, or costs `unknown_cost` times its length on top.
        unknown_cost: No unit; rounded to eighths, up to 31.
        squeeze: Smaller radius of "metres" for passages to be taken where there is no other way, m; None: never.
        escape: Longest way out of the inflation from the start, m; None: 1.5 times the reach of the inflation and a
            cell.
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
        points: (n, 2) start, centres of the cells between or at its turns, goal; m, map frame; n >= 2.
        length: Of that polyline, m.
        traversable: (rows, columns) of the grid: where the centre of the robot may be.
        grid: What was searched.
    """

    points: Floats
    length: float
    traversable: Bools
    grid: PlanningGrid


@dataclass(frozen=True)
class Failure:
    """Why there is no path: `place` is where, m, map frame; `detail` one sentence for people."""

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
    """Start or goal is not on the map, or too far away to make one."""

    kind = "outside_map"


class NoPath(Failure):
    """Start and goal are not connected; the place is where the search came nearest to the goal."""

    kind = "no_path"


class WayOfCells(Protocol):
    """What a search finds: `cells` (n, 2), rows and columns from start to goal, next to each other or in sight."""

    @property
    def cells(self) -> NDArray[np.int64]: ...


class Search(Protocol):
    """Searches on grids of one shape; arguments and answers as of `GridSearch.shortest`."""

    shape: tuple[int, int]

    def __init__(self, shape: tuple[int, int]) -> None: ...

    def shortest(
        self, free: Bools, start: Cell, goal: Cell, extra: NDArray[np.uint8] | None, ends: Ends
    ) -> WayOfCells | Closed: ...


class GridPlanner:
    """Plans on any number of maps; keeps the work arrays of the last grid size.

    Args:
        settings: See there.
        anchor: Where a cell centre of the grid of segments lies.
        search: Makes the search for grids of a shape (rows, columns).
    """

    def __init__(self, settings: Settings, anchor: Spot, search: type[Search] = GridSearch) -> None:
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
            grid = grid_of_segments(segments, given, use.cell, self.anchor, (start, goal), use.margin, use.raster,
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
        reach = self._reach(grid.resolution, on_segments)
        traversable = ~inflation.grow(occupied, reach)
        answer = self._attempt(grid, occupied, traversable, reach, ends, (start, goal))
        chosen = self._inflation(on_segments)
        if isinstance(answer, Failure) and chosen == "metres" and use.squeeze is not None and use.squeeze < use.radius:
            reach = inflation.disc_reach(use.squeeze / grid.resolution)
            wide, traversable = traversable, ~inflation.grow(occupied, reach)
            squeezed = self._attempt(grid, occupied, traversable, reach, ends, (start, goal), wide)
            answer = answer if isinstance(squeezed, Failure) else squeezed
        return answer

    def _attempt(
        self,
        grid: PlanningGrid,
        occupied: Bools,
        traversable: Bools,
        reach: NDArray[np.int32],
        cells: tuple[Cell, Cell],
        ends: tuple[Spot, Spot],
        wide: Bools | None = None,
    ) -> Found | Failure:
        """A path within one inflation; `wide` is where it should keep to if it can."""
        start, goal = ends
        if not traversable[cells[1]]:
            return GoalOccupied(goal, f"the goal {_at(goal)} is {_where(occupied, cells[1])}")
        way = [cells[0]]
        if not traversable[cells[0]]:
            away = _OUT_OF_A_CORNER * (float(reach[0]) + 1.0) * grid.resolution
            away = away if self.settings.escape is None else self.settings.escape
            found = None if occupied[cells[0]] else way_out(occupied, traversable, *cells, away / grid.resolution)
            if found is None:
                return StartOccupied(start, f"the start {_at(start)} is {_where(occupied, cells[0])}")
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
        """The search from the last cell of a way out of the inflation."""
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
        if wide is not None:
            traversable = wide | (traversable & _near(answer.cells, traversable.shape))
        _open_way(traversable, way)
        cells = np.concatenate([np.array(way[:-1], dtype=np.int64).reshape(-1, 2), answer.cells])
        points = np.concatenate([grid.centres(cells[:1]), grid.centres(cells)])[-max(2, len(cells)) :]
        points[0], points[-1] = ends
        return Found(points, float(np.hypot(*np.diff(points, axis=0).T).sum()), traversable, grid)

    def _extra(self, grid: PlanningGrid, wide: Bools | None) -> NDArray[np.uint8] | None:
        """What the ground costs besides its length, in parts of `EXTRA_UNIT`; None where nothing does."""
        if self.settings.unknown != "cost" and wide is None:
            return None
        extra = np.zeros(grid.occupied.shape, dtype=np.uint8)
        if self.settings.unknown == "cost":
            extra[grid.unknown] = min(255, round(self.settings.unknown_cost * EXTRA_UNIT))
        if wide is not None:
            extra[~wide] = _SQUEEZE_COST * EXTRA_UNIT
        return extra if extra.any() else None


def _near(cells: NDArray[np.int64], shape: tuple[int, ...]) -> Bools:
    """The surroundings of a way, for the framework to smooth it in."""
    on_way = np.zeros(shape, dtype=np.bool_)
    on_way[cells[:, 0], cells[:, 1]] = True
    turns = cells[:, ::-1].astype(np.float64)
    raster.draw_segments(on_way, np.concatenate([turns[:-1], turns[1:]], axis=1))
    return inflation.grow(on_way, inflation.square_reach(_SMOOTHING_CELLS))


def _ends(grid: PlanningGrid, start: Spot, goal: Spot) -> tuple[Cell, Cell] | Failure:
    first, last = grid.cell_at(start), grid.cell_at(goal)
    if first is None:
        return OutsideMap(start, f"the start {_at(start)} is outside the map")
    if last is None:
        return OutsideMap(goal, f"the goal {_at(goal)} is outside the map")
    return first, last


def _open_way(traversable: Bools, way: list[Cell]) -> None:
    """Mark a way out of the inflation as traversable, with the cells beside its diagonal steps, in place."""
    for step in pairwise(way):
        (low, left), (high, right) = np.min(step, axis=0), np.max(step, axis=0)
        traversable[low : high + 1, left : right + 1] = True


def _where(occupied: Bools, cell: Cell) -> str:
    return "in an obstacle" if occupied[cell] else "too near to an obstacle for the robot"


def _at(spot: Spot) -> str:
    return f"({spot[0]:.2f}, {spot[1]:.2f})"


def warm_up() -> None:
    """Compile all kernels."""
    search.warm_up()
    jump.warm_up()
    inflation.warm_up()
    raster.warm_up()
