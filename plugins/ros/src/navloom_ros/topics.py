"""Publishers and subscriptions; `Node.publisher` and `Node.subscription` create them."""

from __future__ import annotations

import itertools
import threading
from collections import deque
from dataclasses import dataclass
from typing import Any

from navloom_ros.errors import BadToken, MalformedMessage
from navloom_ros.message_types import Types
from navloom_ros.names import plain_buffer_key
from navloom_ros.qos import DEFAULT
from navloom_ros.tokens import Attachment, Entity
from navloom_ros.wire import Keep, Wire, epoch_ns, monotonic_ns

__all__ = ["Publisher", "Received", "Subscription"]

WITH_BUFFERS = ("lyrical",)
"""Distributions whose publishers may send types with `uint8[]` on a second key, see `plain_buffer_key`."""


@dataclass(frozen=True)
class Received:
    """A received message and its metadata.

    Attributes:
        message: The decoded message.
        sequence: Number of the message, from 1 for each publisher.
        source_ns: When it was sent, ns since the epoch on the sender's clock.
        received_ns: When it arrived here, ns since the epoch on the clock of this host.
        gid: Identifier of the publisher, see `tokens.Entity.gid`.
        arrived_ns: When it arrived here, on the monotonic clock of this host, ns.
    """

    message: Any
    sequence: int
    source_ns: int
    received_ns: int
    gid: bytes
    arrived_ns: int


class Publisher:
    """Sends messages of one type on one topic.

    Args:
        wire, types, keep: Those of its node.
        entity, key: Its entry in the graph, and its Zenoh key.
    """

    def __init__(self, wire: Wire, types: Types, keep: Keep, entity: Entity, key: str) -> None:
        self.entity = entity
        self._types = types
        self._put, end = wire.publisher(key, entity.qos or DEFAULT)
        keep(end)
        self._sequence = itertools.count(1)
        self._lock = threading.Lock()

    def publish(self, message: Any = None, /, **values: Any) -> None:
        """Send a message, or one with these values.

        Raises:
            UnfitMessage: It does not fit the topic's type.
        """
        if message is None:
            message = self._types.new(self.entity.type_name, **values)
        data = self._types.encode_as(self.entity.type_name, message)
        with self._lock:  # so that sequence numbers arrive in order
            self._put(data, Attachment(next(self._sequence), epoch_ns(), self.entity.gid).data)


class Subscription:
    """Queues the messages of a topic until they are taken; the depth of the quality of service limits the queue.

    Args:
        wire, types, keep, entity, key: See `Publisher`.

    Attributes:
        refused: Number of messages that could not be read.
        reason: Why the last of them could not be read.
        unread: Number of them since the last message that could be read.
    """

    def __init__(self, wire: Wire, types: Types, keep: Keep, entity: Entity, key: str) -> None:
        self.entity = entity
        self.refused = self.unread = 0
        self.reason = ""
        self._types = types
        qos = entity.qos or DEFAULT
        # A full queue loses its oldest message, as KEEP_LAST demands.
        self._queue: deque[tuple[bytes, bytes, int, int]] = deque(maxlen=qos.kept)
        self._news = threading.Condition()
        self._closed = False
        # Before the subscription: ends run in reverse, so nothing arrives any more when `take` is woken.
        keep(self.close)
        keep(wire.subscribe(key, qos, self._on_sample, self._on_refusal))
        if types.distribution in WITH_BUFFERS and not qos.transient_local:
            keep(wire.subscribe(plain_buffer_key(key), qos, self._on_sample, self._on_refusal))

    def take(self, timeout: float | None = 0.0) -> Received | None:
        """Take the oldest message from the queue; None if none arrives in time, or the node closes.

        Args:
            timeout: Longest wait, s; None to wait until the node closes.
        """
        while True:
            with self._news:
                self._news.wait_for(lambda: self._queue or self._closed, timeout)
                if not self._queue:
                    return None
                data, attachment, received_ns, arrived_ns = self._queue.popleft()
            try:
                # Decoded here, not in `_on_sample`, which holds up a thread of Zenoh.
                beside = Attachment.parsed(attachment)
                message = self._types.decode(self.entity.type_name, data)
            except (BadToken, MalformedMessage) as error:
                self._on_refusal(str(error))
                continue
            self.unread = 0
            return Received(message, beside.sequence, beside.source_ns, received_ns, beside.gid, arrived_ns)

    def close(self) -> None:
        """Wake all threads that wait in `take`."""
        with self._news:
            self._closed = True
            self._news.notify_all()

    def _on_refusal(self, why: str) -> None:
        self.refused, self.unread, self.reason = self.refused + 1, self.unread + 1, why

    def _on_sample(self, data: bytes, attachment: bytes) -> None:
        with self._news:
            self._queue.append((data, attachment, epoch_ns(), monotonic_ns()))
            self._news.notify()
