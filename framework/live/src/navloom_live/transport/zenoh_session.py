"""The only module that imports Zenoh: one session and its declarations."""

from __future__ import annotations

import contextlib
import os
import queue
import time
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any, NamedTuple
from weakref import ref

import zenoh

__all__ = ["TIMED_OUT", "Answer", "Publisher", "Question", "Receive", "Replies", "Session", "SessionError"]

RUNTIME = "(tx: (worker_threads: 3), rx: (worker_threads: 4), acc: (handover: rx), net: (handover: rx))"
"""Zenoh's threads, shared by all sessions of a process. By default one thread sends: closing a link whose other end
reads nothing can block it for over 1 s, and with it all other links of the process. By default, each message also wakes
two threads on arrival: one that watches the socket, in the runtime that opened or accepted the link, and one that
receives. `handover` makes the receiving threads do both, so a node that holds the GIL also delays new links."""
os.environ.setdefault("ZENOH_RUNTIME", RUNTIME)  # Zenoh reads it when it is first used
MEDIA = "application/x-navloom;"
TIMED_OUT = "Timeout"
"""Zenoh's reply when an answer does not come in time; `Replies` yields it at most once."""
QUERY_END_MARGIN = 0.5
"""How long after its timeout a query ends in any case, s, even without word from Zenoh."""
SessionError = zenoh.ZError
"""A session could not be opened, or is closed."""
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
"""Callback with key, bytes (None for too many) and schema label, on the network's thread: it must not block."""


@lru_cache(256)
def _encoding(label: str) -> zenoh.Encoding:
    """The encoding that carries a schema label, cached instead of made for each message."""
    return zenoh.Encoding(MEDIA + label)


class Answer(NamedTuple):
    """One answer to a query: key, bytes and schema label; or `refusal`, as text."""

    key: str
    data: bytes
    label: str
    refusal: str


class Question:
    """A query that waits for its answer.

    Attributes:
        size: Size of its data, bytes; check it before reading `data`, which copies them.
    """

    def __init__(self, query: Any) -> None:
        self._query = query
        self._payload = query.payload
        self.size = 0 if self._payload is None else len(self._payload)

    @property
    def key(self) -> str:
        """The queried key, which may have wildcards."""
        return str(self._query.key_expr)

    @property
    def data(self) -> bytes:
        """The data of the query."""
        return b"" if self._payload is None else bytes(self._payload.to_bytes())

    def answer(self, key: str, data: bytes, label: str = "") -> None:
        """Answer once; ignored if no one waits for the answer any more."""
        with contextlib.suppress(zenoh.ZError):
            self._query.reply(key, data, encoding=_encoding(label))
        self._query.drop()

    def refuse(self, reason: str) -> None:
        """Answer with a refusal."""
        with contextlib.suppress(zenoh.ZError):
            self._query.reply_err(reason.encode())
        self._query.drop()

    def drop(self) -> None:
        """Leave the query to others, without an answer."""
        self._query.drop()


class Publisher:
    """A stream declared in one session.

    Args:
        publisher: Zenoh's publisher.
        arrivals: Number of tokens and queries that the session has received, see `Session`.
    """

    def __init__(self, publisher: Any, arrivals: Callable[[], int]) -> None:
        self._publisher, self._arrivals = publisher, arrivals
        self._is_heard, self._asked = False, -1
        this = ref(self)  # Zenoh holds the callback, and Python's garbage collector cannot see a cycle through Zenoh

        def note(status: Any) -> None:
            if (held := this()) is not None:
                held._is_heard = bool(status.matching)

        # `indirect=False`: on Zenoh's own thread, without a Python thread and a queue for each declaration.
        self._listener = publisher.declare_matching_listener(zenoh.handlers.Callback(note, indirect=False))

    @property
    def is_heard(self) -> bool:
        """Whether it has a subscriber.

        The listener reports a change a few ms late, and asking Zenoh costs more than encoding a small message. So Zenoh
        is asked only after a token or a query has arrived: its sender may have subscribed just before, and expects the
        next message.
        """
        if self._is_heard:
            return True
        arrivals = self._arrivals()
        if arrivals != self._asked:
            with contextlib.suppress(zenoh.ZError):
                if self._publisher.matching_status.matching:
                    return True  # only the listener sets `_is_heard`, so that no late answer replaces its report
            self._asked = arrivals  # only now: another thread may ask meanwhile
        return self._is_heard

    def put(self, data: bytes, label: str) -> None:
        """Send a message. A broken link loses it, as the stream's quality of service allows."""
        try:  # noqa: SIM105  a context manager costs more than the rest of this function
            self._publisher.put(data, encoding=_encoding(label))
        except zenoh.ZError:
            pass


class Replies:
    """Answers to a query as they arrive, until Zenoh reports the end or QUERY_END_MARGIN after the timeout."""

    def __init__(self, timeout: float) -> None:
        self._limit = time.monotonic() + timeout + QUERY_END_MARGIN
        # Unbounded, since Zenoh's thread must not block; the number of answers is that of the processes.
        self._came: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.handler = zenoh.handlers.Callback(self._came.put, self.end, indirect=False)

    def end(self) -> None:
        """Mark the end of the answers."""
        self._came.put(None)

    def __iter__(self) -> Iterator[Answer]:
        has_timed_out = False
        with contextlib.suppress(queue.Empty):
            while (reply := self._came.get(timeout=max(0.0, self._limit - time.monotonic()))) is not None:
                if reply.ok is not None:
                    sample = reply.ok
                    label = str(sample.encoding).removeprefix(MEDIA)
                    yield Answer(str(sample.key_expr), sample.payload.to_bytes(), label, "")
                elif reply.err is not None:
                    refusal = reply.err.payload.to_string()
                    if refusal != TIMED_OUT or not has_timed_out:  # the session and the router may both report it
                        yield Answer("", b"", "", refusal)
                    has_timed_out |= refusal == TIMED_OUT


