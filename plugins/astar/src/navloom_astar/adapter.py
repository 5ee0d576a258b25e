"""A* as a navloom planner."""

from __future__ import annotations

import numpy as np
from navloom import Context, OccupancyGrid, Path, PlanFailure, Planner, PlannerInput, Point2D, Pose2D

from navloom_astar import planning
from navloom_astar.grids import RasterMap
from navloom_astar.params import AstarParams
from navloom_astar.planning import Found, GridPlanner

__all__ = ["AStar"]


class AStar(Planner):
    """Shortest paths on a grid (Hoang et al. 2013, III.A)."""

    name = "astar"
    Params = AstarParams

    def __init__(self, params: AstarParams, context: Context) -> None:
        super().__init__(params, context)
        start = context.start
        self._planner = GridPlanner(params.settings(context.robot.footprint), (start.x, start.y))

    @classmethod
    def warm_up(cls) -> None:
        planning.warm_up()

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        request, grid = given.request, given.map.grid
        raster = RasterMap(grid.cells, grid.resolution, (grid.origin.x, grid.origin.y, grid.origin.heading))
        start, goal = (request.start.x, request.start.y), (request.goal.x, request.goal.y)
        answer = self._planner.plan(start, goal, given.map.segments, raster)
        if isinstance(answer, Found):
            cells = np.where(answer.traversable, np.int8(0), np.int8(100))
            traversable = OccupancyGrid(cells, answer.grid.resolution, Pose2D(*answer.grid.origin))
            return Path(request.request_id, answer.points, answer.length, traversable)
        return PlanFailure(request.request_id, answer.kind, Point2D(*answer.place), answer.detail)
