"""The nodes of a robot, in their listed order, and the facts about roles that follow from the nodes' classes."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType

from navloom.config.schema import Config
from navloom.engine.node_ports import Wired
from navloom.engine.nodes.avoider_node import AvoiderNode
from navloom.engine.nodes.controller_node import ControllerNode
from navloom.engine.nodes.gate_node import GateNode
from navloom.engine.nodes.goal_node import GoalNode
from navloom.engine.nodes.localizer_node import LocalizerNode
from navloom.engine.nodes.mapper_node import MapperNode
from navloom.engine.nodes.node_base import Node
from navloom.engine.nodes.node_plugin import NodePlugin
from navloom.engine.nodes.operator_node import OperatorNode
from navloom.engine.nodes.planner_node import PlannerNode
from navloom.engine.nodes.platform_node import PlatformNode
from navloom.engine.nodes.recovery_node import RecoveryNode
from navloom.engine.nodes.reference_node import ReferenceNode
from navloom.engine.nodes.world_node import WorldNode
from navloom.engine.streams import PlatformPorts, PortTable, WorldPorts
from navloom.messages import Message
from navloom.plugins import Discovery, PluginError
from navloom.roles import ROLES

__all__ = ["FRAMEWORK", "NODES", "Catalogue", "catalogue_of"]

NODES: tuple[type[Node], ...] = (
    OperatorNode,
    WorldNode,
    PlatformNode,
    LocalizerNode,
    MapperNode,
    GoalNode,
    PlannerNode,
    ReferenceNode,
    ControllerNode,
    AvoiderNode,
    RecoveryNode,
    GateNode,
)
"""The nodes of a robot that has every role; two that do not depend on each other step in this order."""


class Catalogue(PortTable):
    """The nodes of one robot by name: those of every robot, and the node plugins that its config names.

    Args:
        strangers: Classes of the config's `[[node]]` tables, by name.
        required: Names of those without which the robot does not drive.
        roles: Roles that the robot has; those that it lacks are optional ones.
        moves: Something moves in its simulated world: it has a node `world`.

    Attributes:
        nodes: Class of each node by name, in listed order.
        absent: Optional roles that the robot lacks, and `world` if nothing moves there.
        optional: Nodes whose failure does not end a goal.
    """

    def __init__(
        self,
        strangers: Mapping[str, type[NodePlugin]] = MappingProxyType({}),
        required: Collection[str] = (),
        roles: Collection[str] = ROLES.keys(),
        moves: bool = False,
    ) -> None:
        # Per config and not per process: `compare` runs several configs in one.
        self.strangers = dict(strangers)
        self.absent = frozenset([*ROLES, *(() if moves else ("world",))]).difference(roles)
        own = {node.role: node for node in NODES if node.role not in self.absent}
        # Strangers last: nodes that do not depend on each other step in listed order, and a new one must not move the
        # others.
        self.nodes: dict[str, type[Node]] = {**own, **strangers}
        super().__init__(port for role, node in self.nodes.items() for port in node.ports(Wired(role)))
        extra = [role for role in own if role in ROLES and ROLES[role].facts.is_optional]
        idle = [role for role in extra if not any(port.required for port in self.ports(role))]
        self.optional = frozenset([*strangers, *idle]).difference(required)
        self._required = (*(port.role for port in self._ports.values() if port.required), *required)

    def required_roles(self) -> tuple[str, ...]:
        """Nodes without which the robot does not drive autonomously."""
        return tuple(dict.fromkeys(self._required))

    def answer_ports(self, role: str) -> tuple[str, ...]:
        """Ports that carry a node's result."""
        return tuple(port.name for port in self.ports(role) if port.answers)

    def warming_ports(self, role: str) -> tuple[str, ...]:
        """Ports on which a message shows that an instance can take over; empty if an instance always can."""
        # A planner publishes only when it is asked: waiting for its first answer would delay a swap until the next
        # goal.
        return () if self.nodes[role].answers_when_asked else self.answer_ports(role)

    def is_patient(self, role: str) -> bool:
        """Whether a node's step may take long because no motor waits for it; False for the framework's own nodes."""
        plugin = ROLES.get(role) or self.strangers.get(role)
        return plugin is not None and plugin.is_patient


FRAMEWORK = Catalogue(moves=True)
"""The nodes of a robot that has every role, in a world where something moves."""


def catalogue_of(config: Config, discovery: Discovery | None = None) -> tuple[Catalogue, dict[str, str]]:
    """The catalogue of a config's robot, and by name why a node is missing: its plugin is broken or not installed.

    Whether anything moves in its world is not looked up: the node `world` is in it.
    """
    if not config.node and ROLES.keys() <= set(config.roles):
        return FRAMEWORK, {}
    discovery = discovery or Discovery(config.plugins.blocked)
    found: dict[str, type[NodePlugin]] = {}
    missing: dict[str, str] = {}
    for table in config.node:
        try:
            found[table.name] = node_plugin(discovery, table.plugin)
        except PluginError as error:
            # Tools look at robots whose distributions they lack: a missing node must not hide the rest.
            missing[table.name] = str(error)
    required = [table.name for table in config.node if table.required and table.name in found]
    return Catalogue(found, required, config.roles, moves=True), missing


def node_plugin(discovery: Discovery, name: str) -> type[NodePlugin]:
    """The class of a node plugin. Raises PluginError."""
    cls = discovery.node(name)
    if not issubclass(cls, NodePlugin):
        raise PluginError(f"node.{name}: {cls.__name__} is no subclass of navloom.NodePlugin")
    return cls


def carries_truth(kind: type[Message]) -> bool:
    """Whether messages of a class tell the ground truth, which no plugin may read."""
    return kind in (PlatformPorts.truth.carries, WorldPorts.bodies.carries)
