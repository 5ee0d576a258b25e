"""Every node there is, in the order they are listed; what others need to know of roles is read off these classes."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from navloom.config.schema import add_role_table
from navloom.engine.node import Node
from navloom.engine.own_nodes import GateNode, GoalNode, OperatorNode
from navloom.engine.ports import NodeSpec, Port, known_ports
from navloom.engine.reference import ReferenceNode
from navloom.engine.role_nodes import (
    AvoiderNode,
    ControllerNode,
    LocalizerNode,
    MapperNode,
    PlannerNode,
    PlatformNode,
    RecoveryNode,
)
from navloom.navigation.handover import HandOverRule
from navloom.roles import ROLE_API, ROLES, Avoider, Planner, Role

__all__ = ["NODES", "add_role", "answer_ports", "node_class", "required_roles", "role_node", "specs_of",
           "warming_ports"]  # fmt: skip

NODES: list[type[Node]] = [
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
]
"""The nodes of every robot; of two that do not read each other the first steps first."""


def specs_of(wired: Mapping[str, Sequence[Port[Any]]], roles: Collection[str] = ROLES) -> list[NodeSpec]:
    """Every node with its wiring.

    Args:
        wired: By role, the ports of the sensors it gets; those of the platform are all.
        roles: Those that the robot has; the framework's own nodes are always there.
    """
    return [node.spec(wired) for node in NODES if node.role in roles or node.role not in ROLES]


def node_class(role: str) -> type[Node]:
    """The class of a role's nodes."""
    return next(node for node in NODES if node.role == role)


def role_node(plugin: Role, rule: HandOverRule | None = None, look_ahead: float = 0.0, tolerance: float = 0.0) -> Node:
    """The node for a plugin.

    Args:
        plugin: The plugin.
        rule, look_ahead: For an avoider: who drives, and how far that looks along the robot's own way, m.
        tolerance: For a planner: how near to its goal the robot must come, m.
    """
    if isinstance(plugin, Planner):
        return PlannerNode(plugin, tolerance)
    if isinstance(plugin, Avoider):
        assert rule is not None
        return AvoiderNode(plugin, rule, look_ahead)
    return node_class(plugin.role)(plugin)


def required_roles() -> tuple[str, ...]:
    """Roles without which the robot does not drive by itself."""
    return tuple(dict.fromkeys(port.role for port in known_ports() if port.required))


def answer_ports(role: str) -> tuple[str, ...]:
    """Ports of a role that are what it is for."""
    return tuple(port.name for port in known_ports(role) if port.answers)


def warming_ports(role: str) -> tuple[str, ...]:
    """Ports of which a message shows that an instance can take over; none for a role that can at once."""
    return () if node_class(role).answers_when_asked else answer_ports(role)


def add_role(role: type[Role], node: type[Node]) -> None:
    """Give the framework one role more: config tables, the graph, every executor, quality and swaps follow.

    Args:
        role: The ABC that its plugins implement, with `role` as its name.
        node: Its node, with its ports declared.

    Raises:
        ValueError: There is a role of that name, or the node is of another.
    """
    if role.role in ROLES or node.role != role.role:
        raise ValueError(f"role {role.role!r} with {node.__name__} of {node.role!r}: expected a new role, and its node")
    ROLES[role.role], ROLE_API[role.role] = role, role.api
    NODES.append(node)
    add_role_table(role.role)
