"""Slots hold messages, and wires connect a node's inputs to slots. References are passed, nothing is copied."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from operator import itemgetter
from typing import Any

from navloom.engine.node_ports import Input, When
from navloom.messages import Envelope, Message
from navloom.messages.codec import schema_label

__all__ = ["QueueWire", "Slot", "Wire", "at_measurement", "make_wire", "runs"]

Watcher = Callable[[Message, Envelope], None]
TRACK_LENGTH = 4096
QUEUE_LENGTH = 1024
Entry = tuple[int, Message, int]
"""Tick, message and its sequence number."""
_message = itemgetter(1)
_as_tuple = tuple.__new__
"""Makes an envelope without calling its constructor."""


class Slot:
    """One output port of one instance: its newest message, and the one before for `~` readers.

    Args:
        key, place: Key of the port, and its role, instance and name for the trace.
        offset_ns: See `Port.offset_ns`. Readers receive corrected stamps, watchers the sensor's own, for recordings.

    Attributes:
        message: The newest message; None before the first. `value` is the same, for nodes that read the slot itself.
        sequence: Sequence number of the newest message; 0 before the first.
        when: Tick, run clock, cause and epoch of its envelope.
        tick: Tick in which it was published.
        older: Message, sequence number and tick of the newest message published before that tick.
    """

    __slots__ = ("_envelope", "key", "labels", "message", "offset_ns", "older", "place", "queues", "sequence", "tick",
                 "watchers", "when")  # fmt: skip
    value: Any

    def __init__(self, key: str, place: str, offset_ns: int = 0) -> None:
        self.key = key
        self.place = place
        self.offset_ns = offset_ns
        self.message: Message | None = None
        self._envelope: Envelope | None = None
        self.when: When | None = None
        self.tick = -1
        self.older: tuple[Message | None, int, int] = (None, 0, -1)
        self.sequence = 0
        self.queues: list[deque[Entry]] = []
        self.watchers: list[Watcher] = []
        self.labels: dict[type[Message], bytes] = {}

    @property
    def envelope(self) -> Envelope | None:
        """Envelope of the newest message; made on first use."""
        made = self._envelope
        if made is None and self.when is not None:
            # On demand: most messages are read without their envelope, and in lockstep that saves one object each.
            made = self._envelope = _as_tuple(Envelope, (self.key, self.sequence, *self.when))
        return made

    def take(self, message: Message, envelope: Envelope, tick: int) -> None:
        """Hold a message from an envelope as the newest one, published in a tick."""
        self.put(message, envelope.sequence, envelope[2:], tick, envelope)

    def put(self, message: Message, sequence: int, when: When, tick: int, envelope: Envelope | None = None) -> None:
        """Hold a message as the newest one, published in a tick."""
        # A second message within a tick replaces the first; the one before the tick stays for `~` readers.
        if self.tick < tick:
            self.older = (self.message, self.sequence, self.tick)
        read = at_measurement(message, self.offset_ns) if self.offset_ns else message
        self.message, self.sequence, self.when, self.tick, self._envelope = read, sequence, when, tick, envelope
        for queue in self.queues:
            queue.append((tick, read, sequence))
        # The envelope is made only if somebody looks.
        if self.watchers:
            at = self.envelope
            assert at is not None
            for watcher in self.watchers:
                watcher(message, at)

    def label(self, cls: type[Message]) -> bytes:
        """Label of this port's messages in a trace."""
        found = self.labels.get(cls)
        if found is None:
            found = self.labels[cls] = f"{self.place} {schema_label(cls)}".encode()
        return found


def at_measurement(message: Any, offset_ns: int) -> Message:
    """A sensor's message with its stamp corrected by an offset, ns; not before the beginning of the run clock."""
    corrected: Message = replace(message, stamp_ns=max(0, message.stamp_ns + offset_ns))
    return corrected


Slot.value = vars(Slot)["message"]  # an alias of `message`: a property would cost a call


class Wire:
    """One input of one node instance, connected to the slot of the active instance.

    Attributes:
        input: The input that it serves.
        slot: The slot that it reads.
        queue: Messages that wait for the node; None if only the newest message counts.
        is_read_ahead: `prepare` must be called before each step.
    """

    __slots__ = ("delayed", "input", "queue", "slot")
    is_read_ahead = False

    def __init__(self, given: Input, slot: Slot) -> None:
        self.input = given
        self.delayed = given.delayed
        self.slot = slot
        self.queue: deque[Entry] | None = None

    def bind(self, attributes: dict[str, Any], name: str) -> None:
        """Make this input an attribute of a node, or an entry of one of its groups."""
        attributes[name] = self

    def lead_to(self, slot: Slot) -> None:
        """Read another instance's port from now on; queued messages stay."""
        self.slot = slot

    def has_news(self, since: int, tick: int) -> bool:
        """Whether a message that may be read in this tick was published after tick `since`."""
        slot = self.slot
        # The publisher may already have stepped in this tick: a `~` reader must not see that.
        at = slot.older[2] if self.delayed and slot.tick == tick else slot.tick
        return at > since

    def prepare(self, tick: int, since: int) -> None:
        """Read the messages that the node receives in a tick."""

    def sequences(self, tick: int, since: int) -> tuple[int, ...]:
        """Sequence numbers of what the node would receive; of a track, the first and last of each run."""
        slot = self.slot
        is_older = self.delayed and slot.tick == tick
        message, sequence = slot.older[:2] if is_older else (slot.message, slot.sequence)
        return () if message is None else (sequence,)


