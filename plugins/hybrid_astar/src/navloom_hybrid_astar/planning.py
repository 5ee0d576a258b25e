"""Plan a drivable path from a map, a start pose and a goal. If there is none, report why and where."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from navloom_astar.grids import PlanningGrid, RasterMap, Spot, grid_of_cells, grid_of_segments
from navloom_astar.planning import Failure, GoalOccupied, NoPath, OutsideMap, StartOccupied
from numpy.typing import NDArray
from scipy import ndimage

from navloom_hybrid_astar import flood, search, smoothing
from navloom_hybrid_astar.clearance import Body, Ground, body_of, ground_of, is_free, touched
from navloom_hybrid_astar.motion import Motion, poses_after
from navloom_hybrid_astar.search import Lattice

__all__ = ["Driven", "HybridPlanner", "Settings", "sampled", "warm_up"]

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

_ANY = 16
"""Headings that are tried at a goal without one."""
_BEYOND = 5.0
"""How far the flood goes on behind the start, m, see `flood.distances_to`."""
_TURN = math.radians(20.0)
"""Largest turn in place between two points of a path, rad: the shorter way round must be the right one."""
_ROUNDING = 1e-3
"""Way, cells, and turn, rad, up to which two points of a path are one."""
_DEPTH = 2.0
"""How far the inscribed disc may be in an obstacle at the start, cells. A cell is occupied as a whole by an echo
anywhere in it, so a robot beside a wall may be that deep in its cells."""


@dataclass(frozen=True)
class Settings:
    """How maps become grids, and how the robot moves. Lengths in m.

    Attributes:
        source, cell, occupied_from, unknown: As in `navloom_astar.planning`, but unknown cells have no cost.
        clearance: Distance that the footprint keeps from obstacles where there is a path that does.
        radius: Least radius of an arc.
        backwards: Whether it may drive backwards.
        reverse: Extra cost of each metre backwards, m.
        switch: Cost of a change of direction, m.
        steer: Cost of a change from straight to the sharpest arc, m.
        turn: Cost of each rad turned in place, m; infinite for a robot that cannot.
        edge: Edge of the lattice's cells.
        headings: Number of the lattice's headings.
        most: Most expansions.
        further: See `search.Lattice`.
        rounds: Rounds of smoothing.
    """

    radius: float
    source: Literal["auto", "segments", "cells"] = "auto"
    cell: float = 0.05
    occupied_from: int = 50
    unknown: Literal["free", "blocked"] = "free"
    clearance: float = 0.0
    backwards: bool = True
    reverse: float = 0.0
    switch: float = 0.0
    steer: float = 0.0
    turn: float = math.inf
    edge: float = 0.2
    headings: int = 72
    most: int = 150_000
    further: float = 1.0
    rounds: int = 6


@dataclass(frozen=True, eq=False)
class Driven:
    """A path.

    Attributes:
        points: (n, 2) m, map frame. Successive points in one place are a turn in place.
        headings: (n,) rad in [-π, π), map frame.
        length: Length of the curves, m.
        expanded: Number of expansions.
    """

    points: Floats
    headings: Floats
    length: float
    expanded: int


class HybridPlanner:
    """Planner for any number of maps.

    Args:
        settings: See there.
        footprint: (n, 2) corners, convex, counter-clockwise, m, base frame.
    """

    def __init__(self, settings: Settings, footprint: Floats) -> None:
        self.settings, self.footprint = settings, footprint

    def plan(
        self, start: tuple[float, float, float], goal: Spot, heading: float | None, segments: Floats, given: RasterMap
    ) -> Driven | Failure:
        """A path that is cheap for the robot, with the footprint clear of all occupied cells.

        Args:
            start: x, y, m, heading, rad, map frame.
            goal: x, y, m, map frame.
            heading: Heading at the goal, rad, map frame; None for any.
            segments: (n, 4) x1, y1, x2, y2 of outlines, m, map frame.
            given: The raster map.
        """
        grid = self._grid(start, goal, segments, given)
        if isinstance(grid, Failure):
            return grid
        first, goals = _poses(grid, start, goal, heading)
        occupied = grid.occupied | grid.unknown if self.settings.unknown == "blocked" else grid.occupied
        tight = self._body(0.0, grid)
        ground = ground_of(occupied)
        if not _fits(first, ground, tight):
            deep = float(ground[0][int(first[1]), int(first[0])]) + _DEPTH < tight[2]
            if deep or not occupied.any():
                return StartOccupied(start[:2], f"the robot at the start {_at(start[:2])} is in an obstacle")
            ground = ground_of(occupied & ~touched(float(first[0]), float(first[1]), float(first[2]), ground, tight))
        free = [pose for pose in goals if _fits(pose, ground, tight)]
        if not free:
            return GoalOccupied(goal, f"the robot at the goal {_at(goal)} is in an obstacle or too near to one")
        answer: Driven | Failure | None = None
        if self.settings.clearance > 0.0:
            roomy = self._body(self.settings.clearance, grid)
            ends = [pose for pose in free if _fits(pose, ground, roomy)]
            if ends and _fits(first, ground, roomy):
                answer = self._search(grid, ground, roomy, first, np.array(ends))
        if not isinstance(answer, Driven):
            answer = self._search(grid, ground, tight, first, np.array(free))
        return answer

    def _body(self, margin: float, grid: PlanningGrid) -> Body:
        return body_of(self.footprint, margin, grid.resolution)

    def _grid(
        self, start: tuple[float, float, float], goal: Spot, segments: Floats, given: RasterMap
    ) -> PlanningGrid | Failure:
        use = self.settings
        if use.source == "segments" or (use.source == "auto" and len(segments) > 0):
            grid = grid_of_segments(segments, given, use.cell, start[:2], (start[:2], goal), 0.0, "supercover")
            if grid is None:
                return OutsideMap(goal, f"the goal {_at(goal)} is too far from the map for cells of {use.cell:g} m")
        else:
            grid = grid_of_cells(given, use.occupied_from)
        for name, spot in (("start", start[:2]), ("goal", goal)):
            if grid.cell_at(spot) is None:
                return OutsideMap(spot, f"the {name} {_at(spot)} is outside the map")
        return grid

    def _motion(self, resolution: float) -> Motion:
        use = self.settings
        return Motion(use.radius / resolution, use.reverse, use.switch / resolution, use.steer / resolution,
                      use.turn / resolution, use.backwards)  # fmt: skip

    def _search(self, grid: PlanningGrid, ground: Ground, body: Body, first: Floats, goals: Floats) -> Driven | Failure:
        use, resolution = self.settings, grid.resolution
        passable = _passable(ground, body)
        ends = _cell(goals[0], passable), _cell(first, passable)
        ahead = flood.distances_to(passable, *ends, _BEYOND / resolution)
        if not np.isfinite(ahead[ends[1]]):
            return self._no_path(grid, _nearest(passable, ends[1], ends[0]), ends[0], "no way is wide enough")
        motion, edge = self._motion(resolution), use.edge / resolution
        # A motion that leaves its cell also along the diagonal.
        lattice = Lattice(edge, use.headings, 1.5 * edge, use.most, use.further)
        moves, expanded, nearest = search.search(first, goals, ahead, ground, body, motion, lattice)
        if moves is None:
            why = "the search is at its bound" if expanded >= use.most else "the robot cannot turn so sharply"
            return self._no_path(grid, (int(nearest[1]), int(nearest[0])), ends[0], f"{why}, {expanded} expansions")
        moves = smoothing.shortened(first, moves, ground, body, motion, edge, use.rounds)
        poses = sampled(first, moves)
        places = np.array([grid.corner(y, x) for x, y in poses[:, :2].tolist()])  # corner() takes fractions too
        headings = (poses[:, 2] + grid.origin[2] + np.pi) % (2.0 * np.pi) - np.pi
        return Driven(places, headings, float(np.abs(moves[:, 1]).sum()) * resolution, expanded)

    def _no_path(self, grid: PlanningGrid, cell: tuple[int, int], goal: tuple[int, int], why: str) -> NoPath:
        (x, y), (gx, gy) = grid.centres(np.array([cell, goal])).tolist()
        gap = math.dist((x, y), (gx, gy))
        reached = f"the nearest point to it that was reached is {_at((x, y))}, {gap:.2f} m away"
        return NoPath((x, y), f"no free path to the goal {_at((gx, gy))}: {why}; {reached}")


def sampled(first: Floats, moves: Floats) -> Floats:
    """(n, 3) poses along a path, cells and rad: one to a cell, and the ends of all moves; none twice."""
    rows = []
    for curvature, length, angle in smoothing.split(moves, 1.0).tolist():
        count = max(1, math.ceil(abs(angle) / _TURN))
        rows += [(curvature, length / count, angle / count)] * count
    poses = poses_after(first, np.array(rows).reshape(-1, 3))
    # The direction of a segment that is only rounding would say nothing.
    steps = np.abs(np.diff(poses, axis=0))
    poses = poses[np.append((steps[:, :2].sum(axis=1) > _ROUNDING) | (steps[:, 2] > _ROUNDING), True)]
    poses[0] = first
    return poses if len(poses) > 1 else np.concatenate([poses, poses])


def _poses(
    grid: PlanningGrid, start: tuple[float, float, float], goal: Spot, heading: float | None
) -> tuple[Floats, Floats]:
    """Start (3,) and goals (m, 3) in cells of the grid."""
    turn = grid.origin[2]
    first = np.array([*grid.place(start[:2]), start[2] - turn])
    x, y = grid.place(goal)
    if heading is not None:
        return first, np.array([(x, y, heading - turn)])
    along = math.atan2(y - first[1], x - first[0])
    return first, np.array([(x, y, along + k * 2.0 * math.pi / _ANY) for k in range(_ANY)])


def _fits(pose: Floats, ground: Ground, body: Body) -> bool:
    return is_free(float(pose[0]), float(pose[1]), float(pose[2]), ground, body)


def _passable(ground: Ground, body: Body) -> Bools:
    """Cells with a place where the inscribed disc may be free: see `clearance.surely_hits`."""
    return ground[0] + math.sqrt(0.5) >= body[2]


def _cell(pose: Floats, passable: Bools) -> tuple[int, int]:
    return min(int(pose[1]), passable.shape[0] - 1), min(int(pose[0]), passable.shape[1] - 1)


def _nearest(passable: Bools, start: tuple[int, int], goal: tuple[int, int]) -> tuple[int, int]:
    """The cell connected with the start that is nearest to the goal."""
    parts, _ = ndimage.label(passable, structure=np.ones((3, 3)))
    rows, columns = np.nonzero(parts == parts[start])
    best = int(np.argmin((rows - goal[0]) ** 2 + (columns - goal[1]) ** 2))
    return int(rows[best]), int(columns[best])


def _at(spot: Spot) -> str:
    return f"({spot[0]:.2f}, {spot[1]:.2f})"


def warm_up() -> None:
    """Compile all kernels."""
    given = RasterMap(np.zeros((60, 60), dtype=np.int8), 0.05, (0.0, 0.0, 0.0))
    given.cells[20:40, 30] = 100
    outline = np.array([(0.2, -0.1), (0.2, 0.1), (-0.2, 0.1), (-0.2, -0.1)])
    for backwards, turn in ((True, math.inf), (False, 0.1)):
        planner = HybridPlanner(Settings(0.3, backwards=backwards, turn=turn, most=2000), outline)
        planner.plan((0.5, 1.5, 0.0), (2.5, 1.5), 0.0, np.empty((0, 4)), given)
