"""A connection to a robot's network that outlasts its sessions: each new session repeats all declarations."""

from __future__ import annotations

import json
import os
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING

from navloom.errors import NavloomError

from navloom_live.timing import GATHER_WAIT, SESSION_LINGER, SESSION_SETTLE, SESSION_SPREAD
from navloom_live.transport.access import HERE, MOVED
from navloom_live.transport.file_watch import FileWatch
from navloom_live.transport.keyspace import LARGEST
from navloom_live.transport.link_faults import why_not
from navloom_live.transport.links import Link, credential_files, settings
from navloom_live.transport.sender import Sender
from navloom_live.transport.zenoh_session import Publisher, Question, Receive, Replies, Session, SessionError

if TYPE_CHECKING:  # without messages and numpy a router restarts in a moment
    from navloom_live.transport.quality_of_service import Quality

__all__ = ["BusError", "Connection", "Way"]

CERTIFICATE_CHECK_INTERVAL = 1.0
"""Interval of checking the certificate files for changes, s."""
RECENT = 64
"""Number of newest messages of a stream in which duplicates are detected while there are two sessions."""
ROUTER_REPORT_AFTER = 2.0
"""How long a router of the same host may take to listen, s; a longer wait is reported."""
ROUTER_CHECK_INTERVAL = 0.1
"""Interval at which a client checks for its router, s."""
CLOSE_LIMIT = 0.5
"""Longest wait for a pending connection attempt when this process leaves, s."""


class BusError(NavloomError, OSError):
    """The network could not be joined."""


class Way:
    """One way out for a stream: its publisher in the current session; None before the first session."""

    def __init__(self, sender: Sender | None) -> None:
        self.publisher: Publisher | None = None
        self._sender = sender

    @property
    def is_heard(self) -> bool:
        """Whether this way has a subscriber."""
        return self.publisher is not None and self.publisher.is_heard

    def put(self, data: bytes, label: str) -> None:
        """Send a message, directly or by the sender's thread."""
        publisher = self.publisher
        if publisher is None:
            return
        if self._sender is None:  # Zenoh itself finds out whether there is a subscriber, also in a new session
            publisher.put(data, label)
        elif publisher.is_heard:
            self._sender.hand(partial(publisher.put, data, label), len(data))


