"""The only module that speaks Zenoh: one session a process, closed whatever happens."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import queue
import re
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from functools import lru_cache
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple

import zenoh

from navloom.runtime.access import HERE, MOVED
from navloom.runtime.file_watch import FileWatch
from navloom.runtime.keyspace import LARGEST
from navloom.runtime.link_faults import why_not
from navloom.runtime.links import GATHER, Link, credential_files, settings

if TYPE_CHECKING:  # a router starts anew in a moment if it needs neither messages nor numpy
    from navloom.runtime.quality import Quality

__all__ = ["TIMED_OUT", "Answer", "Bus", "BusError", "Publication", "Question"]

MEDIA = "application/x-navloom;"
CERTIFICATES = 1.0
"""s between two looks whether the certificate files are new."""
SPREAD = 1.0
"""s over which processes of a host open their other sessions, so that they do not all want a processor at once."""
SETTLE = 0.3
"""s from the opening of another session until it is used: the network knows its streams by then."""
LINGER = 2.5
"""s a session stays open after another has taken over: longer than a question waits for its answer."""
RECENT = 64
"""Messages that a stream is known again by, where they come by two sessions."""
STARTING = 2.0
"""s that a router of the same host may take to listen; who waits longer is told."""
TIMED_OUT = "Timeout"
"""What Zenoh says in the place of an answer that does not come."""
OVERDUE = 0.5
"""s after the time of a question at which it ends, whatever Zenoh says of it."""
LOOK = 0.1
"""s between two looks of a client at its router."""
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


class BusError(OSError):
    """The network could not be joined."""


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


class Publication:
    """A stream that this process publishes; readers within the process are served by reference, not by this."""

    def __init__(self) -> None:
        self._publisher: Any = None

    @property
    def leads(self) -> bool:
        """There is a publisher that it sends by."""
        return self._publisher is not None

    def lead_to(self, publisher: Any) -> None:
        """Send by this publisher from now on."""
        self._publisher = publisher

    @property
    def is_heard(self) -> bool:
        """Some other process hears the stream, as far as this one knows by now: else nothing need be encoded."""
        return bool(self._publisher.matching_status.matching)

    def put(self, data: bytes, label: str) -> None:
        """Send a message. A link that is gone loses it, as the stream's quality allows."""
        with contextlib.suppress(zenoh.ZError):
            self._publisher.put(data, encoding=_encoding(label))


