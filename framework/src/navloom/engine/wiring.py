"""Slots and wires of the lockstep executor: references are passed, nothing is copied."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from navloom.engine.nodes import Node
from navloom.engine.ports import Input, NodeSpec
from navloom.messages import Envelope, Message
from navloom.messages.codec import schema_label

__all__ = ["Instance", "Slot", "Wire", "runs"]

Watcher = Callable[[Message, Envelope], None]
TRACK_LENGTH = 4096
QUEUE_LENGTH = 1024


class Slot:
    """One output port of one instance: its newest message, and the one before for `~` readers."""

    __slots__ = ("envelope", "key", "labels", "message", "older", "place", "queues", "sequence", "tick", "watchers")

    def __init__(self, key: str, place: str) -> None:
        self.key = key
        self.place = place
        self.message: Message | None = None
        self.envelope: Envelope | None = None
        self.tick = -1
        self.older: tuple[Message | None, Envelope | None, int] = (None, None, -1)
        self.sequence = 0
        self.queues: list[deque[tuple[int, Message, int]]] = []
        self.watchers: list[Watcher] = []
        self.labels: dict[type[Message], bytes] = {}

    def put(self, message: Message, tick: int, made: int, stamp_ns: int, cause_ns: int, epoch: int) -> None:
        """Publish in a tick what was made in an earlier or the same tick."""
        self.take(message, Envelope(self.key, self.sequence + 1, made, stamp_ns, cause_ns, epoch), tick)

    def take(self, message: Message, envelope: Envelope, tick: int) -> None:
        """Hold a message as the newest one, published in a tick."""
        if self.tick < tick:
            self.older = (self.message, self.envelope, self.tick)
        self.sequence = envelope.sequence
        self.message, self.envelope, self.tick = message, envelope, tick
        for queue in self.queues:
            queue.append((tick, message, envelope.sequence))
        for watcher in self.watchers:
            watcher(message, envelope)

    def label(self, cls: type[Message]) -> bytes:
        """What a trace calls a message of this port."""
        if cls not in self.labels:
            self.labels[cls] = f"{self.place} {schema_label(cls)}".encode()
        return self.labels[cls]


class _Track:
    """Messages of a queue by place, for a node that looks at the newest few of thousands; holds during a step."""

    __slots__ = ("_queue",)

    def __init__(self, queue: deque[tuple[int, Message, int]]) -> None:
        self._queue = queue

    def __len__(self) -> int:
        return len(self._queue)

    def __getitem__(self, place: int) -> Message:
        return self._queue[place][1]


class Wire:
    """One input of one node instance, led to the slot of the selected instance."""

    __slots__ = ("delayed", "input", "queue", "reading", "slot")

    def __init__(self, given: Input, slot: Slot) -> None:
        self.input = given
        self.reading = given.reading
        self.delayed = given.delayed
        self.slot = slot
        self.queue: deque[tuple[int, Message, int]] | None = None
        if self.reading in ("new", "track"):
            self.queue = deque(maxlen=TRACK_LENGTH if self.reading == "track" else QUEUE_LENGTH)
            slot.queues.append(self.queue)

    def lead_to(self, slot: Slot) -> None:
        """Read another instance's port from now on; what is queued stays."""
        if self.queue is not None:
            self.slot.queues.remove(self.queue)
            slot.queues.append(self.queue)
        self.slot = slot

    def has_news(self, since: int, tick: int) -> bool:
        """Something was published after the tick `since` that may be read in this one."""
        if self.queue is not None:
            return bool(self.queue) and (not self.delayed or self.queue[0][0] < tick)
        at = self.slot.older[2] if self.delayed and self.slot.tick == tick else self.slot.tick
        return at > since

    def read(self, tick: int, since: int) -> Any:
        """What the node gets; see `Reading`. New messages older than the tick `since` were missed and are dropped."""
        slot, queue = self.slot, self.queue
        if queue is None:
            old = self.delayed and slot.tick == tick
            message, envelope = slot.older[:2] if old else (slot.message, slot.envelope)
            if self.reading == "latest":
                return message
            return None if message is None else (message, envelope)
        if self.reading == "track":
            return _Track(queue)
        if not queue:
            return ()
        if not self.delayed:
            fresh = tuple(entry[1] for entry in self._fresh(tick, since))
            queue.clear()
            return fresh
        fresh = tuple(entry[1] for entry in self._fresh(tick, since))
        while queue and queue[0][0] < tick:
            queue.popleft()
        return fresh

    def _fresh(self, tick: int, since: int) -> list[tuple[int, Message, int]]:
        assert self.queue is not None
        if self.delayed:
            return [entry for entry in self.queue if entry[0] < tick]
        return [entry for entry in self.queue if entry[0] > since or self.input.triggers]

    def sequences(self, tick: int, since: int) -> tuple[int, ...]:
        """Sequence numbers of what `read` would give; of a track the first and last of each run, see `InputRead`."""
        if self.queue is not None:
            if self.reading == "track":
                return runs([entry[2] for entry in self.queue])
            return tuple(entry[2] for entry in self._fresh(tick, since))
        old = self.delayed and self.slot.tick == tick
        envelope = self.slot.older[1] if old else self.slot.envelope
        return () if envelope is None else (envelope.sequence,)


