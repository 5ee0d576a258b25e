"""A node's output: to readers in the same process by reference, to all others over the bus."""

from __future__ import annotations

from navloom.messages import Envelope, Message
from navloom.messages.codec import encode, schema_label

from navloom_live.live.mailbox import Inlet
from navloom_live.transport.quality_of_service import Quality, quality_of
from navloom_live.transport.query_limits import TOO_MANY, Allowance
from navloom_live.transport.zenoh_bus import Bus, Publication, Question

__all__ = ["Dated", "Outlet"]

ANSWERED, AT_ONCE = 20e6, 100e6
"""Limits on answers to queries for the last message: bytes/s in the long run, and bytes at once. A map has some MB."""
NOTHING = "nothing was said yet"
"""Refusal if there is no last message yet; it shows that the query arrived."""
LEAST = 1e5
"""Smallest cost of an answer, bytes: 200 small answers a second cost about as much as ANSWERED bytes."""
Dated = tuple[Message, Envelope]
"""A message in its envelope."""


class Outlet:
    """One port of one instance.

    Args:
        key: Key of the stream.
        bus: The process's bus.
        lossless: No message may be dropped: under a barrier every message is waited for.
        retained: Late joiners can query the last message.
        quality: Quality of service; default: by message class.

        Attributes:
            sent, largest: Bytes sent to other processes, and size of the largest message.
    """

    def __init__(self, key: str, bus: Bus, lossless: bool, retained: bool, quality: Quality | None = None) -> None:
        self.key = key
        self.readers: list[Inlet] = []
        self.sequence = 0
        self.last: Dated | None = None
        self.sent = self.largest = 0
        self._bus, self._lossless, self._quality = bus, lossless, quality
        self._ways: dict[type[Message], tuple[Publication, str]] = {}
        self._kept: tuple[Dated | None, bytes] = (None, b"")
        self._allowance = Allowance(ANSWERED, AT_ONCE)
        if retained:
            # On the stream's own key, since Zenoh's advanced publisher needs wall-clock timestamps and drops messages
            # of a host whose clock is ahead.
            bus.serve(key, self._answer, is_large=True)

    @property
    def is_heard(self) -> bool:
        """Whether the stream has a reader, here or in another process."""
        publications = [publication for publication, _ in self._ways.values()]
        # Before the first message it is not known: better one report too many.
        return bool(self.readers) or not publications or any(one.is_heard for one in publications)

    def pass_over(self) -> None:
        """Count a message that is not made because no one reads it."""
        self.sequence += 1

    def publish(self, message: Message, tick: int, stamp_ns: int, cause_ns: int, epoch: int) -> None:
        """Send a message to all readers."""
        dated = self.hand_on(message, tick, stamp_ns, cause_ns, epoch)
        self.wake()
        self.send(dated)

    def hand_on(self, message: Message, tick: int, stamp_ns: int, cause_ns: int, epoch: int) -> Dated:
        """Queue a message for the readers in this process without waking them, and return it for `send`."""
        self.sequence += 1
        dated = self.last = (message, Envelope(self.key, self.sequence, tick, stamp_ns, cause_ns, epoch))
        # Queued for all before anybody is woken: a reader may need messages of several ports.
        for inlet in self.readers:
            inlet.leave(dated)
        return dated

    def wake(self) -> None:
        """Wake the readers in this process that this stream may wake."""
        for inlet in self.readers:
            if inlet.rings:
                inlet.mailbox.wake()

    def send(self, dated: Dated) -> None:
        """Send a message that was handed on to readers in other processes, if there are any."""
        message, envelope = dated
        kind = type(message)
        publication, label = self._ways.get(kind) or self._open(kind)
        # A message without a reader in another process is not encoded.
        if publication.is_heard:
            data = encode(message, envelope)
            self.sent += len(data)
            self.largest = max(self.largest, len(data))
            publication.put(data, label)

    def prepare(self, kind: type[Message]) -> None:
        """Declare the stream in advance, so that its first message does not wait for the declaration."""
        if kind not in self._ways:
            self._open(kind)

    @property
    def carries(self) -> str:
        """Schema and version of its messages; empty before the first message if the class is not known in advance."""
        return next((label for _, label in self._ways.values()), "")

    def _open(self, kind: type[Message]) -> tuple[Publication, str]:
        way = self._bus.publication(self.key, self._quality or quality_of(kind), self._lossless), schema_label(kind)
        self._ways[kind] = way
        return way

    def _answer(self, question: Question) -> None:
        """Answer a query with the last message, encoded once. Called on the network's thread."""
        last = self.last
        if last is None:
            question.refuse(NOTHING)
            return
        # Several late joiners ask for the same map.
        if self._kept[0] is not last:
            self._kept = (last, encode(*last))
        data = self._kept[1]
        # Answers run on the network's threads: without a limit, a tool in a loop could hold up a robot.
        if self._allowance.spend(max(LEAST, len(data))):
            question.answer(self.key, data, schema_label(type(last[0])))
        else:
            question.refuse(TOO_MANY)
