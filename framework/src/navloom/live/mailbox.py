"""Where messages wait for a node: one bounded queue a stream, filled by anyone, emptied by the node's own thread."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from navloom.messages import Envelope, Message
from navloom.messages.codec import CodecError, decode

__all__ = ["Inlet", "Mailbox", "Misrouted", "Packet", "StreamCounts"]

AGES = 256


class Misrouted(CodecError):
    """A message that the network delivered to another stream than its own.

    Attributes:
        origin: Key of its own stream.
    """

    def __init__(self, origin: str, key: str) -> None:
        super().__init__(f"a message of stream {origin} came by {key}")
        self.origin = origin


class Packet:
    """Bytes off the wire, decoded once for all its readers in a process, by the first that looks.

    Args:
        data, label: As they came.
        key: Stream they came by, which their envelope must name; None where that does not matter.
        kind: What the stream carries; None for any message.
        asked_ns: This host's monotonic clock when it was asked for; 0 where it came by itself.
        opens: How it is decoded, as by an `Opener` for tools.
    """

    __slots__ = ("_key", "_kind", "_opened", "_opens", "arrived_ns", "asked_ns", "data", "label")

    def __init__(
        self,
        data: bytes,
        label: str,
        key: str | None = None,
        kind: type[Message] | None = None,
        asked_ns: int = 0,
        opens: Callable[[bytes, str], tuple[Message, Envelope]] = decode,
    ) -> None:
        self.data = data
        self.label = label
        self._key, self._kind, self._opens = key, kind, opens
        self.arrived_ns = time.monotonic_ns()
        self.asked_ns = asked_ns
        self._opened: tuple[Message, Envelope] | CodecError | None = None

    def open(self) -> tuple[Message, Envelope]:
        """Message and envelope. Raises CodecError for what is neither."""
        opened = self._opened
        if opened is None:
            try:
                opened = self._decode()
            except CodecError as error:
                opened = error
            self._opened = opened
        if isinstance(opened, CodecError):
            raise opened
        return opened

    def _decode(self) -> tuple[Message, Envelope]:
        message, envelope = self._opens(self.data, self.label)
        if self._key is not None and envelope.key != self._key:
            raise Misrouted(envelope.key, self._key)
        if self._kind is not None and not isinstance(message, self._kind):
            raise CodecError(f"{type(message).__name__} came by {self._key}, which carries {self._kind.__name__}")
        return message, envelope

    def try_open(self) -> tuple[Message, Envelope] | None:
        """The same; None for what is no message."""
        try:
            return self.open()
        except CodecError:
            return None


@dataclass
class StreamCounts:
    """What became of a stream's messages on their way into one node.

    Attributes:
        received: All that came.
        dropped: Pushed out unread by newer ones.
        malformed: No messages of this stream, and `complaint` why the last one was none.
        misrouted: Sound messages of other streams, and `origin` the stream of the last one.
        late: Passed over for what had come before.
        ages: s, newest last.
    """

    received: int = 0
    dropped: int = 0
    malformed: int = 0
    misrouted: int = 0
    late: int = 0
    complaint: str = ""
    origin: str = ""
    ages: deque[float] = field(default_factory=lambda: deque(maxlen=AGES))

    def summary(self) -> dict[str, Any]:
        """Counts, and median and 99th percentile of the ages, s."""
        ages = sorted(self.ages)
        found: dict[str, Any] = {
            "received": self.received,
            "dropped": self.dropped,
            "malformed": self.malformed,
            "misrouted": self.misrouted,
            "late": self.late,
        }
        if self.complaint:
            found["complaint"] = self.complaint
        if self.origin:
            found["origin"] = self.origin
        if ages:
            found["age_p50_s"] = ages[len(ages) // 2]
            found["age_p99_s"] = ages[min(len(ages) - 1, len(ages) * 99 // 100)]
        return found


class Mailbox:
    """Wakes one node's thread when something comes in. Anyone may ring; one thread waits.

    The bell is a lock that is held while there is nothing to wake for: to ring is to release it. That is a fifth of
    what a condition costs, on a way that every message between two processes takes.

    Attributes:
        lock: Held while something is put in.
        news: Rises with everything that comes in and is to wake the thread.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.news = 0
        self._bell = threading.Lock()
        self._bell.acquire()

    def ring(self) -> None:
        """Something came in that is not in a queue."""
        with self.lock:
            self.news += 1
        self.wake()

    def wake(self) -> None:
        """Have the waiting thread look; after `news` has risen, with the lock free again."""
        if self._bell.locked():
            try:  # noqa: SIM105  a context manager would cost as much as all the rest
                self._bell.release()
            except RuntimeError:  # another has just done it
                pass

    def wait(self, seen: int, timeout: float | None) -> int:
        """Wait until more than `seen` things have come in, or s have passed; gives how many have.

        It may end without either: what came in before the last call may have rung after it.
        """
        if self.news != seen:
            self._bell.acquire(blocking=False)  # first silence it, then look: what rings from now on is news or rings
        else:
            self._bell.acquire(timeout=-1 if timeout is None else timeout)
        return self.news


