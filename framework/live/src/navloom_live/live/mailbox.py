"""Message queues of a node: one bounded queue per stream, filled by any thread, emptied by the node's own thread."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from navloom.messages import Envelope, Message
from navloom.messages.codec import CodecError, decode

from navloom_live.live.description import StreamSummary
from navloom_live.timing import CLOCK_LEAD_LIMIT

__all__ = ["LATEST", "Inlet", "Mailbox", "Misrouted", "Packet", "StreamCounts"]

AGES = 256


class Misrouted(CodecError):
    """A message that arrived on another stream than its own.

    Attributes:
        origin: Key of its own stream.
    """

    def __init__(self, origin: str, key: str) -> None:
        super().__init__(f"a message of stream {origin} arrived on {key}")
        self.origin = origin


class Packet:
    """Bytes from the network, decoded once for all readers in a process, by the first reader.

    Args:
        data, label: Bytes and encoding label as received.
        key: Stream on which they arrived and which the envelope must name; None for no check.
        kind: Message class of the stream; None for any.
        asked_ns: This host's monotonic clock at the query that it answers; 0 if it was published.
        opens: Decoder; tools pass that of an `Opener`.
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
        """Message and envelope. Raises CodecError for a malformed or misrouted message."""
        opened = self._opened
        if opened is None:
            try:
                opened = self._decode()
            except CodecError as error:
                # Kept, so that each reader counts it, and it is decoded once.
                opened = error
            self._opened = opened
        if isinstance(opened, CodecError):
            raise opened
        return opened

    def _decode(self) -> tuple[Message, Envelope]:
        message, envelope = self._opens(self.data, self.label)
        # A broken link of Zenoh has delivered single messages under keys of other streams (its issue 2806).
        if self._key is not None and envelope.key != self._key:
            raise Misrouted(envelope.key, self._key)
        # A node must not get a message of another class, whatever a foreign process sends.
        if self._kind is not None and not isinstance(message, self._kind):
            raise CodecError(f"{type(message).__name__} arrived on {self._key}, which carries {self._kind.__name__}")
        return message, envelope

    def try_open(self) -> tuple[Message, Envelope] | None:
        """Message and envelope; None for a malformed or misrouted message."""
        try:
            return self.open()
        except CodecError:
            return None


