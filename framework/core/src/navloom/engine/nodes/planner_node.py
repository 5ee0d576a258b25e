"""The node around a planner."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Self

import numpy as np

from navloom.engine.answer_checks import PlannerDoor
from navloom.engine.node_ports import Latest, New, Output
from navloom.engine.nodes.node_base import NodeSettings, Tick
from navloom.engine.nodes.role_node import RoleNode
from navloom.engine.streams import GoalPorts, MapperPorts, PlannerPorts
from navloom.geometry.collision import unknown_remedy
from navloom.geometry.footprints import circumscribed_radius
from navloom.geometry.world import Place, World
from navloom.messages import MapUpdate, Path, PlanFailure, PlanRequest
from navloom.roles import Planner, PlannerInput, RobotSpec

__all__ = ["PlannerNode", "with_unknown_named"]

_ENDS = {"start_occupied": "start", "goal_occupied": "goal"}


class PlannerNode(RoleNode[Planner]):
    """Turns the newest request into a path, or the reason why there is none.

    `tolerance` is the goal's, m; `robot` and `map_world`, the world of the known map, tell where that map is unknown.

    If what the mapper saw leaves no path, the node also plans on the known map and publishes both answers: a
    person in the only door may have left before the robot is there, and until then the avoider stops it.
    """

    role = "planner"
    plan = New(GoalPorts.plan, triggers=True)
    map = Latest(MapperPorts.map)
    known = Latest(MapperPorts.known)
    path = Output(PlannerPorts.path)
    failure = Output(PlannerPorts.failure)
    cause = plan

    def __init__(
        self, plugin: Planner, tolerance: float, robot: RobotSpec | None = None, map_world: World | None = None
    ) -> None:
        self.plugin, self._robot, self._map_world = plugin, robot, map_world
        self.door = PlannerDoor(plugin, tolerance, robot)

    @classmethod
    def around(cls, plugin: Planner, settings: NodeSettings) -> Self:
        return cls(plugin, settings.tolerance, settings.robot, settings.map_world)

    def step(self, tick: Tick) -> None:
        newest, known = self.map.value, self.known.value
        # The goal asks only with a map; live, the request may overtake the map.
        if newest is None:
            return
        answer = self._plan(newest)
        if isinstance(answer, Path):
            self.path.put(answer)
            return
        # On equal cells the answer is known; planning twice takes its time.
        if known is not None and not np.array_equal(known.cells, newest.grid.cells):
            otherwise = self._plan(MapUpdate(newest.stamp_ns, known, np.empty((0, 4)), ()))
            if isinstance(otherwise, Path):
                self.path.put(otherwise)  # first: a failure that comes alone ends the goal
        self.failure.put(answer)

    def answer(self, request: PlanRequest) -> Path | PlanFailure | None:
        """The plan for a tool on the newest map, which is not published; None without a map."""
        return None if self.map.value is None else self._planned(request, self.map.value)

    def _plan(self, given: MapUpdate) -> Path | PlanFailure:
        # Only the newest request: the goal no longer waits for the others.
        return self._planned(self.plan.values[-1], given)

    def _planned(self, request: PlanRequest, given: MapUpdate) -> Path | PlanFailure:
        seen = PlannerInput(request, given, self.extra())
        answer = self.door.check(self.plugin.plan(seen), seen)
        # Without a known map of the mapper, its occupied cells are what it saw.
        if isinstance(answer, PlanFailure) and self.known.value is not None and self._robot and self._map_world:
            return with_unknown_named(answer, self._robot, self._map_world)
        return answer


def with_unknown_named(failure: PlanFailure, robot: RobotSpec, world: World) -> PlanFailure:
    """A failure whose detail says so if its start or goal is not free because the map is unknown there.

    Args:
        failure: Answer of a planner, for which unknown cells of the map are occupied.
        robot: The robot.
        world: The world of the map.
    """
    end = _ENDS.get(failure.kind)
    if end is None:
        return failure
    # A planner may keep the robot away from a wall at any heading, by whole cells.
    reach = circumscribed_radius(robot.footprint) + (world.raster.resolution if world.raster else 0.0)
    angles = np.arange(16) * (math.tau / 16)
    disc = reach * np.column_stack((np.cos(angles), np.sin(angles)))
    remedy = unknown_remedy(disc, Place(failure.place.x, failure.place.y), world, robot.height)
    place = f"({failure.place.x:.2f}, {failure.place.y:.2f})"
    return replace(failure, detail=f"the {end} {place}: {remedy}") if remedy else failure
