"""The node around a localizer."""

from __future__ import annotations

from navloom.engine.door import LocalizerDoor
from navloom.engine.nodes.node import Tick
from navloom.engine.nodes.role_node import RANGES, RoleNode, in_order, readings_of
from navloom.engine.ports import Latest, OtherSensors, Output, Sensors
from navloom.engine.streams import LocalizerPorts, MapperPorts, PlatformPorts
from navloom.roles import Localizer, LocalizerInput

__all__ = ["LocalizerNode"]


class LocalizerNode(RoleNode[Localizer]):
    """Turns odometry and scans into a pose in the map."""

    role = "localizer"
    is_awaited = True
    odometry = Latest(PlatformPorts.odometry, triggers=True)
    scans = Sensors(RANGES)
    readings = OtherSensors(RANGES)
    map = Latest(MapperPorts.map, delayed=True)
    pose = Output(LocalizerPorts.pose)
    cause = odometry

    def __init__(self, plugin: Localizer) -> None:
        self.plugin = plugin
        self.door = LocalizerDoor(plugin)

    def step(self, tick: Tick) -> None:
        odometry = self.odometry.value
        assert odometry is not None
        scans, names = in_order(self.scans)
        seen = LocalizerInput(odometry, scans, self.map.value, names, readings_of(self.readings), self.extra())
        self.pose.put(self.door.check(self.plugin.localize(seen), seen))
