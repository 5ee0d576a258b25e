"""A framework with one more role, an optional `explorer`, declared as files of its own would declare it.

Import it before the framework: lists of roles are made when the framework is imported.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import navloom
import navloom.roles as roles
from navloom.engine.node_ports import Latest, Output, Port, Ports, Quality
from navloom.messages import MapUpdate, Message, Point2D, PoseEstimate
from navloom.roles.base import P, Role
from navloom.roles.claims import Claim
from navloom.roles.extra import NO_EXTRAS, Extras
from navloom.roles.facts import RoleFacts
from navloom.roles.struct import struct


@struct
class ExplorerInput:
    """What an explorer sees.

    Attributes:
        stamp_ns: Run clock.
        map: The newest map; None before the first.
        estimate: Pose in the map.
        extra: The plugin's own extra inputs.
    """

    stamp_ns: int
    map: MapUpdate | None
    estimate: PoseEstimate
    extra: Extras = NO_EXTRAS


class Explorer(Role[P]):
    """Chooses where the robot should look next."""

    role = "explorer"
    facts = RoleFacts("Called in every tick.", frozenset[Claim](), is_optional=True)
    is_patient = True
    accepts: ClassVar[tuple[type[Message], ...]] = ()

    @abstractmethod
    def explore(self, given: ExplorerInput) -> Point2D | None:
        """The place to drive to, map frame; None if nothing is left to see."""


class ExplorerPorts(Ports, role="explorer"):
    """Where the robot should look next."""

    place = Port(Point2D, Quality("drop", "data", "drop"), answers=True)


roles.ROLES["explorer"], roles.ROLE_API["explorer"] = Explorer, 1
vars(roles)["Explorer"], vars(roles)["ExplorerInput"] = Explorer, ExplorerInput
roles.__all__ += ["Explorer", "ExplorerInput"]
navloom.Explorer, navloom.ExplorerInput = Explorer, ExplorerInput

from navloom.engine import catalogue  # noqa: E402
from navloom.engine.answer_checks import TypeDoor  # noqa: E402
from navloom.engine.nodes.node_base import Tick  # noqa: E402
from navloom.engine.nodes.reference_node import ReferenceNode  # noqa: E402
from navloom.engine.nodes.role_node import RoleNode  # noqa: E402
from navloom.engine.streams import LocalizerPorts, MapperPorts  # noqa: E402


class ExplorerNode(RoleNode[Explorer]):
    """Publishes the explorer's place in every tick."""

    role = "explorer"
    ticks = True
    pose = Latest(LocalizerPorts.pose)
    map = Latest(MapperPorts.map)
    place = Output(ExplorerPorts.place)
    cause = pose

    def __init__(self, plugin: Explorer) -> None:
        self.plugin, self.door = plugin, TypeDoor(plugin)

    def step(self, tick: Tick) -> None:
        """Ask the plugin once it can know where it is."""
        if self.pose.value is None:
            return
        answer = self.door.check(
            self.plugin.explore(ExplorerInput(tick.time_ns, self.map.value, self.pose.value, self.extra()))
        )
        if answer is not None:
            self.place.put(answer)


class HearingNode(ReferenceNode):
    """A node of every robot that reads what an optional role publishes."""

    where = Latest(ExplorerPorts.place, delayed=True)

    def step(self, tick: Tick) -> None:
        """Look where the explorer is heading before following the trajectory."""
        assert self.where.value is None or isinstance(self.where.value, Point2D)
        super().step(tick)


given = [HearingNode if node is ReferenceNode else node for node in catalogue.NODES]
catalogue.NODES = (*given, ExplorerNode)
catalogue.FRAMEWORK = catalogue.Catalogue()
