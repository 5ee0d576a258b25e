"""Plays whole nodes: their inputs, and one object of a node."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from navloom.engine.node_ports import Declared, Port, SensorGroup, Wired
from navloom.engine.nodes.node_base import Tick
from navloom.engine.nodes.node_plugin import NodePlugin
from navloom.engine.open_loop_node import FedNode
from navloom.engine.streams import PLAIN, sensor_port
from navloom.messages import Message, RangeScan, Sweep
from navloom.roles import Context

from navloom_check import messages, scenes
from navloom_check.checked_plugin import Subject
from navloom_check.plugin_player import Player
from navloom_check.samples import message_in_drive

__all__ = ["NodeInput", "NodePlayer", "message_at", "node_inputs", "sensor_kinds"]

PERIOD_NS = 50_000_000


@dataclass(frozen=True)
class NodeInput:
    """What a node reads in one step.

    Attributes:
        tick: The tick of the step.
        read: By input name: a message, or several where the input reads all that came; None before the first one.
    """

    tick: Tick
    read: Mapping[str, Any]


class NodePlayer(Player):
    """One object of a node. A step gives the messages that it publishes, each with its port."""

    def __init__(self, subject: Subject, context: Context, seed: int, params: Any = None) -> None:
        super().__init__(subject, context, seed, params)
        self._fed = FedNode(spec_of(subject.thing), self.plugin)

    def _step(self, given: NodeInput) -> Any:
        """Step the node with an input; errors of the node are raised unchanged."""
        raised: list[BaseException] = []

        def act(tick: Tick) -> None:
            try:
                self.plugin.step(tick)
            except BaseException as error:
                raised.append(error)
                raise

        answer = self._fed.step(given.tick, given.read, act)
        if raised:
            raise raised[0]
        return answer

    def _new_door(self) -> Callable[[Any, Any], Any]:
        return lambda answer, given: answer


def spec_of(cls: type[NodePlugin]) -> Any:
    """The wiring of a node: one other node publishes all inputs, and there is one sensor of each class."""
    name = cls.name
    sensors = [sensor_port(kind.__name__.lower(), kind) for kind in sensor_kinds(cls)]
    streams = {
        declared_input.name: _port(declared_input)
        for declared_input in cls.declared_inputs
        if isinstance(declared_input, Declared) and declared_input.port is None
    }
    return cls.spec(Wired(name, {name: sensors}, streams))


def _port(one: Declared[Any, Any]) -> Port[Any]:
    port = Port(one.carries, PLAIN)
    port.role, port.name = "other", one.name
    return port


def sensor_kinds(cls: type[NodePlugin]) -> list[type[Message]]:
    """Messages of the sensors that a node reads; a range scan where it reads any message."""
    kinds: dict[type[Message], None] = {}
    for declared_input in cls.declared_inputs:
        if isinstance(declared_input, SensorGroup):
            kinds |= dict.fromkeys(
                RangeScan if kind is Message else kind for kind in declared_input.carries or (RangeScan,)
            )
    return list(kinds)


def node_inputs(
    cls: type[NodePlugin], seed: int, *, is_early: bool = False, scans: RangeScan | None = None, steps: int = 40
) -> Iterator[NodeInput]:
    """Inputs of a node, step by step.

    Args:
        cls: Class of the node.
        seed: Seed of the values.
        is_early: Only the inputs that trigger the node have received messages.
        scans: What all its range sensors give; by default what they see of a room.
        steps: Number of steps.
    """
    rng = np.random.default_rng([seed, 1997])
    spec = spec_of(cls)
    for number in range(steps):
        tick = Tick(number, number * PERIOD_NS * 1e-9, number * PERIOD_NS, 0)
        read: dict[str, Any] = {}
        for given in spec.inputs:
            is_there = given.triggers or not is_early
            if given.reading == "latest":
                read[given.name] = message_at(given.source.carries, rng, number, scans) if is_there else None
            else:
                count = (1 + int(rng.integers(2)) if given.triggers else int(rng.integers(3))) if is_there else 0
                read[given.name] = tuple(message_at(given.source.carries, rng, number, scans) for _ in range(count))
        yield NodeInput(tick, read)


def message_at(kind: type[Message], rng: np.random.Generator, number: int, scans: RangeScan | None = None) -> Message:
    """A message as in a drive; for range scans the given one, if there is one."""
    stamp, at = number * PERIOD_NS * 1e-9, (0.01 * number, 0.0, 0.0)
    if scans is not None and kind is RangeScan:
        return replace(scans, stamp_ns=number * PERIOD_NS)
    if kind is RangeScan:
        return messages.scan(scenes.room(), at, stamp=stamp)
    if kind is Sweep:
        return messages.sweep(scenes.room(), at, stamp=stamp)
    return message_in_drive(kind, rng, number * PERIOD_NS, at, messages.trajectory().samples)