class _PlainWire(Wire):
    """The newest message, read straight from the slot: the node's attribute is the slot."""

    __slots__ = ("_bound",)

    def __init__(self, given: Input, slot: Slot) -> None:
        super().__init__(given, slot)
        self._bound: tuple[dict[str, Any], str] = ({}, "")

    def bind(self, attributes: dict[str, Any], name: str) -> None:
        self._bound = attributes, name
        # The slot itself is the attribute: reading an input costs one look-up and no call.
        attributes[name] = self.slot

    def lead_to(self, slot: Slot) -> None:
        attributes, name = self._bound
        self.slot = attributes[name] = slot


class _OlderWire(Wire):
    """The newest message of the previous ticks."""

    __slots__ = ("value",)
    is_read_ahead = True

    def prepare(self, tick: int, since: int) -> None:
        slot = self.slot
        self.value = slot.older[0] if slot.tick == tick else slot.message


class QueueWire(Wire):
    """Messages since the previous step; older ones that the node missed are dropped."""

    __slots__ = ("values",)
    is_read_ahead = True

    def __init__(self, given: Input, slot: Slot, length: int = QUEUE_LENGTH) -> None:
        super().__init__(given, slot)
        self.queue: deque[Entry] = deque(maxlen=length)
        self.values: Sequence[Message] = ()
        slot.queues.append(self.queue)

    def lead_to(self, slot: Slot) -> None:
        self.slot.queues.remove(self.queue)
        slot.queues.append(self.queue)
        self.slot = slot

    def has_news(self, since: int, tick: int) -> bool:
        return bool(self.queue) and (not self.delayed or self.queue[0][0] < tick)

    def prepare(self, tick: int, since: int) -> None:
        queue = self.queue
        if not queue:
            self.values = ()
            return
        # The usual case, without building a list.
        if not self.delayed and len(queue) == 1:
            at, message, _ = queue.pop()
            self.values = (message,) if at > since or self.input.triggers else ()
            return
        self.values = tuple([entry[1] for entry in self._fresh(tick, since)])
        if not self.delayed:
            queue.clear()
            return
        # Messages of this tick stay for the next step.
        while queue and queue[0][0] < tick:
            queue.popleft()

    def sequences(self, tick: int, since: int) -> tuple[int, ...]:
        return tuple([entry[2] for entry in self._fresh(tick, since)])

    def _fresh(self, tick: int, since: int) -> list[Entry]:
        if self.delayed:
            return [entry for entry in self.queue if entry[0] < tick]
        # What triggers a step is never too old for it; other inputs skip what the node slept through.
        return [entry for entry in self.queue if entry[0] > since or self.input.triggers]


class _TrackWire(QueueWire):
    """Messages of a queue by index, for a node that reads the newest few of thousands; valid during a step."""

    __slots__ = ()
    is_read_ahead = False

    def __init__(self, given: Input, slot: Slot) -> None:
        super().__init__(given, slot, TRACK_LENGTH)
        self.values = _Places(self.queue)

    def sequences(self, tick: int, since: int) -> tuple[int, ...]:
        return runs([entry[2] for entry in self.queue])


class _Places(Sequence[Message]):
    """The messages of a queue."""

    __slots__ = ("_queue",)

    def __init__(self, queue: deque[Entry]) -> None:
        self._queue = queue

    def __len__(self) -> int:
        return len(self._queue)

    def __getitem__(self, place: Any) -> Any:
        return self._queue[place][1]

    def __reversed__(self) -> Iterator[Message]:
        return map(_message, reversed(self._queue))


def make_wire(given: Input, slot: Slot, is_plain: bool = False) -> Wire:
    """The wire of an input.

    Args:
        given: The input.
        slot: The slot that it reads.
        is_plain: The publisher steps later in a tick and has no latency, so the slot still holds the message of the
            previous tick.
    """
    if given.reading == "new":
        return QueueWire(given, slot)
    if given.reading == "track":
        return _TrackWire(given, slot)
    return _OlderWire(given, slot) if given.delayed and not is_plain else _PlainWire(given, slot)


def runs(numbers: Sequence[int]) -> tuple[int, ...]:
    """First and last of each run of consecutive numbers, one after the other."""
    if not numbers:
        return ()
    breaks = [place for place in range(1, len(numbers)) if numbers[place] != numbers[place - 1] + 1]
    firsts = [0, *breaks]
    lasts = [*(place - 1 for place in breaks), len(numbers) - 1]
    return tuple(numbers[place] for pair in zip(firsts, lasts, strict=True) for place in pair)
