"""Every node there is, in the order they are listed; what others need to know of roles is read off these classes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

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

__all__ = ["NODES", "node_class", "required_roles", "specs_of", "warming_ports"]

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


def specs_of(wired: Mapping[str, Sequence[Port[Any]]]) -> list[NodeSpec]:
    """Every node with its wiring.

    Args:
        wired: By role, the ports of the sensors it gets; those of the platform are all.
    """
    return [node.spec(wired) for node in NODES]


def node_class(role: str) -> type[Node]:
    """The class of a role's nodes."""
    return next(node for node in NODES if node.role == role)


def required_roles() -> tuple[str, ...]:
    """Roles without which the robot does not drive by itself."""
    return tuple(dict.fromkeys(port.role for port in known_ports() if port.required))


def warming_ports(role: str) -> tuple[str, ...]:
    """Ports of a role that show by a message that an instance can take over; none for one that always can."""
    return tuple(port.name for port in known_ports(role) if port.warms)
