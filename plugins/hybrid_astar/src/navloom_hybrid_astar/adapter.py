"""Hybrid A* as a navloom planner."""

from __future__ import annotations

import numpy as np
from navloom import Claim, Context, Path, PlanFailure, Planner, PlannerInput, Point2D
from navloom_astar.grids import RasterMap

from navloom_hybrid_astar import planning
from navloom_hybrid_astar.params import HybridAstarParams
from navloom_hybrid_astar.planning import Driven, HybridPlanner

__all__ = ["HybridAstar"]


class HybridAstar(Planner[HybridAstarParams]):
    """Drivable paths for long, asymmetric and car-like robots (Dolgov et al. 2010), with headings and cusps."""

    name = "hybrid_astar"
    claims = {Claim.TRANSLATION, Claim.FOOTPRINT, Claim.OPTIMAL}

    def __init__(self, params: HybridAstarParams, context: Context) -> None:
        super().__init__(params, context)
        self._planner = HybridPlanner(params.settings(context.robot), np.asarray(context.robot.footprint))

    @classmethod
    def warm_up(cls) -> None:
        planning.warm_up()

    def plan(self, given: PlannerInput) -> Path | PlanFailure:
        request, grid = given.request, given.map.grid
        raster = RasterMap(grid.cells, grid.resolution, (grid.origin.x, grid.origin.y, grid.origin.heading))
        start, goal = request.start, request.goal
        heading = None if request.any_heading else goal.heading
        answer = self._planner.plan(
            (start.x, start.y, start.heading), (goal.x, goal.y), heading, given.map.segments, raster
        )
        if isinstance(answer, Driven):
            return Path(request.request_id, answer.points, answer.length, None, answer.headings)
        return PlanFailure(request.request_id, answer.kind, Point2D(*answer.place), answer.detail)
