"""The nodes of a robot, in their listed order, and the facts about roles that follow from the nodes' classes."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from types import MappingProxyType

from navloom.config.schema import Config
from navloom.engine.nodes.avoider import AvoiderNode
from navloom.engine.nodes.controller import ControllerNode
from navloom.engine.nodes.gate import GateNode
from navloom.engine.nodes.goal import GoalNode
from navloom.engine.nodes.localizer import LocalizerNode
from navloom.engine.nodes.mapper import MapperNode
from navloom.engine.nodes.node import Node
from navloom.engine.nodes.node_plugin import NodePlugin
from navloom.engine.nodes.operator import OperatorNode
from navloom.engine.nodes.planner import PlannerNode
from navloom.engine.nodes.platform import PlatformNode
from navloom.engine.nodes.recovery import RecoveryNode
from navloom.engine.nodes.reference import ReferenceNode
from navloom.engine.ports import Wired
from navloom.engine.streams import PortTable
from navloom.messages import Message
from navloom.navigation.handover import HandOverRule
from navloom.plugins import Discovery, PluginError
from navloom.roles import ROLES, Avoider, Planner, Platform, Role, SensorSpec

__all__ = ["FRAMEWORK", "NODES", "Catalogue", "catalogue_of", "role_node"]

NODES: tuple[type[Node], ...] = (
    OperatorNode,
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
"""The nodes of every robot; two that do not depend on each other step in this order."""


class Catalogue(PortTable):
    """The nodes of one robot by name: those of every robot, and the node plugins that its config names.

    Args:
        strangers: Classes of the config's `[[node]]` tables, by name.
        required: Names of those without which the robot does not drive.

    Attributes:
        nodes: Class of each node by name, in listed order.
        optional: Nodes whose failure does not end a goal.
    """

    def __init__(
        self, strangers: Mapping[str, type[NodePlugin]] = MappingProxyType({}), required: Collection[str] = ()
    ) -> None:
        self.strangers = dict(strangers)
        self.nodes: dict[str, type[Node]] = {**{node.role: node for node in NODES}, **strangers}
        self.optional = frozenset(strangers).difference(required)
        super().__init__(port for role, node in self.nodes.items() for port in node.ports(Wired(role)))
        self._required = (*(port.role for port in self._ports.values() if port.required), *required)

    def required_roles(self) -> tuple[str, ...]:
        """Nodes without which the robot does not drive autonomously."""
        return tuple(dict.fromkeys(self._required))

    def answer_ports(self, role: str) -> tuple[str, ...]:
        """Ports that carry a node's result."""
        return tuple(port.name for port in self.ports(role) if port.answers)

    def warming_ports(self, role: str) -> tuple[str, ...]:
        """Ports on which a message shows that an instance can take over; empty if an instance always can."""
        return () if self.nodes[role].answers_when_asked else self.answer_ports(role)

    def is_patient(self, role: str) -> bool:
        """Whether a node's step may take long because no motor waits for it; False for the framework's own nodes."""
        plugin = ROLES.get(role) or self.strangers.get(role)
        return plugin is not None and plugin.is_patient


FRAMEWORK = Catalogue()
"""The nodes of every robot."""


def catalogue_of(config: Config, discovery: Discovery | None = None) -> tuple[Catalogue, dict[str, str]]:
    """The catalogue of a config's robot, and by name why a node is missing: its plugin is broken or not installed."""
    if not config.node:
        return FRAMEWORK, {}
    discovery = discovery or Discovery(config.plugins.blocked)
    found: dict[str, type[NodePlugin]] = {}
    missing: dict[str, str] = {}
    for table in config.node:
        try:
            found[table.name] = node_plugin(discovery, table.plugin)
        except PluginError as error:
            missing[table.name] = str(error)
    return Catalogue(found, [table.name for table in config.node if table.required and table.name in found]), missing


def node_plugin(discovery: Discovery, name: str) -> type[NodePlugin]:
    """The class of a node plugin. Raises PluginError."""
    cls = discovery.node(name)
    if not issubclass(cls, NodePlugin):
        raise PluginError(f"node.{name}: {cls.__name__} is no subclass of navloom.NodePlugin")
    return cls


def role_node(
    plugin: Role,
    rule: HandOverRule | None = None,
    look_ahead: float = 0.0,
    tolerance: float = 0.0,
    sensors: Iterable[SensorSpec] = (),
) -> Node:
    """The node for a plugin.

    Args:
        plugin: The plugin.
        rule, look_ahead: For an avoider: the hand-over rule, and how far it looks along the robot's own way, m.
        tolerance: For a planner: how near to its goal the robot must come, m.
        sensors: For a platform: those it is to provide.
    """
    if isinstance(plugin, NodePlugin):
        return plugin
    if isinstance(plugin, Platform):
        return PlatformNode(plugin, sensors)
    if isinstance(plugin, Planner):
        return PlannerNode(plugin, tolerance)
    if isinstance(plugin, Avoider):
        assert rule is not None
        return AvoiderNode(plugin, rule, look_ahead)
    return FRAMEWORK.nodes[plugin.role](plugin)


def carries_truth(kind: type[Message]) -> bool:
    """Whether messages of a class tell the ground truth, which no plugin may read."""
    return any(port.carries is kind for port in FRAMEWORK.ports("platform") if port.name == "truth")
