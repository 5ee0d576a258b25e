"""The node around a planner."""

from __future__ import annotations

from navloom.engine.door import PlannerDoor
from navloom.engine.nodes.node import Tick
from navloom.engine.nodes.role_node import RoleNode
from navloom.engine.ports import Latest, New, Output
from navloom.engine.streams import GoalPorts, MapperPorts, PlannerPorts
from navloom.messages import Path
from navloom.roles import Planner, PlannerInput

__all__ = ["PlannerNode"]


class PlannerNode(RoleNode[Planner]):
    """Turns the newest request into a path, or the reason why there is none. `tolerance` is the goal's, m."""

    role = "planner"
    plan = New(GoalPorts.plan, triggers=True)
    map = Latest(MapperPorts.map)
    path = Output(PlannerPorts.path)
    failure = Output(PlannerPorts.failure)
    cause = plan

    def __init__(self, plugin: Planner, tolerance: float) -> None:
        self.plugin = plugin
        self.door = PlannerDoor(plugin, tolerance)

    def step(self, tick: Tick) -> None:
        known = self.map.value
        if known is None:
            return
        seen = PlannerInput(self.plan.values[-1], known, self.extra())
        answer = self.door.check(self.plugin.plan(seen), seen)
        if isinstance(answer, Path):
            self.path.put(answer)
        else:
            self.failure.put(answer)
