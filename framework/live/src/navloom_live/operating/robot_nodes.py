"""The nodes of a live robot: which are there, what they say about themselves, and which are missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from navloom_live.live.description import Description
from navloom_live.operating.client import Client, ClientError

__all__ = [
    "Missing",
    "Node",
    "answering",
    "listing",
    "missing",
    "neighbours_names",
    "platform_age",
    "present",
    "run_clock_ns",
]


@dataclass(frozen=True)
class Node:
    """A node on the network.

    Attributes:
        role, instance: Its names.
        process: Its process; None if no node that answers says it.
        description: Its description of itself; None if it does not answer, or answers what is none.
        unreadable: Why its answer could not be read; empty if it was, or if there was none.
    """

    role: str
    instance: str
    process: str | None
    description: Description | None
    unreadable: str = ""

    @property
    def name(self) -> str:
        """Role and instance."""
        return f"{self.role} {self.instance}"


class Missing(NamedTuple):
    """A node of the config that is missing.

    Attributes:
        role, instance: Its names.
        process: Process that the config assigns it to.
        host: Host of `[live.hosts]` with that process; empty if the config names none.
    """

    role: str
    instance: str
    process: str
    host: str


def listing(client: Client) -> list[Node]:
    """Every node with its description, in the order of the graph; also those that are announced but do not answer."""
    nodes = [Node(one.role, one.instance, one.process, one) for one in client.describe()]
    answered = {(node.role, node.instance) for node in nodes}
    places = _places(nodes)
    announced = {client.keys.split(key)[:2] for key in client.bus.alive(client.keys.alive("*", "*", "*"))}
    for role, name in sorted((announced | client.unreadable.keys()) - answered):
        why = client.unreadable.get((role, name), "")
        nodes.append(Node(role, name, places.get(f"{role} {name}"), None, why))
    order = {node: number for number, node in enumerate(places)}
    return sorted(nodes, key=lambda node: (order.get(node.name, len(order)), node.role))


def present(client: Client) -> list[Node]:
    """As `listing`. Raises ClientError if there is no node."""
    nodes = listing(client)
    if not nodes:
        raise ClientError(f"no node of robot {client.keys.prefix} is there; `navloom doctor` says why")
    return nodes


def answering(nodes: Sequence[Node]) -> list[Description]:
    """Descriptions of the nodes that answer."""
    return [node.description for node in nodes if node.description is not None]


def missing(nodes: Sequence[Node]) -> list[Missing]:
    """Nodes that the config of the others names, but that are not on the network."""
    there = {node.name for node in nodes}
    hosts: dict[str, str] = {}
    for node in answering(nodes):
        hosts |= node.hosts
    gone = [(*name.split(" ", 1), process) for name, process in _places(nodes).items() if name not in there]
    return [Missing(role, instance, process, hosts.get(process, "")) for role, instance, process in gone]


def neighbours_names(client: Client) -> list[str]:
    """Every realm/robot with a node on this network that this tool is allowed to see."""
    return sorted({"/".join(key.split("/")[:2]) for key in client.bus.alive("*/*/*/*/alive/*")})


def run_clock_ns(nodes: Sequence[Node]) -> int:
    """The run clock according to the node that is furthest ahead, ns; -1 if no node knows it."""
    return max((node.clock_ns for node in answering(nodes) if node.clock_ns is not None), default=-1)


def platform_age(nodes: Sequence[Node]) -> float | None:
    """Time since the last platform message, s: at the gate, or the shortest if there is no gate; None for never."""
    ages = {node.role: node.silence_s for node in answering(nodes) if node.silence_s is not None}
    return ages.get("gate", min(ages.values(), default=None))


def _places(nodes: Sequence[Node]) -> dict[str, str]:
    """Process of each "role instance", in the order of the graph, according to the nodes that answer."""
    found: dict[str, str] = {}
    for node in answering(nodes):
        found |= node.places
    return found
