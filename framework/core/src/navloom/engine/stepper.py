"""One step of a node, the same for every executor: check the triggers, read the inputs, run the node, report faults.

Lockstep, live, barrier and replay all step here. They differ only in what fills the slots and when a step happens:
lockstep asks `Stepper.fired` once a tick, a live process `LiveRunner._due` whenever something arrives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import monotonic_ns, thread_time_ns
from typing import Any

from navloom.engine.node_ports import NodeSpec
from navloom.engine.nodes.node_base import Node, Outputs, Tick
from navloom.engine.wiring import Slot, Wire
from navloom.plugins.error_origin import raised_in

__all__ = ["Read", "Stepper", "fault_text", "waiting_words"]

Read = tuple[tuple[str, tuple[int, ...]], ...]
"""Inputs by name, each with the sequence numbers of the messages that a step read."""


class Stepper:
    """One instance of a node in the running graph.

    Args:
        spec: Its wiring.
        node: The node.
        name: Name of the instance.
        slots: Slots that hold its messages, by port; empty if its messages leave the process.
        active: It is the active instance of its role.
        enabled: It steps; a waiting alternative does not.
        stride: Ticks between steps.
        delay: Delay of its outputs, in ticks.

    Attributes:
        wires: Its inputs.
        cause: Input its outputs derive from.
        stepped: Tick of its last step.
        spent_ns, computed_ns: Duration of its last step, and the thread's CPU time within it.
        fault: Text of the exception that its last step raised; empty for none.
        busy_since_ns: Monotonic clock at the start of the current step; None between two steps. For watchdogs.
        lacks: Streams that it waits for: it does not step before the first message of each.
    """

    def __init__(
        self,
        spec: NodeSpec,
        node: Node,
        name: str,
        slots: dict[str, Slot],
        *,
        active: bool = True,
        enabled: bool = True,
        stride: int = 1,
        delay: int = 0,
    ) -> None:
        self.spec, self.node, self.name, self.slots = spec, node, name, slots
        self.active, self.enabled, self.stride, self.delay = active, enabled, stride, delay
        self.role = spec.role
        self.wires: list[Wire] = []
        self.stepped = -1
        self.cause: Wire | None = None
        self.triggers: list[Wire] = []
        self.spent_ns = self.computed_ns = 0
        self.fault = ""
        self.busy_since_ns: int | None = None
        self.lacks: tuple[str, ...] = ()
        self._needed: list[Wire] = []
        self._ticks = spec.ticks
        self._read_ahead: list[Wire] = []
        self._due: dict[int, list[tuple[Outputs, Tick, int]]] = {}

    def connect(self, wires: list[Wire]) -> None:
        """Connect the node to its inputs."""
        self.wires = list(wires)
        self.triggers = [wire for wire in wires if wire.input.triggers]
        self.cause = next((wire for wire in wires if wire.input.name == self.spec.cause), None)
        self._read_ahead = [wire for wire in wires if wire.is_read_ahead]
        self._needed = [wire for wire in wires if wire.input.is_needed]
        self.node.wire(self.spec, {wire.input.name: wire for wire in wires})
        for out in self.node.outs():
            out.slot = self.slots.get(out.name)

    def is_short(self, number: int = -1) -> bool:
        """Whether a needed input has no message yet, in this tick or at all; sets `lacks`."""
        if not self._needed:
            return False
        # A stream that once had a message is not looked at again.
        self._needed = [wire for wire in self._needed if not wire.sequences(number, -1)]
        self.lacks = tuple([str(wire.input.source) for wire in self._needed])
        return bool(self._needed)

    def fired(self, number: int) -> str:
        """What makes it step in a tick: "tick", the name of the input with a new message, or empty for nothing."""
        if self._needed and self.is_short(number):
            return ""
        if self._ticks:
            return "tick"
        for wire in self.triggers:
            if wire.has_news(self.stepped, number):
                return wire.input.name
        return ""

    def read_marks(self, number: int, since: int) -> Read:
        """Sequence numbers of what a step in a tick would read, by input; for queues, those after tick `since`."""
        return tuple([(wire.input.name, wire.sequences(number, since)) for wire in self.wires])

    def prepare(self, number: int, since: int) -> None:
        """Read the inputs for a tick; from queues, the messages after tick `since`."""
        for wire in self._read_ahead:
            wire.prepare(number, since)

    def step(self, tick: Tick, since: int) -> Outputs:
        """Step on the current contents of the slots; see `run`."""
        self.prepare(tick.number, since)
        outputs = self.run(tick, self.node.step)
        self.stepped = tick.number
        return outputs

    def run(self, tick: Tick, act: Callable[[Tick], None]) -> Outputs:
        """What the node publishes on prepared inputs; empty if it raises, and then `fault` holds the text."""
        node = self.node
        before = self.busy_since_ns = monotonic_ns()
        # Of this thread alone: other programs on a busy machine are not the plugin's fault.
        computed = thread_time_ns()
        try:
            act(tick)
            self.fault = ""
        # A plugin that calls `sys.exit` must not end the process of other nodes.
        except (Exception, SystemExit) as error:
            # All or nothing: half of the outputs of a failed step would be in the trace.
            node.made.clear()
            self.fault = fault_text(error, node)
        self.busy_since_ns = None
        self.spent_ns, self.computed_ns = monotonic_ns() - before, thread_time_ns() - computed
        made = node.made
        # The list is handed out, not copied, so that the node needs a new one.
        if made:
            node.made = []
        return made

    def cause_of(self, time_ns: int) -> int:
        """Platform stamp that outputs of this tick derive from."""
        wire = self.cause
        # Before its first input, a node derives from now: its output is as old as the tick.
        return time_ns if wire is None or wire.slot.when is None else wire.slot.when[2]

    def hold_back(self, outputs: Outputs, tick: Tick, cause_ns: int) -> None:
        """Hold the outputs of a step until its delay is over."""
        # By tick, because a node with a stride may hold several.
        self._due.setdefault(tick.number + self.delay, []).append((outputs, tick, cause_ns))

    def due(self, number: int) -> list[tuple[Outputs, Tick, int]]:
        """Outputs that were held back until this tick."""
        return self._due.pop(number, [])


def waiting_words(role: str, name: str, lacks: Sequence[str]) -> str:
    """Which instance waits for which streams, as text."""
    return f"{role} {name} for {' and '.join(lacks)}" if lacks else ""


def fault_text(error: BaseException, source: Any) -> str:
    """What a node or a plugin's class raised, with the innermost line of the plugin's own code."""
    cls = source if isinstance(source, type) else type(getattr(source, "plugin", source))
    return raised_in(error, cls)
