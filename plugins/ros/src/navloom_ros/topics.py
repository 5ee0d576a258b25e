"""Publishers and subscriptions of a node's topics."""

from __future__ import annotations

import itertools
import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

from navloom_ros.errors import BadToken, MalformedMessage
from navloom_ros.message_types import Types
from navloom_ros.names import plain_buffer_key
from navloom_ros.qos import DEFAULT
from navloom_ros.tokens import Attachment, Entity
from navloom_ros.wire import Keep, Wire, now_ns

__all__ = ["Publisher", "Received", "Subscription"]

WITH_BUFFERS = ("lyrical",)
"""Distributions whose publishers may send types with `uint8[]` to another key, see `plain_buffer_key`."""


@dataclass(frozen=True)
class Received:
    """A message and what came beside it.

    Attributes:
        message: Decoded.
        sequence: Its number among those of its publisher, from 1.
        source_ns: When it was sent, ns since the epoch on the sender's clock.
        received_ns: When it arrived here, ns since the epoch on the clock of this host.
        gid: Of the publisher.
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
        wire, types, keep: Of its node.
        entity, key: Its own.
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
        with self._lock:  # numbers arrive in their order
            self._put(data, Attachment(next(self._sequence), now_ns(), self.entity.gid).data)


class Subscription:
    """Keeps the last messages of a topic, as many as its quality of service says, until they are taken.

    Args:
        wire, types, keep, entity, key: See `Publisher`.

    Attributes:
        refused: Messages that could not be read, since the beginning; `reason` says why the last one was.
    """

    def __init__(self, wire: Wire, types: Types, keep: Keep, entity: Entity, key: str) -> None:
        self.entity = entity
        self.refused = 0
        self.reason = ""
        self._types = types
        qos = entity.qos or DEFAULT
        self._queue: deque[tuple[bytes, bytes, int, int]] = deque(maxlen=qos.kept)
        self._news = threading.Condition()
        self._closed = False
        keep(self.close)
        keep(wire.subscribe(key, qos, self._on_sample))
        if types.distribution in WITH_BUFFERS and not qos.transient_local:
            keep(wire.subscribe(plain_buffer_key(key), qos, self._on_sample))

    def take(self, timeout: float | None = 0.0) -> Received | None:
        """The oldest message that has not been taken; None where none comes in time, or the node is closed.

        Args:
            timeout: s to wait; None waits as long as the node is open.
        """
        while True:
            with self._news:
                self._news.wait_for(lambda: self._queue or self._closed, timeout)
                if not self._queue:
                    return None
                data, attachment, received_ns, arrived_ns = self._queue.popleft()
            try:
                beside = Attachment.parsed(attachment)
                message = self._types.decode(self.entity.type_name, data)
            except (BadToken, MalformedMessage) as error:
                self.refused += 1
                self.reason = str(error)
                continue
            return Received(message, beside.sequence, beside.source_ns, received_ns, beside.gid, arrived_ns)

    def close(self) -> None:
        """Let whoever waits go on."""
        with self._news:
            self._closed = True
            self._news.notify_all()

    def _on_sample(self, data: bytes, attachment: bytes) -> None:
        with self._news:
            self._queue.append((data, attachment, now_ns(), time.monotonic_ns()))
            self._news.notify()
