"""The node around a planner."""

from __future__ import annotations

from typing import Self

import numpy as np

from navloom.engine.answer_checks import PlannerDoor
from navloom.engine.node_ports import Latest, New, Output
from navloom.engine.nodes.node_base import NodeSettings, Tick
from navloom.engine.nodes.role_node import RoleNode
from navloom.engine.streams import GoalPorts, MapperPorts, PlannerPorts
from navloom.messages import MapUpdate, Path, PlanFailure, PlanRequest
from navloom.roles import Planner, PlannerInput

__all__ = ["PlannerNode"]


class PlannerNode(RoleNode[Planner]):
    """Turns the newest request into a path, or the reason why there is none. `tolerance` is the goal's, m.

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

    def __init__(self, plugin: Planner, tolerance: float) -> None:
        self.plugin = plugin
        self.door = PlannerDoor(plugin, tolerance)

    @classmethod
    def around(cls, plugin: Planner, settings: NodeSettings) -> Self:
        return cls(plugin, settings.tolerance)

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
        return self.door.check(self.plugin.plan(seen), seen)