class Session:
    """One session on a network, with its declarations, until it is closed.

    It counts the tokens and queries that it receives. A process declares its subscriptions before its token, on the
    same link, so Zenoh knows them when the token arrives; the same usually holds for a query. A plain message does not
    count: the reply to it may be lost if its sender has only just subscribed.

    Args:
        config: Zenoh's configuration, as JSON.

    Raises:
        SessionError: It cannot be opened.
    """

    def __init__(self, config: str) -> None:
        self._session = zenoh.open(zenoh.Config.from_json5(config))
        self._held: list[Any] = []
        self._arrivals = 0

    def close(self) -> None:
        """Leave the network."""
        self._held.clear()
        with contextlib.suppress(zenoh.ZError):
            self._session.close()  # type: ignore[no-untyped-call]

    def neighbours(self) -> int:
        """Number of processes that this one is linked to."""
        try:
            info = self._session.info
            return len(list(info.peers_zid())) + len(list(info.routers_zid()))
        except zenoh.ZError:
            return 0

    def clients(self) -> int:
        """Number of clients that are linked to this router."""
        try:
            return sum(transport.whatami == zenoh.WhatAmI.CLIENT for transport in self._session.info.transports())
        except zenoh.ZError:
            return 0

    def tell(self, key: str) -> None:
        """Send one empty message reliably."""
        with contextlib.suppress(zenoh.ZError):
            self._session.put(key, b"", congestion_control=zenoh.CongestionControl.BLOCK)

    def publisher(self, key: str, congestion: str, priority: str) -> Publisher:
        """Declare a stream to publish to other processes; readers in this process receive it by reference instead."""
        return Publisher(
            self._session.declare_publisher(
                key,
                congestion_control=_CONGESTION[congestion],
                priority=_PRIORITY[priority],
                allowed_destination=zenoh.Locality.REMOTE,
            ),
            lambda: self._arrivals,
        )

    def subscribe(self, key_expr: str, receive: Receive, most: int) -> None:
        """Subscribe to a stream, or to several with `*`; a message larger than `most` bytes is not copied."""
        # A key as text costs more than the rest of this callback; without wildcards it is known.
        single = "" if "*" in key_expr else key_expr

        def take(sample: Any) -> None:
            payload = sample.payload
            data = None if len(payload) > most else payload.to_bytes()
            with contextlib.suppress(Exception):  # no exception may reach the session, which serves all streams
                receive(single or str(sample.key_expr), data, str(sample.encoding).removeprefix(MEDIA))

        self._held.append(self._session.declare_subscriber(key_expr, zenoh.handlers.Callback(take, indirect=False)))

    def announce(self, key: str) -> None:
        """Declare a liveliness token."""
        self._held.append(self._session.liveliness().declare_token(key))

    def watch(self, key_expr: str, change: Callable[[str, bool], None]) -> None:
        """Call `change` with each liveliness token that exists, appears or disappears."""

        def take(sample: Any) -> None:
            self._arrivals += 1
            with contextlib.suppress(Exception):
                change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        handler = zenoh.handlers.Callback(take, indirect=False)
        # With history: tokens that exist already are reported first.
        self._held.append(self._session.liveliness().declare_subscriber(key_expr, handler, history=True))

    def serve(self, key: str, take: Callable[[Question], None]) -> None:
        """Serve queries of a key. `take` is called on the network's thread and must only pass the query on."""

        def pass_on(query: Any) -> None:
            self._arrivals += 1
            with contextlib.suppress(Exception):
                take(Question(query))

        handler = zenoh.handlers.Callback(pass_on, indirect=False)
        self._held.append(self._session.declare_queryable(key, handler, complete=True))

    def alive(self, key_expr: str, timeout: float) -> Replies:
        """Liveliness tokens that this session sees, as answers."""
        replies = Replies(timeout)
        try:
            self._session.liveliness().get(key_expr, replies.handler, timeout=timeout)
        except zenoh.ZError:
            replies.end()
        return replies

    def ask(self, key_expr: str, data: bytes, timeout: float) -> Replies:
        """Query a key: the answers of all that serve it, for at most `timeout`, s."""
        replies = Replies(timeout)
        try:
            self._session.get(
                key_expr,
                replies.handler,
                payload=data,
                timeout=timeout,
                # By default Zenoh asks only the best match.
                target=zenoh.QueryTarget.ALL,
                # Zenoh would keep one answer of each key, and two processes may answer the same question.
                consolidation=zenoh.ConsolidationMode.NONE,
                congestion_control=zenoh.CongestionControl.BLOCK,
                priority=zenoh.Priority.INTERACTIVE_HIGH,
            )
        except zenoh.ZError:  # the session is closed: no answers
            replies.end()
        return replies
