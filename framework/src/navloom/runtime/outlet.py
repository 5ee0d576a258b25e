"""Where a node's messages leave: to readers in the same process by reference, to all others over the bus."""

from __future__ import annotations

from navloom.messages import Envelope, Message
from navloom.messages.codec import encode, schema_label
from navloom.runtime.mailbox import Inlet
from navloom.runtime.quality import Quality, quality_of
from navloom.runtime.questions import TOO_MANY, Allowance
from navloom.runtime.zenoh_bus import Bus, Publication, Question

__all__ = ["Outlet"]

ANSWERED, AT_ONCE = 20e6, 100e6
"""Bytes of kept messages given to who asks for them, 1/s in the long run and at once: a map has up to some MB."""
NOTHING = "nothing was said yet"
"""Refusal where there is no last message: who asks knows that his question came through."""
LEAST = 1e5
"""Bytes that a small one counts as: 200 answers a second cost about as much as these."""


class Outlet:
    """One port of one instance.

    Args:
        key: Of the stream.
        bus: The process's.
        lossless: Nothing may be dropped on the way: under a barrier, where each message is waited for.
        retained: Who joins later is given the last message.
        quality: How it travels; default by what a message is.
    """

    def __init__(self, key: str, bus: Bus, lossless: bool, retained: bool, quality: Quality | None = None) -> None:
        self.key = key
        self.readers: list[Inlet] = []
        self.sequence = 0
        self.last: tuple[Message, Envelope] | None = None
        self._bus, self._lossless, self._quality = bus, lossless, quality
        self._ways: dict[type[Message], tuple[Publication, str]] = {}
        self._kept: tuple[tuple[Message, Envelope] | None, bytes] = (None, b"")
        self._allowance = Allowance(ANSWERED, AT_ONCE)
        if retained:
            bus.serve(key, self._answer)

    def publish(self, message: Message, tick: int, stamp_ns: int, cause_ns: int, epoch: int) -> None:
        """Send a message to all who read it."""
        self.sequence += 1
        envelope = Envelope(self.key, self.sequence, tick, stamp_ns, cause_ns, epoch)
        self.last = (message, envelope)
        for inlet in self.readers:
            inlet.give(self.last)
        kind = type(message)
        way = self._ways.get(kind) or self._open(kind)
        way[0].put(encode(message, envelope), way[1])

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