def runs(numbers: Sequence[int]) -> tuple[int, ...]:
    """First and last of each run of consecutive numbers, one after the other."""
    if not numbers:
        return ()
    breaks = [place for place in range(1, len(numbers)) if numbers[place] != numbers[place - 1] + 1]
    firsts = [0, *breaks]
    lasts = [*(place - 1 for place in breaks), len(numbers) - 1]
    return tuple(numbers[place] for pair in zip(firsts, lasts, strict=True) for place in pair)


@dataclass
class Instance:
    """One node of the running graph.

    Attributes:
        spec, node: Its row of the table and the node itself.
        name: Name of the instance.
        active: It is the selected one of its role.
        enabled: It steps; an alternative that waits does not.
        stride: Ticks between steps.
        delay: Ticks its outputs are delayed by.
        slots: By port.
        wires: Its inputs; `latest` are those that read the newest message of this tick, `others` the rest.
        triggers: Inputs that make it step.
        cause: Input its outputs derive from.
        stepped: Tick of its last step.
        given: What it reads, by name, filled anew for each step.
    """

    spec: NodeSpec
    node: Node
    name: str
    active: bool
    enabled: bool
    stride: int
    delay: int
    slots: dict[str, Slot]
    wires: list[Wire] = field(default_factory=list)
    stepped: int = -1
    cause: Wire | None = None
    triggers: list[Wire] = field(default_factory=list)
    latest: list[tuple[str, Wire]] = field(default_factory=list)
    others: list[tuple[str, Wire]] = field(default_factory=list)
    given: dict[str, Any] = field(default_factory=dict)

    def connect(self, wire: Wire) -> None:
        """Add an input. Plain ones, which are most, are read without a call."""
        given = wire.input
        self.wires.append(wire)
        plain = given.reading == "latest" and not given.delayed
        (self.latest if plain else self.others).append((given.name, wire))
        if given.triggers:
            self.triggers.append(wire)
        if given.name == self.spec.cause:
            self.cause = wire

    def read(self, number: int, since: int) -> dict[str, Any]:
        """What the node is given in a tick; see `Wire.read`."""
        given = self.given
        for name, wire in self.latest:
            given[name] = wire.slot.message
        for name, wire in self.others:
            given[name] = wire.read(number, since)
        return given

    def cause_of(self, time_ns: int) -> int:
        """Platform stamp that outputs of this tick derive from."""
        wire = self.cause
        return time_ns if wire is None or wire.slot.envelope is None else wire.slot.envelope.cause_ns

    def fired(self, number: int) -> str:
        """What makes it step in a tick: "tick", the input with news, or nothing."""
        if self.spec.ticks:
            return "tick"
        return next((wire.input.name for wire in self.triggers if wire.has_news(self.stepped, number)), "")
