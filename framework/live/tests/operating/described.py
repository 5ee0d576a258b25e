"""A robot made of descriptions: answers of its nodes, for tests of tools that need no process."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from navloom.messages import Envelope, Message
from navloom.messages.codec import encode, schema_label
from navloom_live.live.description import Description, StreamSummary
from navloom_live.operating.client import Client
from navloom_live.operating.robot_nodes import Node
from navloom_live.transport.keyspace import KeySpace
from navloom_live.transport.zenoh_bus import Answer

KEYS = KeySpace("lab", "r1")
PLACES = {
    "platform sim": "robot",
    "localizer odometry": "robot",
    "mapper grid": "think",
    "goal main": "think",
    "controller law": "drive",
    "avoider vfh": "drive",
    "gate main": "safe",
}
PORTS = {
    "platform": ("odometry", "sonars"),
    "localizer": ("pose",),
    "mapper": ("map",),
    "goal": ("feedback", "result"),
    "controller": ("command",),
    "avoider": ("command", "status"),
    "gate": ("command", "status", "selection"),
}


def described(role: str, instance: str, **changes: Any) -> Description:
    """Description of a healthy node, with changes; its process is that of `PLACES`."""
    fields: dict[str, Any] = {
        "role": role,
        "instance": instance,
        "plugin": instance,
        "process": PLACES.get(f"{role} {instance}", "drive"),
        "pid": 4711,
        "host": "base",
        "active": True,
        "enabled": True,
        "tick": 100,
        "epoch": 0,
        "versions": {"navloom": "1.0", "numpy": "2.0"},
        "config_sha256": "a" * 64,
        "clock_ns": 5_000_000_000,
        "silence_s": 0.02,
        "up_s": 5.0,
        "period_s": 0.05,
        "step_s": 0.004,
        "notes": (),
        "shares_memory": True,
        "shared_memory_mb": 900.0,
        "published": dict.fromkeys((*PORTS.get(role, ()), "step"), 7),
        "places": PLACES,
    }
    return Description(**{**fields, **changes})


def counts(**changes: Any) -> StreamSummary:
    """Counters of an input stream without losses."""
    return StreamSummary(**{"received": 1000, "dropped": 0, "malformed": 0, "late": 0, "latest": False, **changes})


def everyone(**changes: Mapping[str, Any]) -> list[Description]:
    """All nodes of `PLACES`, healthy but for the changes given by role."""
    names = (name.split() for name in PLACES)
    return [described(role, instance, **changes.get(role, {})) for role, instance in names]


def heard(nodes: Sequence[Description]) -> list[Node]:
    """The nodes, all of which answer."""
    return [Node(node.role, node.instance, node.process, node) for node in nodes]


class BusInWords:
    """Replaces the network: answers as the nodes would, and delivers messages to subscribers.

    Args:
        nodes: Description of each; a "wall_ns" of less than a day is how far its host's clock is ahead.
        silent: "role instance" of nodes that are announced but do not answer.
        last: role/instance/port -> last message that its publisher keeps.
        others: Tokens of other robots on the network.
        steps: Ticks that the nodes advance between two queries.
    """

    def __init__(
        self,
        nodes: Sequence[Description],
        silent: Sequence[str] = (),
        last: Mapping[str, Message] | None = None,
        others: Sequence[str] = (),
        steps: int = 1,
    ) -> None:
        self.nodes, self.silent, self.others, self.steps = nodes, silent, others, steps
        self.last = last or {}
        self.asked: list[str] = []
        self.listeners: dict[str, Callable[[str, bytes | None, str], None]] = {}
        self._questions = 0

    def alive(self, key_expr: str) -> list[str]:
        """Tokens of this robot, or of all."""
        own = [node.name for node in self.nodes]
        tokens = [KEYS.alive(*name.split(), "life") for name in (*own, *self.silent)]
        return tokens if key_expr.startswith(KEYS.prefix) else [*tokens, *self.others]

    def ask(self, key_expr: str, data: bytes = b"", timeout: float = 2.0) -> Iterator[Answer]:
        """Answers of the nodes to a query."""
        self.asked.append(key_expr)
        role, instance, port = KEYS.split(key_expr)
        if port == "describe":
            self._questions += 1
            for node in self.nodes:
                if role in ("*", node.role) and instance in ("*", node.instance):
                    yield self._description(node)
            yield Answer("", b"", "", "Timeout")
            return
        for stream, message in self.last.items():
            parts = stream.split("/")
            if role in ("*", parts[0]) and instance in ("*", parts[1]) and port == parts[2]:
                yield Answer(KEYS.port(*parts), *wire(message, stream), "")

    def _description(self, node: Description) -> Answer:
        tick = node.tick + self.steps * self._questions
        told = replace(node, tick=tick, wall_ns=time.time_ns() + (node.wall_ns or 0))
        return Answer(KEYS.port(node.role, node.instance, "describe"), json.dumps(told.to_json()).encode(), "json", "")

    def subscribe(self, key_expr: str, receive: Callable[[str, bytes | None, str], None], most: int = 0) -> None:
        """Keep a subscriber."""
        self.listeners[key_expr] = receive


def wire(message: Message, stream: str, sequence: int = 1, stamp_ns: int = 0, cause_ns: int = 0) -> tuple[bytes, str]:
    """Bytes and label of a message as they travel on role/instance/port."""
    envelope = Envelope(f"{KEYS.prefix}/{stream}", sequence, sequence, stamp_ns, cause_ns, 0)
    return encode(message, envelope), schema_label(type(message))


def client(bus: BusInWords) -> Client:
    return Client(bus, KEYS)  # type: ignore[arg-type]
