"""Planners with a fault each."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from navloom import Claim, OccupancyGrid, Path, PlanFailure, PlannerInput
from navloom.messages import Point2D

from planted import Entries
from planted.sound import Flood

ENTRIES = Entries()


@ENTRIES.plant("first_request", caught_by="answers")
class FirstRequest(Flood):
    """Answers request 1, whatever the number of the request."""

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        return replace(super().plan(given), request_id=1)


@ENTRIES.plant("reversed_path", caught_by="answers")
class ReversedPath(Flood):
    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        answer = super().plan(given)
        return replace(answer, points=answer.points[::-1]) if isinstance(answer, Path) else answer


@ENTRIES.plant("raises_at_walls", caught_by="typed_failures")
class RaisesAtWalls(Flood):
    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        answer = super().plan(given)
        if isinstance(answer, PlanFailure):
            raise RuntimeError(answer.detail)
        return answer


@ENTRIES.plant("none_at_walls", caught_by="typed_failures")
class NoneAtWalls(Flood):
    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        answer = super().plan(given)
        return None if isinstance(answer, PlanFailure) else answer  # type: ignore[return-value]


@ENTRIES.plant("straight_on", caught_by="no_contact")
class StraightOn(Flood):
    """The straight line, whatever is in the way."""

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        start, goal = given.request.start, given.request.goal
        points = np.array([(start.x, start.y), (goal.x, goal.y)])
        return Path(given.request.request_id, points, math.hypot(start.x - goal.x, start.y - goal.y), None)


@ENTRIES.plant("rows_for_columns", caught_by="reaches")
class RowsForColumns(Flood):
    """Searches the transposed map."""

    def free(self, grid: OccupancyGrid) -> np.ndarray:
        free = super().free(grid)
        side = max(free.shape)
        square = np.ones((side, side), dtype=bool)
        square[: free.shape[0], : free.shape[1]] = free
        return square.T[: free.shape[0], : free.shape[1]]


@ENTRIES.plant("no_origin", caught_by="answers")
class NoOrigin(Flood):
    """Takes cell (0, 0) to lie at the map's origin."""

    def place(self, grid: OccupancyGrid, cell: tuple[int, int]) -> tuple[float, float]:
        return (cell[1] + 0.5) * grid.resolution, (cell[0] + 0.5) * grid.resolution

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        answer = super().plan(given)
        return replace(answer, points=answer.points[1:-1]) if isinstance(answer, Path) else answer


@ENTRIES.plant("unturned", caught_by="rotation")
class Unturned(Flood):
    """Ignores the heading of the raster."""

    claims = {Claim.ROTATION}

    def cell(self, grid: OccupancyGrid, place: object) -> tuple[int, int]:
        return super().cell(replace(grid, origin=replace(grid.origin, heading=0.0)), place)  # type: ignore[arg-type]

    def place(self, grid: OccupancyGrid, cell: tuple[int, int]) -> tuple[float, float]:
        return super().place(replace(grid, origin=replace(grid.origin, heading=0.0)), cell)


@ENTRIES.plant("point_robot", caught_by="footprint")
class PointRobot(Flood):
    """Plans for a point."""

    def radius(self) -> float:
        return 0.0


@ENTRIES.plant("four_ways", caught_by="optimal")
class FourWays(Flood):
    """No diagonal steps."""

    claims = {Claim.OPTIMAL}

    def steps(self) -> list[tuple[int, int, float]]:
        return [step for step in super().steps() if not (step[0] and step[1])]


@ENTRIES.plant("eight_ways", caught_by="optimal_any_angle")
class EightWays(Flood):
    """Optimal on its grid, which is not what it claims."""

    claims = {Claim.OPTIMAL_ANY_ANGLE}


@ENTRIES.plant("gives_up", caught_by="reaches")
class GivesUp(Flood):
    """Searches no further than 5 m."""

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        answer = super().plan(given)
        if isinstance(answer, Path) and answer.length > 5.0:
            goal = given.request.goal
            return PlanFailure(given.request.request_id, "no_path", Point2D(goal.x, goal.y), "too far")
        return answer


@ENTRIES.plant("through_the_last", caught_by="reaches")
class ThroughTheLast(Flood):
    """Plans through walls where there is no other path."""

    def search(self, free: np.ndarray, start: tuple[int, int], goal: tuple[int, int]) -> list[tuple[int, int]]:
        return super().search(free, start, goal) or super().search(np.ones_like(free), start, goal)


@ENTRIES.plant("marks_map", caught_by="inputs_untouched")
class MarksMap(Flood):
    """Writes its inflation into the map of its input."""

    def free(self, grid: OccupancyGrid) -> np.ndarray:
        free = super().free(grid)
        grid.cells.flags.writeable = True
        grid.cells[~free] = 100
        return free


@ENTRIES.plant("keeps_map", caught_by="fresh_process")
class KeepsMap(Flood):
    """Caches the first map of a process for ever, under the wrong key."""

    known: dict[str, np.ndarray] = {}

    def free(self, grid: OccupancyGrid) -> np.ndarray:
        free = super().free(grid)
        before = self.known.setdefault("map", free)
        if before.shape != free.shape or not np.array_equal(before, free):
            return self.known["map"] if before.shape == free.shape else ~(free | ~free)
        return free


@ENTRIES.plant("negative_length", caught_by="answers")
class NegativeLength(Flood):
    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        answer = super().plan(given)
        return replace(answer, length=-1.0) if isinstance(answer, Path) else answer


@ENTRIES.plant("half_length", caught_by="path_length")
class HalfLength(Flood):
    """Reports half the length of its path."""

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        answer = super().plan(given)
        return replace(answer, length=0.5 * answer.length) if isinstance(answer, Path) else answer
