"""Where a node's messages leave: to readers in the same process by reference, to all others over the bus."""

from __future__ import annotations

from navloom.live.mailbox import Inlet
from navloom.messages import Envelope, Message
from navloom.messages.codec import encode, schema_label
from navloom.transport.quality import Quality, quality_of
from navloom.transport.questions import TOO_MANY, Allowance
from navloom.transport.zenoh_bus import Bus, Publication, Question

__all__ = ["Dated", "Outlet"]

ANSWERED, AT_ONCE = 20e6, 100e6
"""Bytes of kept messages given to who asks for them, 1/s in the long run and at once: a map has up to some MB."""
NOTHING = "nothing was said yet"
"""Refusal where there is no last message: who asks knows that his question came through."""
LEAST = 1e5
"""Bytes that a small one counts as: 200 answers a second cost about as much as these."""
Dated = tuple[Message, Envelope]
"""A message in its envelope."""


class Outlet:
    """One port of one instance.

    Args:
        key: Of the stream.
        bus: The process's.
        lossless: Nothing may be dropped on the way: under a barrier, where each message is waited for.
        retained: Who joins later is given the last message.
        quality: How it travels; default by what a message is.

    Attributes:
        sent, largest: Bytes that were sent to other processes, and those of the largest message.
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
            bus.serve(key, self._answer, is_large=True)

    @property
    def is_heard(self) -> bool:
        """Somebody reads the stream, here or in another process."""
        publications = [publication for publication, _ in self._ways.values()]
        return bool(self.readers) or not publications or any(one.is_heard for one in publications)

    def pass_over(self) -> None:
        """Count a message that is not made, because nobody hears it."""
        self.sequence += 1

    def publish(self, message: Message, tick: int, stamp_ns: int, cause_ns: int, epoch: int) -> None:
        """Send a message to all who read it."""
        dated = self.hand_on(message, tick, stamp_ns, cause_ns, epoch)
        self.wake()
        self.send(dated)

    def hand_on(self, message: Message, tick: int, stamp_ns: int, cause_ns: int, epoch: int) -> Dated:
        """Leave a message with the readers in this process, which are not woken yet; gives it for `send`."""
        self.sequence += 1
        dated = self.last = (message, Envelope(self.key, self.sequence, tick, stamp_ns, cause_ns, epoch))
        for inlet in self.readers:
            inlet.leave(dated)
        return dated

    def wake(self) -> None:
        """Have the readers in this process look, as far as this stream wakes them."""
        for inlet in self.readers:
            if inlet.rings:
                inlet.mailbox.wake()

    def send(self, dated: Dated) -> None:
        """Send a message that was handed on to the readers in other processes, if there are any."""
        message, envelope = dated
        kind = type(message)
        publication, label = self._ways.get(kind) or self._open(kind)
        if publication.is_heard:
            data = encode(message, envelope)
            self.sent += len(data)
            self.largest = max(self.largest, len(data))
            publication.put(data, label)

    def prepare(self, kind: type[Message]) -> None:
        """Declare the stream before its first message, which would have to wait for that."""
        if kind not in self._ways:
            self._open(kind)

    @property
    def carries(self) -> str:
        """Schema and version of what it sends; empty before the first message of a stream that carries any."""
        return next((label for _, label in self._ways.values()), "")

    def _open(self, kind: type[Message]) -> tuple[Publication, str]:
        way = self._bus.publication(self.key, self._quality or quality_of(kind), self._lossless), schema_label(kind)
        self._ways[kind] = way
        return way

    def _answer(self, question: Question) -> None:
        """Give the last message, encoded once; on the network's thread."""
        last = self.last
        if last is None:
            question.refuse(NOTHING)
            return
        if self._kept[0] is not last:
            self._kept = (last, encode(*last))
        data = self._kept[1]
        if self._allowance.spend(max(LEAST, len(data))):
            question.answer(self.key, data, schema_label(type(last[0])))
        else:
            question.refuse(TOO_MANY)
