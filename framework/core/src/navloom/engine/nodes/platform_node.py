"""The node of the robot itself."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Self

from navloom.engine.answer_checks import PlatformDoor
from navloom.engine.node_ports import Latest, New, Output, SensorOutputs
from navloom.engine.nodes.node_base import Node, NodeSettings, Tick
from navloom.engine.streams import GatePorts, GoalPorts, PlatformPorts, WorldPorts
from navloom.messages import Command, Twist2D
from navloom.roles import Platform, PlatformInput, SensorSpec

__all__ = ["PlatformNode"]

STILL = Twist2D(0.0, 0.0, 0.0)


class PlatformNode(Node):
    """The robot itself."""

    role = "platform"
    ticks = True
    is_awaited = True
    command = Latest(GatePorts.command, delayed=True)
    sweep = New(GoalPorts.sweep, delayed=True)
    bodies = Latest(WorldPorts.bodies)
    odometry = Output(PlatformPorts.odometry)
    scans = SensorOutputs()
    contact = Output(PlatformPorts.contact)
    truth = Output(PlatformPorts.truth)

    def __init__(self, plugin: Platform, sensors: Iterable[SensorSpec], name: str = "") -> None:
        self.plugin, self.name = plugin, name
        self.door = PlatformDoor(plugin, sensors)
        self.driven: Command | None = None

    @classmethod
    def around(cls, plugin: Platform, settings: NodeSettings) -> Self:
        return cls(plugin, settings.sensors, settings.name)

    def step(self, tick: Tick) -> None:
        # Live, commands reach the wheels on arrival; the step then repeats the driven one for the simulator.
        command = self.driven or self.command.value
        sweeps = self.sweep.values
        twist = command.twist if command is not None else STILL
        bodies, own = self.bodies.value, -1
        if bodies is not None and self.name in bodies.names:
            # From the end, where the robots are: an actor may have the same name.
            own = len(bodies.names) - 1 - bodies.names[::-1].index(self.name)
        seen = PlatformInput(twist, sweeps[-1] if sweeps else None, tick.time_ns, bodies, own)
        got = self.door.check(self.plugin.advance(seen), seen)
        self.odometry.put(got.odometry)
        self.contact.put(got.contact)
        for name, scan in got.scans.items():
            self.scans[name].put(scan)
        if got.truth is not None:
            self.truth.put(got.truth)
