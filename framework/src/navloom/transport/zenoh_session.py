"""The only module that speaks Zenoh: one session, and what is declared in it."""

from __future__ import annotations

import contextlib
import os
import queue
import time
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import zenoh

__all__ = ["TIMED_OUT", "Answer", "Publisher", "Question", "Receive", "Replies", "Session", "SessionError"]

RUNTIME = "(tx: (worker_threads: 3), rx: (worker_threads: 4))"
"""Zenoh's threads, which all sessions of a process share. By default one thread sends: closing a link whose other end
takes nothing can block it for over 1 s, and with it the links of the process to all others."""
os.environ.setdefault("ZENOH_RUNTIME", RUNTIME)  # Zenoh reads it when it is first used
MEDIA = "application/x-navloom;"
TIMED_OUT = "Timeout"
"""What Zenoh says in the place of an answer that does not come."""
OVERDUE = 0.5
"""s after the time of a question at which it ends, whatever Zenoh says of it."""
SessionError = zenoh.ZError
"""A session could not be opened, or is gone."""
_CONGESTION = {
    "drop": zenoh.CongestionControl.DROP,
    "block": zenoh.CongestionControl.BLOCK,
    "block_first": zenoh.CongestionControl.BLOCK_FIRST,
}
_PRIORITY = {
    "real_time": zenoh.Priority.REAL_TIME,
    "interactive_high": zenoh.Priority.INTERACTIVE_HIGH,
    "interactive_low": zenoh.Priority.INTERACTIVE_LOW,
    "data_high": zenoh.Priority.DATA_HIGH,
    "data": zenoh.Priority.DATA,
    "data_low": zenoh.Priority.DATA_LOW,
    "background": zenoh.Priority.BACKGROUND,
}

Receive = Callable[[str, bytes | None, str], None]
"""Takes key, bytes (None where there were too many) and schema label, on the network's thread: it must not wait."""


@lru_cache(256)
def _encoding(label: str) -> zenoh.Encoding:
    """What tells a schema on the wire, made once and not with each message."""
    return zenoh.Encoding(MEDIA + label)


class Answer(NamedTuple):
    """One answer to a question: its key, bytes and schema label; `refusal` in words where there is none."""

    key: str
    data: bytes
    label: str
    refusal: str


class Question:
    """A question that waits for its answer.

    Attributes:
        size: Bytes that it brings; look at it before `data`, which copies them.
    """

    def __init__(self, query: Any) -> None:
        self._query = query
        self._payload = query.payload
        self.size = 0 if self._payload is None else len(self._payload)

    @property
    def key(self) -> str:
        """What is asked for, perhaps with wildcards."""
        return str(self._query.key_expr)

    @property
    def data(self) -> bytes:
        """What the question says."""
        return b"" if self._payload is None else bytes(self._payload.to_bytes())

    def answer(self, key: str, data: bytes, label: str = "") -> None:
        """Answer once; a question that nobody waits for any more is let go."""
        with contextlib.suppress(zenoh.ZError):
            self._query.reply(key, data, encoding=_encoding(label))
        self._query.drop()

    def refuse(self, reason: str) -> None:
        """Say why there is no answer."""
        with contextlib.suppress(zenoh.ZError):
            self._query.reply_err(reason.encode())
        self._query.drop()

    def drop(self) -> None:
        """Leave it to others."""
        self._query.drop()


class Publisher:
    """A stream that is declared in one session."""

    def __init__(self, publisher: Any) -> None:
        self._publisher = publisher

    def put(self, data: bytes, label: str) -> None:
        """Send a message. A link that is gone loses it, as the stream's quality allows."""
        with contextlib.suppress(zenoh.ZError):
            self._publisher.put(data, encoding=_encoding(label))

    @property
    def is_heard(self) -> bool:
        """Somebody has subscribed to it."""
        try:
            return bool(self._publisher.matching_status.matching)
        except zenoh.ZError:
            return False


class Replies:
    """Replies to a question as they come, until Zenoh says that there are no more, or the time is over for sure."""

    def __init__(self, timeout: float) -> None:
        self._limit = time.monotonic() + timeout + OVERDUE
        self._came: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.handler = zenoh.handlers.Callback(self._came.put, self.end, indirect=False)

    def end(self) -> None:
        """There are no more."""
        self._came.put(None)

    def __iter__(self) -> Iterator[Answer]:
        with contextlib.suppress(queue.Empty):
            while (reply := self._came.get(timeout=max(0.0, self._limit - time.monotonic()))) is not None:
                if reply.ok is not None:
                    sample = reply.ok
                    label = str(sample.encoding).removeprefix(MEDIA)
                    yield Answer(str(sample.key_expr), sample.payload.to_bytes(), label, "")
                elif reply.err is not None:
                    yield Answer("", b"", "", reply.err.payload.to_string())


