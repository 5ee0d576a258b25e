"""A node that is stepped on given inputs, from a recording or from the log of another robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from navloom.engine.node_ports import Input, NodeSpec, When
from navloom.engine.nodes.node_base import Node, Tick
from navloom.engine.stepper import Stepper
from navloom.engine.wiring import Slot, Wire, at_measurement
from navloom.messages import Message

__all__ = ["FedNode"]


class _FedWire(Wire):
    """An input that holds the given messages."""

    __slots__ = ("value", "values", "when")

    def __init__(self, given: Input) -> None:
        super().__init__(given, Slot("", ""))
        # Empty before the first step, as a slot is.
        self.hand(None)

    def hand(self, given: Any) -> None:
        """Take what the node will read: for `new` and `track` a sequence of messages, for `offers` a message with its
        envelope, otherwise a message; None for none. Stamps of sensors are those that were recorded.
        """
        reading, offset_ns = self.input.reading, self.input.source.offset_ns
        is_row = reading in ("new", "track")
        self.values = (given or ()) if is_row else ()
        self.value = None if is_row else given
        self.when: When | None = None
        if reading == "offers" and given is not None:
            self.value, self.when = given[0], given[1][2:]
        if offset_ns:
            self.values = [at_measurement(message, offset_ns) for message in self.values]
            self.value = None if self.value is None else at_measurement(self.value, offset_ns)


class FedNode:
    """Steps a node on given inputs.

    Args:
        spec: Its wiring.
        node: The node.

    Attributes:
        fault: Text of the exception that its last step raised; empty for none.
    """

    def __init__(self, spec: NodeSpec, node: Node) -> None:
        self.spec, self.node = spec, node
        self._wires = {given.name: _FedWire(given) for given in spec.inputs}
        # No slots: what it publishes is returned, and nothing may read it.
        self._stepper = Stepper(spec, node, "main", {})
        self._stepper.connect(list(self._wires.values()))

    @property
    def fault(self) -> str:
        """Text of the exception that its last step raised; empty for none."""
        return self._stepper.fault

    def step(
        self, tick: Tick, given: Mapping[str, Any], act: Callable[[Tick], None] | None = None
    ) -> list[tuple[str, Message]]:
        """Step, and return what the node publishes, as (port, message); empty if it raises.

        Args:
            tick: The tick.
            given: Its inputs by name; those left out are empty.
            act: The function to call; default: the node's `step`.
        """
        for name, wire in self._wires.items():
            wire.hand(given.get(name))
        # The stepper of the recorded run did not step either.
        if any(wire.value is None for wire in self._wires.values() if wire.input.is_needed):
            return []
        return [(out.name, message) for out, message in self._stepper.run(tick, act or self.node.step)]
