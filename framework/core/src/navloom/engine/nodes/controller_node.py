"""The node around a controller."""

from __future__ import annotations

from navloom.engine.answer_checks import TwistDoor
from navloom.engine.node_ports import Latest, Output
from navloom.engine.nodes.node_base import Tick
from navloom.engine.nodes.role_node import RoleNode
from navloom.engine.streams import ControllerPorts, LocalizerPorts, ReferencePorts
from navloom.messages import TrackingCommand
from navloom.roles import Controller, ControllerInput

__all__ = ["ControllerNode"]


class ControllerNode(RoleNode[Controller]):
    """Turns the reference into a velocity."""

    role = "controller"
    is_awaited = True
    reference = Latest(ReferencePorts.reference, triggers=True)
    trajectory = Latest(ReferencePorts.trajectory)
    pose = Latest(LocalizerPorts.pose)
    command = Output(ControllerPorts.command)
    cause = reference

    def __init__(self, plugin: Controller) -> None:
        self.plugin = plugin
        self.door = TwistDoor(plugin, TrackingCommand)

    def step(self, tick: Tick) -> None:
        trajectory, reference, pose = self.trajectory.value, self.reference.value, self.pose.value
        assert trajectory is not None and reference is not None and pose is not None
        seen = ControllerInput(tick.time_ns, trajectory, reference, pose, self.extra())
        self.command.put(self.door.check(self.plugin.control(seen)))