class Session:
    """One session on a network, with all that is declared in it until it is closed.

    Args:
        config: Zenoh's, as JSON.

    Raises:
        SessionError: It cannot be opened.
    """

    def __init__(self, config: str) -> None:
        self._session = zenoh.open(zenoh.Config.from_json5(config))
        self._held: list[Any] = []

    def close(self) -> None:
        """Leave the network."""
        self._held.clear()
        with contextlib.suppress(zenoh.ZError):
            self._session.close()  # type: ignore[no-untyped-call]

    def neighbours(self) -> int:
        """Processes this one is linked to."""
        try:
            info = self._session.info
            return len(list(info.peers_zid())) + len(list(info.routers_zid()))
        except zenoh.ZError:
            return 0

    def clients(self) -> int:
        """Clients that are linked to this router."""
        try:
            return sum(transport.whatami == zenoh.WhatAmI.CLIENT for transport in self._session.info.transports())
        except zenoh.ZError:
            return 0

    def tell(self, key: str) -> None:
        """Send an empty message, once, that must arrive."""
        with contextlib.suppress(zenoh.ZError):
            self._session.put(key, b"", congestion_control=zenoh.CongestionControl.BLOCK)

    def publisher(self, key: str, congestion: str, priority: str) -> Publisher:
        """Declare a stream to publish to. Readers within the process are served by reference, not by this."""
        return Publisher(
            self._session.declare_publisher(
                key,
                congestion_control=_CONGESTION[congestion],
                priority=_PRIORITY[priority],
                allowed_destination=zenoh.Locality.REMOTE,
            )
        )

    def subscribe(self, key_expr: str, receive: Receive, most: int) -> None:
        """Hear a stream, or several with `*`; a message of more bytes than `most` is not copied."""
        single = "" if "*" in key_expr else key_expr

        def take(sample: Any) -> None:
            payload = sample.payload
            data = None if len(payload) > most else payload.to_bytes()
            with contextlib.suppress(Exception):  # the callback of a whole session: nothing may escape into it
                receive(single or str(sample.key_expr), data, str(sample.encoding).removeprefix(MEDIA))

        self._held.append(self._session.declare_subscriber(key_expr, zenoh.handlers.Callback(take, indirect=False)))

    def announce(self, key: str) -> None:
        """Show others that something is alive."""
        self._held.append(self._session.liveliness().declare_token(key))

    def watch(self, key_expr: str, change: Callable[[str, bool], None]) -> None:
        """Be told who is alive, who comes and who goes."""

        def take(sample: Any) -> None:
            with contextlib.suppress(Exception):
                change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        handler = zenoh.handlers.Callback(take, indirect=False)
        self._held.append(self._session.liveliness().declare_subscriber(key_expr, handler, history=True))

    def serve(self, key: str, take: Callable[[Question], None]) -> None:
        """Answer questions; `take` is called on the network's thread and must only pass them on."""

        def pass_on(query: Any) -> None:
            with contextlib.suppress(Exception):
                take(Question(query))

        handler = zenoh.handlers.Callback(pass_on, indirect=False)
        self._held.append(self._session.declare_queryable(key, handler, complete=True))

    def alive(self, key_expr: str, timeout: float) -> Replies:
        """Tokens that this session is shown, as answers."""
        replies = Replies(timeout)
        try:
            self._session.liveliness().get(key_expr, replies.handler, timeout=timeout)
        except zenoh.ZError:
            replies.end()
        return replies

    def ask(self, key_expr: str, data: bytes, timeout: float) -> Replies:
        """Answers of all who serve a key, for at most this many s."""
        replies = Replies(timeout)
        try:
            self._session.get(
                key_expr,
                replies.handler,
                payload=data,
                timeout=timeout,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                congestion_control=zenoh.CongestionControl.BLOCK,
                priority=zenoh.Priority.INTERACTIVE_HIGH,
            )
        except zenoh.ZError:  # between two sessions nobody answers
            replies.end()
        return replies