class Connection:
    """A sequence of sessions on one network.

    A client that loses its router rejoins with a new session that has the same declarations. A client whose certificate
    was renewed, or whose router has a successor, opens a new session before it closes the old one: no message is lost
    or duplicated, and its liveliness tokens do not disappear.

    Args:
        link: How to join.
        patience: How long to try if the router is not running yet, s.
        say: Receives one message if the router must be waited for, with the reason.
        goes_on: Whether to try again; called after each failed attempt.
        waits: Wait for the router. Otherwise the connection starts without it, and joins when it is there.
        sender: Sends and answers on its own thread, so that callers never wait; None to send on the caller's thread.

    Attributes:
        losses: How often it lost its router and rejoined.
        moves: How often it moved to a new session without a loss.
        denials: How often it kept its session because the router did not know its new certificate.

    Raises:
        LinkError: The link is refused; BusError: it does not work.
    """

    def __init__(
        self,
        link: Link,
        patience: float = 3.0,
        say: Callable[[str], None] = lambda text: None,
        goes_on: Callable[[], bool] = lambda: True,
        waits: bool = True,
        sender: Sender | None = None,
    ) -> None:
        self._link, self._config, self._sender, self._say = link, json.dumps(settings(link)), sender, say
        self._router = f"{link.realm}/{link.robot}/{HERE}"
        self._off_host = any(not _is_local(endpoint) for endpoint in (*link.listen, *link.connect))
        self._declared: list[Callable[[Session], None]] = []
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._newest: Session | None = self._begin(patience, goes_on) if waits else None
        self._used = self._newest
        self._old: Session | None = None
        self._when_used: list[Callable[[], None]] = []
        self._forget: list[Callable[[Session], None]] = []
        self._is_to_move = threading.Event()
        self._credentials = None if link.credentials is None else FileWatch(credential_files(link))
        self._thread: threading.Thread | None = None
        self.losses = self.moves = self.denials = 0
        if link.mode == "client":
            if self._credentials is not None:
                self.subscribe(f"{link.realm}/{link.robot}/{MOVED}", lambda *_: self._is_to_move.set())
            self._thread = threading.Thread(target=self._keep_joined, name="connection", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Leave the network."""
        with self._lock:
            self._closing.set()
            sessions = [session for session in (self._newest, self._old) if session is not None]
        for session in sessions:
            session.close()
        if self._thread is not None:
            self._thread.join(CLOSE_LIMIT)

    # --- joining ----------------------------------------------------------------------------------------------------

    def _begin(self, patience: float, goes_on: Callable[[], bool]) -> Session:
        """Open the first session. Raises BusError."""
        link, began, is_told = self._link, time.monotonic(), False
        while True:
            try:
                session = Session(self._config)
                break
            except SessionError as error:
                if link.mode != "client" or time.monotonic() - began > patience or not goes_on():
                    raise BusError(_why(link, error)) from None
                if not is_told and time.monotonic() - began > ROUTER_REPORT_AFTER:
                    is_told = True
                    self._say(f"{_why(link, error)}; waiting for it")
                time.sleep(0.1)
        limit = time.monotonic() + GATHER_WAIT
        while session.neighbours() < link.peers and time.monotonic() < limit:
            time.sleep(0.005)  # for neighbours that connect to this process; Zenoh itself waits for the others
        return session

    def _keep_joined(self) -> None:
        """Rejoin when the router is lost; move to a new session if it has a successor or the certificate is new."""
        looked = time.monotonic()
        while not self._closing.is_set():
            if not self.neighbours():
                self._join_anew()
            elif self._credentials is not None and time.monotonic() - looked > CERTIFICATE_CHECK_INTERVAL:
                looked = time.monotonic()
                if self._credentials.has_changed():
                    self._is_to_move.set()
            if self._is_to_move.is_set():
                self._stay(SESSION_SPREAD * (os.getpid() % 8) / 8)
                self._is_to_move.clear()
                self._move()
            self._closing.wait(ROUTER_CHECK_INTERVAL)

    def _join_anew(self) -> None:
        """Open a session to replace a lost one, or the first one, on this thread; no caller waits for it."""
        lost, began, is_told = self._newest, time.monotonic(), self._newest is not None
        if lost is not None:
            self.losses += 1
            lost.close()
        while not self._closing.is_set():
            try:
                session = Session(self._config)
            except SessionError as error:
                if not is_told and time.monotonic() - began > ROUTER_REPORT_AFTER:
                    is_told = True
                    self._say(f"{_why(self._link, error)}; until then the robot cannot be reached from other hosts")
                self._closing.wait(ROUTER_CHECK_INTERVAL)
            else:
                self._take_over(session, lost)
                return

    def _take_over(self, session: Session, lost: Session | None) -> None:
        """Use a session instead of a lost one."""
        with self._lock:
            if self._closing.is_set():
                session.close()
                return
            if lost is not None:
                for forget in self._forget:  # tokens that still exist are reported again
                    forget(lost)
            self._newest = session
            self._use()
            with suppress(SessionError):  # if the router is lost again, the next check finds out
                for declare in self._declared:
                    declare(session)

    def _move(self) -> None:
        """Open a new session, use it once the network knows its streams, and close the old one after a while."""
        first = self._newest
        if first is None or self._credentials is None:
            return
        self._credentials.take()
        try:
            second = Session(self._config)
        except SessionError:  # the first session stays; if its router ends, this process rejoins
            return
        with self._lock:
            if self._closing.is_set():
                second.close()
                return
            self._newest, self._old, known = second, first, len(self._declared)
            with suppress(SessionError):  # if the router is lost at once, the next check finds out
                for declare in self._declared:
                    declare(second)
        self._stay(SESSION_SETTLE)
        is_denied = bool([*first.alive(self._router, 1.0)]) and not [*second.alive(self._router, 1.0)]
        with self._lock:
            if is_denied:  # The router does not know the new certificate. Its successor will, and announces itself.
                self._newest, self._old = first, second
                self._when_used.clear()
                self.denials += 1
                with suppress(SessionError):
                    for declare in self._declared[known:]:
                        declare(first)
            else:
                self._use()
                self.moves += 1
        if not is_denied:
            self._stay(SESSION_LINGER)
        with self._lock:
            left = second if is_denied else first
            left.close()
            self._old = None  # only now: until it is closed, messages may arrive by both sessions
            for forget in self._forget:
                forget(left)

    def _stay(self, seconds: float) -> None:
        """Wait, unless the newest session is lost or this process leaves."""
        limit = time.monotonic() + seconds
        while self.neighbours() and time.monotonic() < limit and not self._closing.wait(ROUTER_CHECK_INTERVAL):
            pass

    def _use(self) -> None:
        """Send, query and answer by the newest session from now on."""
        self._used = self._newest
        for use in self._when_used:
            use()
        self._when_used.clear()

    def _declare(self, declare: Callable[[Session], None]) -> None:
        """Declare something now, and again in each later session."""
        with self._lock:
            self._declared.append(declare)
            if self._newest is not None:
                try:
                    declare(self._newest)
                except SessionError:
                    if self._thread is None:
                        raise
                    # The router is lost; the connection rejoins and repeats the declaration.

    # --- what it is for ---------------------------------------------------------------------------------------------

    def neighbours(self) -> int:
        """Number of processes that this one is linked to."""
        return 0 if self._newest is None else self._newest.neighbours()

    def clients(self) -> int:
        """Number of clients that are linked to this router."""
        return 0 if self._newest is None else self._newest.clients()

    def tell(self, key: str) -> None:
        """Send one empty message reliably."""
        if self._newest is not None:
            self._newest.tell(key)

    def publish(self, key: str, quality: Quality, lossless: bool) -> Way:
        """Declare a stream to publish. If `lossless`, sending waits where it would otherwise drop."""
        congestion = "block" if lossless else quality.off_host if self._off_host else quality.congestion
        way = Way(None if lossless else self._sender)

        def declare(session: Session) -> None:
            publisher = session.publisher(key, congestion, quality.priority)
            if session is self._used or way.publisher is None:
                way.publisher = publisher
            else:
                self._when_used.append(lambda: setattr(way, "publisher", publisher))

        self._declare(declare)
        return way

    def subscribe(self, key_expr: str, receive: Receive, most: int = LARGEST) -> None:
        """Subscribe to a stream, or to several with `*`; a message larger than `most` bytes is not copied."""
        recent: deque[int] = deque(maxlen=RECENT)
        lock = threading.Lock()

        def take(key: str, data: bytes | None, label: str) -> None:
            if self._old is not None:  # the message may already have arrived by the other session
                mark = hash((key, data))
                with lock:
                    is_known = mark in recent
                    recent.append(mark)
                if is_known:
                    return
            receive(key, data, label)

        self._declare(lambda session: session.subscribe(key_expr, take, most))

    def announce(self, key: str) -> None:
        """Declare a liveliness token for as long as the connection lasts."""
        self._declare(lambda session: session.announce(key))

    def watch(self, key_expr: str, change: Callable[[str, bool], None]) -> None:
        """Call `change` with each liveliness token that exists, appears or disappears."""
        seen: dict[str, set[Session]] = {}
        lock = threading.Lock()

        def note(session: Session, key: str, is_there: bool) -> None:
            """Record whether a session sees a token; one of two sessions is enough."""
            with lock:
                sessions = seen.setdefault(key, set())
                was_there = bool(sessions)
                (sessions.add if is_there else sessions.discard)(session)
                has_changed = bool(sessions) != was_there
                if not sessions:
                    del seen[key]
            if has_changed:
                change(key, is_there)

        def forget(session: Session) -> None:
            with lock:
                keys = sorted(seen)
            for key in keys:
                note(session, key, False)

        self._forget.append(forget)
        self._declare(lambda session: session.watch(key_expr, lambda key, there: note(session, key, there)))

    def serve(self, key: str, take: Callable[[Question], None], is_large: bool = False) -> None:
        """Serve queries of a key. `take` is called on the network's thread and must only pass the query on.

        For large answers, the sender's thread calls it if there is a sender.
        """
        sender = self._sender if is_large else None

        def declare(session: Session) -> None:
            def pass_on(question: Question) -> None:
                if session is not self._used:  # only one of two sessions answers
                    question.drop()
                elif sender is None:
                    take(question)
                else:
                    sender.hand(partial(take, question), 0)

            session.serve(key, pass_on)

        self._declare(declare)

    def alive(self, key_expr: str, timeout: float) -> Replies:
        """Existing liveliness tokens, as answers."""
        return _none() if self._used is None else self._used.alive(key_expr, timeout)

    def ask(self, key_expr: str, data: bytes, timeout: float) -> Replies:
        """Query a key: the answers of all that serve it, for at most `timeout`, s."""
        return _none() if self._used is None else self._used.ask(key_expr, data, timeout)


def _none() -> Replies:
    """An empty set of answers."""
    replies = Replies(0.0)
    replies.end()
    return replies


def _why(link: Link, error: Exception) -> str:
    """Why a link does not come up, as text."""
    said = str(error).partition(" at /")[0]
    if link.mode == "router":
        failure = re.search(r"os error (\d+)", said)
        return f"{', '.join(link.listen)} cannot be listened at: {os.strerror(int(failure[1])) if failure else said}"
    ends = ", ".join((*link.listen, *link.connect)) or "no endpoint"
    return f"the network at {ends} cannot be joined: {why_not(link) or said}"


def _is_local(endpoint: str) -> bool:
    protocol, _, address = endpoint.partition("/")
    return protocol.startswith("unix") or address.startswith(("127.", "localhost", "[::1]"))