AHEAD = 0.5
"""s that a message may be ahead of the platform's clock as known here: less is its way to this host."""


class Inlet:
    """One stream into one node.

    Args:
        key: Of the stream.
        mailbox: Of the node.
        limit: Messages that may wait; the oldest is dropped beyond. None for no limit.
        age: Age in s of something with this Platform stamp, where it is known.
        tells_time: The platform's own: what that clock is known by is not held against it.
        rings: A message that comes in wakes the node.

    Attributes:
        counts: What became of its messages.
        arrived_ns: This host's monotonic clock at the last one taken out.
        heard_ns: The same at the last one that came in, answers to questions left out; 0 before the first.
        rings: The reader may change it. Messages that do not ring wait until it looks for another reason.
    """

    def __init__(
        self,
        key: str,
        mailbox: Mailbox,
        limit: int | None,
        age: Callable[[int], float | None] | None = None,
        tells_time: bool = False,
        rings: bool = True,
    ) -> None:
        self.key = key
        self._tells_time = tells_time
        self.mailbox = mailbox
        self.rings = rings
        self.counts = StreamCounts()
        self.arrived_ns = self.heard_ns = 0
        self._age = age
        self._waiting: deque[Packet | tuple[Message, Envelope]] = deque(maxlen=limit)

    def give(self, item: Packet | tuple[Message, Envelope]) -> None:
        """Leave a message, from any thread, and wake the node if that is to ring. Never blocks, never raises."""
        self.leave(item)
        if self.rings:
            self.mailbox.wake()

    def leave(self, item: Packet | tuple[Message, Envelope]) -> None:
        """Leave a message and wake nobody yet.

        An answer comes by another way than the stream itself: what the stream has brought since the question is newer.
        """
        waiting, mailbox = self._waiting, self.mailbox
        with mailbox.lock:
            self.counts.received += 1
            if not isinstance(item, Packet):
                self.heard_ns = time.monotonic_ns()
            elif self.heard_ns > item.asked_ns > 0:
                self.counts.late += 1
                return
            elif not item.asked_ns:
                self.heard_ns = item.arrived_ns
            if len(waiting) == waiting.maxlen:
                self.counts.dropped += 1
            waiting.append(item)
            mailbox.news += self.rings

    def listen(self) -> None:
        """Have the next message wake the node, and one that waits by now as well."""
        self.rings = True
        if self._waiting:
            self.mailbox.ring()

    def clear(self) -> None:
        """Forget what waits. For the node's thread only."""
        self._waiting.clear()

    @property
    def has_news(self) -> bool:
        """Something waits."""
        return bool(self._waiting)

    @property
    def keeps_latest(self) -> bool:
        """Only the newest message waits: what it replaces unread is no loss."""
        return self._waiting.maxlen == 1

    def refuse(self, complaint: str) -> None:
        """Count a message that never became one."""
        self.counts.received += 1
        self.counts.malformed += 1
        self.counts.complaint = complaint

    def packets(self) -> Iterator[Packet]:
        """What waits, as it came off the wire, oldest first. For one reader's thread only."""
        while self._waiting:
            item = self._waiting.popleft()
            if isinstance(item, Packet):
                yield item

    def take(self) -> Iterator[tuple[Message, Envelope]]:
        """What waits, oldest first; what is malformed is counted and passed over. For the node's thread only."""
        waiting = self._waiting
        while waiting:
            item = waiting.popleft()
            if isinstance(item, Packet):
                self.arrived_ns = item.arrived_ns
                try:
                    item = item.open()
                except Misrouted as error:
                    self.counts.misrouted += 1
                    self.counts.origin = error.origin
                    continue
                except CodecError as error:
                    self.counts.malformed += 1
                    self.counts.complaint = str(error)
                    continue
            else:
                self.arrived_ns = time.monotonic_ns()
            if self._age is not None:
                age = self._age(item[1].cause_ns)
                if age is not None and age < -AHEAD and not self._tells_time:
                    # Kept, it would be the newest for as long as it is ahead, and in force when its time has come.
                    self.counts.malformed += 1
                    self.counts.complaint = f"it derives from what the platform will say in {-age:.1f} s"
                    continue
                if age is not None:
                    self.counts.ages.append(age)
            yield item