class Bus:
    """One session on a robot's network. Use it in a `with` statement: an open session hangs the process at its end.

    A client that lost its router joins anew, as another session with the same streams. One whose certificate was
    renewed, or whose router has a successor, opens the other session before it closes the first: no message is lost or
    comes twice, and nobody sees it go.

    Args:
        link: How to join.
        patience: s to try for, where the router is not there yet.
        say: Told once that the router is waited for, and why.
        goes_on: Asked after each try that failed.

    Attributes:
        losses: How often it lost its router and joined anew.
        moves: How often it went over to another session without a loss.
        denials: How often it stayed, because the router did not know its new certificate.

    Raises:
        LinkError: A link that is refused; BusError: one that does not work.
    """

    def __init__(
        self,
        link: Link,
        patience: float = 3.0,
        say: Callable[[str], None] = lambda text: None,
        goes_on: Callable[[], bool] = lambda: True,
    ) -> None:
        self._config = json.dumps(settings(link))
        self._numbers = itertools.count()
        self._router = f"{link.realm}/{link.robot}/{HERE}"
        began, is_told = time.monotonic(), False
        while True:
            try:
                self._open()
                break
            except zenoh.ZError as error:
                if link.mode != "client" or time.monotonic() - began > patience or not goes_on():
                    raise BusError(_why(link, error)) from None
                if not is_told and time.monotonic() - began > STARTING:
                    is_told = True
                    say(f"{_why(link, error)}; waiting for it")
                time.sleep(0.1)
        self._gather(link)
        self._off_host = any(not _is_local(endpoint) for endpoint in (*link.listen, *link.connect))
        self._declared: list[Callable[[], Any]] = []
        self._held: list[Any] = []
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._used, self._used_number = self._session, self._number
        self._old: Any = None
        self._when_used: list[Callable[[], None]] = []
        self._forget: list[Callable[[int], None]] = []
        self._is_to_move = threading.Event()
        self._credentials = None if link.credentials is None else FileWatch(credential_files(link))
        self.losses = self.moves = self.denials = 0
        if link.mode == "client":
            if self._credentials is not None:
                self.subscribe(f"{link.realm}/{link.robot}/{MOVED}", lambda *_: self._is_to_move.set())
            threading.Thread(target=self._keep_joined, name="bus", daemon=True).start()

    def __enter__(self) -> Bus:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the network."""
        self._closing.set()
        with self._lock:
            self._leave()
            self._leave_old()

    def _open(self) -> None:
        self._session = zenoh.open(zenoh.Config.from_json5(self._config))
        self._number = next(self._numbers)

    def _leave(self) -> None:
        self._held.clear()
        with contextlib.suppress(zenoh.ZError):
            self._session.close()  # type: ignore[no-untyped-call]

    def _keep_joined(self) -> None:
        """Join anew whenever the router is lost; move where it has a successor, or the certificate is new."""
        looked = time.monotonic()
        while not self._closing.wait(LOOK):
            if not self.neighbours():
                with self._lock:
                    if not self._closing.is_set():
                        self.losses += 1
                        self._leave()
                        self._join_anew()
            elif self._credentials is not None and time.monotonic() - looked > CERTIFICATES:
                looked = time.monotonic()
                if self._credentials.has_changed():
                    self._is_to_move.set()
            if self._is_to_move.is_set():
                self._stay(SPREAD * (os.getpid() % 8) / 8)
                self._is_to_move.clear()
                self._move()

    def _join_anew(self) -> None:
        lost = self._number
        while not self._closing.is_set():
            try:
                self._open()
                for forget in self._forget:  # who is still there is told of again
                    forget(lost)
                lost = self._number
                self._use()
                self._held = [declare() for declare in self._declared]
                return
            except zenoh.ZError:
                self._closing.wait(LOOK)

    def _move(self) -> None:
        """Open another session, use it once the network knows its streams, and close the first after a while."""
        first = self._session, self._number, self._held
        with self._lock:
            if self._closing.is_set() or self._credentials is None:
                return
            self._credentials.take()
            try:
                self._open()
            except zenoh.ZError:  # the first goes on; where its router ends, this process joins anew
                return
            self._old = first[0]
            with contextlib.suppress(zenoh.ZError):  # a router that is lost at once is found lost
                self._held = [declare() for declare in self._declared]
        self._stay(SETTLE)
        left = first
        if _tokens(first[0], self._router) and not _tokens(self._session, self._router):
            # The router does not know the new certificate. Its successor will, and says so.
            left = self._session, self._number, self._held
            with self._lock:
                self._session, self._number, self._held = first
                self._old = left[0]
                self._when_used.clear()
                self.denials += 1
        else:
            with self._lock:
                self._use()
                self.moves += 1
            self._stay(LINGER)
        with self._lock:
            left[2].clear()
            self._leave_old()
            for forget in self._forget:
                forget(left[1])

    def _stay(self, seconds: float) -> None:
        """Wait, unless the newest session is lost or this process leaves."""
        limit = time.monotonic() + seconds
        while self.neighbours() and time.monotonic() < limit and not self._closing.wait(LOOK):
            pass

    def _leave_old(self) -> None:
        if self._old is not None:
            with contextlib.suppress(zenoh.ZError):
                self._old.close()
            self._old = None  # not before: until it is closed, messages may come by both

    def _use(self) -> None:
        """Send, ask and answer by the newest session from now on."""
        self._used, self._used_number = self._session, self._number
        for use in self._when_used:
            use()
        self._when_used.clear()

    def _declare(self, declare: Callable[[], Any]) -> None:
        """Declare something now, and again in each session to come."""
        with self._lock:
            self._held.append(declare())
            self._declared.append(declare)

    def _gather(self, link: Link) -> None:
        """Wait for neighbours that call this process, as those it calls itself are waited for by Zenoh."""
        limit = time.monotonic() + GATHER * 1e-3
        while self.neighbours() < link.peers and time.monotonic() < limit:
            time.sleep(0.005)

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

    def publication(self, key: str, quality: Quality, lossless: bool = False) -> Publication:
        """A stream to publish to; lossless waits where it would drop."""
        congestion = quality.off_host if self._off_host else quality.congestion
        publication = Publication()

        def declare() -> None:
            publisher = self._session.declare_publisher(
                key,
                congestion_control=_CONGESTION["block" if lossless else congestion],
                priority=_PRIORITY[quality.priority],
                allowed_destination=zenoh.Locality.REMOTE,
            )
            if self._used_number == self._number or not publication.leads:
                publication.lead_to(publisher)
            else:
                self._when_used.append(lambda: publication.lead_to(publisher))

        self._declare(declare)
        return publication

    def subscribe(self, key_expr: str, receive: Receive, most: int = LARGEST) -> None:
        """Hear a stream, or several with `*`, for as long as the session lasts.

        Args:
            key_expr: The streams.
            receive: Takes each message.
            most: Bytes of a message at most: a larger one is not copied.
        """
        single = "" if "*" in key_expr else key_expr
        recent: deque[int] = deque(maxlen=RECENT)
        lock = threading.Lock()

        def is_known(key: str, data: bytes | None) -> bool:
            """It has come by the other of two sessions."""
            mark = hash((key, data))
            with lock:
                known = mark in recent
                recent.append(mark)
            return known

        def take(sample: Any) -> None:
            payload = sample.payload
            data = None if len(payload) > most else payload.to_bytes()
            with contextlib.suppress(Exception):  # the callback of a whole session: nothing may escape into it
                if self._old is not None and is_known(str(sample.key_expr), data):
                    return
                receive(single or str(sample.key_expr), data, str(sample.encoding).removeprefix(MEDIA))

        def declare() -> Any:
            return self._session.declare_subscriber(key_expr, zenoh.handlers.Callback(take, indirect=False))

        self._declare(declare)

    def announce(self, key: str) -> None:
        """Show others that something is alive, until the session ends."""
        self._declare(lambda: self._session.liveliness().declare_token(key))

    def watch(self, key_expr: str, change: Callable[[str, bool], None]) -> None:
        """Be told who is alive, who comes and who goes."""

        seen: dict[str, set[int]] = {}
        lock = threading.Lock()

        def note(number: int, key: str, is_there: bool) -> None:
            """A session sees a token, or no longer; one of two is enough."""
            with lock:
                sessions = seen.setdefault(key, set())
                was_there = bool(sessions)
                (sessions.add if is_there else sessions.discard)(number)
                has_changed = bool(sessions) != was_there
                if not sessions:
                    del seen[key]
            if has_changed:
                with contextlib.suppress(Exception):
                    change(key, is_there)

        def forget(number: int) -> None:
            with lock:
                keys = sorted(seen)
            for key in keys:
                note(number, key, False)

        def declare() -> Any:
            number = self._number

            def take(sample: Any) -> None:
                note(number, str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

            handler = zenoh.handlers.Callback(take, indirect=False)
            return self._session.liveliness().declare_subscriber(key_expr, handler, history=True)

        self._forget.append(forget)
        self._declare(declare)

    def alive(self, key_expr: str, timeout: float = 1.0) -> list[str]:
        """Tokens that are there."""
        return _tokens(self._used, key_expr, timeout)

    def serve(self, key: str, take: Callable[[Question], None]) -> None:
        """Answer questions; `take` is called on the network's thread and must only pass them on."""

        def declare() -> Any:
            number = self._number

            def pass_on(query: Any) -> None:
                if number != self._used_number:  # of two sessions, one answers
                    query.drop()
                    return
                with contextlib.suppress(Exception):
                    take(Question(query))

            handler = zenoh.handlers.Callback(pass_on, indirect=False)
            return self._session.declare_queryable(key, handler, complete=True)

        self._declare(declare)

    def ask(self, key_expr: str, data: bytes = b"", timeout: float = 2.0) -> Iterator[Answer]:
        """Answers of all who serve a key, as they come, for at most this many s.

        Whoever has the question and does not answer it in that time gives the refusal TIMED_OUT. Without any answer
        nobody serves the key, as far as this session knows.
        """
        replies = _Replies(timeout)
        try:
            self._used.get(
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
            return
        for reply in replies:
            if reply.ok is not None:
                sample = reply.ok
                label = str(sample.encoding).removeprefix(MEDIA)
                yield Answer(str(sample.key_expr), sample.payload.to_bytes(), label, "")
            elif reply.err is not None:
                yield Answer("", b"", "", reply.err.payload.to_string())


def _tokens(session: zenoh.Session, key_expr: str, timeout: float = 1.0) -> list[str]:
    """Tokens that a session is shown."""
    replies = _Replies(timeout)
    try:
        session.liveliness().get(key_expr, replies.handler, timeout=timeout)
    except zenoh.ZError:
        return []
    return sorted({str(reply.ok.key_expr) for reply in replies if reply.ok is not None})


class _Replies:
    """Replies to a question as they come, until Zenoh says that there are no more, or the time is over for sure."""

    def __init__(self, timeout: float) -> None:
        self._limit = time.monotonic() + timeout + OVERDUE
        self._came: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.handler = zenoh.handlers.Callback(self._came.put, lambda: self._came.put(None), indirect=False)

    def __iter__(self) -> Iterator[Any]:
        with contextlib.suppress(queue.Empty):
            while (reply := self._came.get(timeout=max(0.0, self._limit - time.monotonic()))) is not None:
                yield reply


def _why(link: Link, error: zenoh.ZError) -> str:
    """What a link that does not come up lacks, in words."""
    said = str(error).partition(" at /")[0]
    if link.mode == "router":
        failure = re.search(r"os error (\d+)", said)
        return f"{', '.join(link.listen)} cannot be listened at: {os.strerror(int(failure[1])) if failure else said}"
    ends = ", ".join((*link.listen, *link.connect)) or "no endpoint"
    return f"the network at {ends} cannot be joined: {why_not(link) or said}"


def _is_local(endpoint: str) -> bool:
    """It ends on this host."""
    protocol, _, address = endpoint.partition("/")
    return protocol.startswith("unix") or address.startswith(("127.", "localhost", "[::1]"))
