"""Shortest paths on a grid as navloom planners."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from navloom import (
    Claim,
    Context,
    Derived,
    OccupancyGrid,
    Path,
    PlanFailure,
    Planner,
    PlannerInput,
    Point2D,
    Pose2D,
    RobotSpec,
)

from navloom_astar import planning
from navloom_astar.grids import RasterMap
from navloom_astar.jump import JumpPointSearch
from navloom_astar.params import PRINTED, ROBUST, AstarParams
from navloom_astar.planning import Found, GridPlanner, Search
from navloom_astar.search import DijkstraSearch, GridSearch

__all__ = ["AStar", "Dijkstra", "JumpPoint", "PlannerOnGrid"]


class PlannerOnGrid(Planner[AstarParams]):
    """Base of the planners on a grid. Subclasses only choose the search."""

    claims = {Claim.OPTIMAL, Claim.TRANSLATION, Claim.ROTATION, Claim.MIRROR}

    search: ClassVar[type[Search]]
    """Class of the search; the planner creates one for each grid shape (rows, columns)."""

    def __init__(self, params: AstarParams, context: Context) -> None:
        super().__init__(params, context)
        anchor = params.anchor_at((context.start.x, context.start.y))
        self._planner = GridPlanner(params.settings(context.robot.footprint), anchor, type(self).search)

    @classmethod
    def derived(cls, params: AstarParams, robot: RobotSpec, period: float) -> Mapping[str, Derived]:
        return params.derived(robot.footprint)

    @classmethod
    def warm_up(cls) -> None:
        planning.warm_up()

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        request, grid = given.request, given.map.grid
        raster = RasterMap(grid.cells, grid.resolution, (grid.origin.x, grid.origin.y, grid.origin.heading))
        start, goal = (request.start.x, request.start.y), (request.goal.x, request.goal.y)
        answer = self._planner.plan(start, goal, given.map.segments, raster)
        if isinstance(answer, Found):
            # A view: a bool is a byte of 0 or 1.
            cells = 100 * (~answer.traversable).view(np.int8)
            cells.flags.writeable = False
            traversable = OccupancyGrid(cells, answer.grid.resolution, Pose2D(*answer.grid.origin))
            return Path(request.request_id, answer.points, answer.length, traversable)
        return PlanFailure(request.request_id, answer.kind, Point2D(*answer.place), answer.detail)


class AStar(PlannerOnGrid):
    """Shortest paths on a grid (Hoang et al. 2013, III.A)."""

    name = "astar"
    presets = {"robust": ROBUST, "printed": PRINTED}
    search = GridSearch


class Dijkstra(PlannerOnGrid):
    """The same paths without a heuristic (Dijkstra 1959)."""

    name = "dijkstra"
    search = DijkstraSearch


class JumpPoint(PlannerOnGrid):
    """The same paths by jump point search (Harabor & Grastien 2011, 2012)."""

    name = "jps"
    search = JumpPointSearch