@dataclass
class StreamCounts:
    """Counts of a stream's messages at one reader.

    Attributes:
        received: All messages.
        dropped: Messages replaced by newer ones before they were read.
        malformed: Invalid messages; `complaint` says what was wrong with the last one.
        misrouted: Valid messages of other streams; `origin` is the stream of the last one.
        late: Messages skipped because a newer one came before.
        ages: Ages of messages, s, newest last.
    """

    received: int = 0
    dropped: int = 0
    malformed: int = 0
    misrouted: int = 0
    late: int = 0
    complaint: str = ""
    origin: str = ""
    ages: deque[float] = field(default_factory=lambda: deque(maxlen=AGES))

    def summary(self, latest: bool) -> StreamSummary:
        """The counts, and median and 99th percentile of the ages; `latest`: only the newest message counts."""
        ages = sorted(self.ages)
        return StreamSummary(
            received=self.received,
            dropped=self.dropped,
            malformed=self.malformed,
            misrouted=self.misrouted,
            late=self.late,
            complaint=self.complaint or None,
            origin=self.origin or None,
            age_p50_s=ages[len(ages) // 2] if ages else None,
            age_p99_s=ages[min(len(ages) - 1, len(ages) * 99 // 100)] if ages else None,
            latest=latest,
        )


LATEST = 4
"""Longest queue of which only the newest message counts: a few, so that a second publisher is noticed."""


class Mailbox:
    """Wakes one node's thread when a message arrives. Any thread may ring; one thread waits.

    The bell is a lock that is held while there is nothing to do, and released to ring. This costs a fifth of a
    condition variable, and every message between two processes passes here.

    Attributes:
        lock: Held while a message is added.
        news: Number of messages that woke or will wake the thread.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.news = 0
        self._bell = threading.Lock()
        # Held from the beginning: there is nothing to do yet.
        self._bell.acquire()

    def ring(self) -> None:
        """Wake the thread for something other than a queued message."""
        with self.lock:
            self.news += 1
        self.wake()

    def wake(self) -> None:
        """Wake the waiting thread. Call it after `news` has been incremented and the lock released."""
        if self._bell.locked():
            try:  # noqa: SIM105  a context manager would cost as much as all the rest
                self._bell.release()
            except RuntimeError:  # another thread has just released it
                pass

    def wait(self, seen: int, timeout: float | None) -> int:
        """Wait until `news` differs from `seen` or `timeout`, s, has passed, and return `news`.

        The wait may end early: a message counted by the previous call may have rung after it.
        """
        if self.news != seen:
            self._bell.acquire(blocking=False)  # silence the bell before reading `news`, so that no message is lost
        else:
            self._bell.acquire(timeout=-1 if timeout is None else timeout)
        return self.news


class Inlet:
    """One stream into one node.

    Args:
        key: Key of the stream.
        mailbox: Mailbox of the node.
        limit: Most waiting messages; beyond it the oldest is dropped. None for no limit.
        age: Age of a Platform stamp, s; None if it is not known.
        tells_time: A stream of the platform: it defines the clock, so its stamps are not checked against it.
        rings: A message that arrives wakes the node.

    Attributes:
        counts: Counts of its messages.
        arrived_ns: This host's monotonic clock at the arrival of the last message taken.
        heard_ns: The same of the last message that arrived, answers to queries excluded; 0 before the first.
        rings: The reader may change it. Messages that do not ring wait until the node wakes for another reason.
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
        """Add a message, from any thread, and wake the node if the inlet rings. Never blocks, never raises."""
        self.leave(item)
        if self.rings:
            self.mailbox.wake()

    def leave(self, item: Packet | tuple[Message, Envelope]) -> None:
        """Add a message without waking the node.

        The answer to a query travels separately from the stream: it is dropped if the stream has brought a message
        since the query, which is newer.
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
            # The deque drops the oldest by itself; it is only counted here.
            if len(waiting) == waiting.maxlen:
                self.counts.dropped += 1
            waiting.append(item)
            mailbox.news += self.rings

    def listen(self) -> None:
        """Let the next message wake the node, and wake it now if one is waiting."""
        self.rings = True
        # It may have come before the change: its wake-up would be missing.
        if self._waiting:
            self.mailbox.ring()

    def clear(self) -> None:
        """Discard waiting messages. For the node's thread only."""
        self._waiting.clear()

    @property
    def has_news(self) -> bool:
        """Whether a message is waiting."""
        return bool(self._waiting)

    @property
    def keeps_latest(self) -> bool:
        """Whether only the newest message is kept; then a message replaced unread is no loss."""
        return self._waiting.maxlen is not None and self._waiting.maxlen <= LATEST

    def refuse(self, complaint: str) -> None:
        """Count a message that could not be received."""
        self.counts.received += 1
        self.counts.malformed += 1
        self.counts.complaint = complaint

    def packets(self) -> Iterator[Packet]:
        """Waiting messages as received from the network, oldest first. For one reader's thread only."""
        while self._waiting:
            item = self._waiting.popleft()
            if isinstance(item, Packet):
                yield item

    def take(self) -> Iterator[tuple[Message, Envelope]]:
        """Waiting messages, oldest first; malformed ones are counted and skipped. For the node's thread only."""
        waiting = self._waiting
        # Not `for`: other threads add messages meanwhile.
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
                if age is not None and age < -CLOCK_LEAD_LIMIT and not self._tells_time:
                    # If kept, it would count as the newest message until the clock catches up with it.
                    self.counts.malformed += 1
                    self.counts.complaint = f"it derives from a platform stamp {-age:.1f} s in the future"
                    continue
                if age is not None:
                    self.counts.ages.append(age)
            yield item
