"""The bus of a process: one connection to the processes of its host, and one through a router to all others."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import TYPE_CHECKING

from navloom_live.transport.connection import BusError, Connection, Way
from navloom_live.transport.keyspace import LARGEST
from navloom_live.transport.links import Link
from navloom_live.transport.sender import Sender
from navloom_live.transport.zenoh_session import TIMED_OUT, Answer, Question, Receive

if TYPE_CHECKING:  # without messages and numpy a router restarts in a moment
    from navloom_live.transport.quality_of_service import Quality

__all__ = ["TIMED_OUT", "Answer", "Bus", "BusError", "Publication", "Question"]


class Publication:
    """A stream that this process publishes to others; readers within the process receive it by reference instead."""

    def __init__(self, ways: tuple[Way, ...]) -> None:
        self._ways = ways

    def add(self, way: Way) -> None:
        """Publish by one more connection."""
        self._ways = (*self._ways, way)

    @property
    def is_heard(self) -> bool:
        """Whether another process subscribes, as far as is known; if not, nothing needs to be encoded."""
        for way in self._ways:  # noqa: SIM110  `any` with a generator takes three times as long
            if way.is_heard:
                return True
        return False

    def put(self, data: bytes, label: str) -> None:
        """Send a message. A broken link loses it, as the stream's quality of service allows."""
        for way in self._ways:
            way.put(data, label)


class Bus:
    """A process on a robot's network. Use it in a `with` statement: an open session hangs the process at its end.

    With a mesh (`Link.mesh`) it has two connections. Streams, tokens and services are declared on both. Messages from
    an instance or process of this host are taken only from the mesh, all others only from the router. So no message is
    duplicated, and load or loss of the router does not affect communication within the host. If the whole robot is on
    this host, nothing waits for the router either.

    Args:
        link: How to join.
        patience: How long to try if the router is not running yet, s.
        say: Receives one message if the router must be waited for, with the reason.
        goes_on: Whether to try again; called after each failed attempt.
        waits: Wait for the router even if the whole robot is on this host.

    Raises:
        LinkError: The link is refused; BusError: it does not work.
    """

    def __init__(
        self,
        link: Link,
        patience: float = 3.0,
        say: Callable[[str], None] = lambda text: None,
        goes_on: Callable[[], bool] = lambda: True,
        waits: bool = False,
    ) -> None:
        mesh = link.mesh
        self._is_whole = mesh is not None and mesh.is_whole
        self._prefix = f"{link.realm}/{link.robot}/"
        self._here = frozenset(() if mesh is None else mesh.here)
        self._sender = Sender() if self._is_whole else None
        # The mesh first: within the host, nothing may depend on the router.
        self._mesh = None if mesh is None else Connection(mesh.link)
        self._more: tuple[Connection, ...] = ()
        try:
            # A robot that is whole on this host must start without its router, too.
            waits = waits or not self._is_whole
            self._outer = Connection(link, patience, say, goes_on, waits, self._sender)
        except BaseException:
            self._leave()
            raise
        self._near = () if self._mesh is None else (self._mesh,)
        self._all = (*self._near, self._outer)
        self._declared: list[Callable[[Connection], None]] = []
        self._is_closed = False
        self._growing = threading.RLock()  # a declaration may call back at once

    def __enter__(self) -> Bus:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the network."""
        with self._growing:
            self._is_closed = True
        self._leave()
        self._outer.close()

    def _leave(self) -> None:
        if self._sender is not None:
            self._sender.close()
        if self._mesh is not None:
            self._mesh.close()
        for connection in self._more:
            connection.close()

    def bring_here(self, *places: str) -> None:
        """Take messages of these places from the mesh: role/instance or process/name, of a process that joined it."""
        if self._mesh is not None:
            self._here = self._here | set(places)

    def reach(self, end: str) -> None:
        """Connect to one more process of this host, to which this one's session does not connect.

        Zenoh takes no further endpoints in an open session, so this opens another one, with the same declarations. It
        is for tools: a process of the robot listens, and the new one connects to it.

        Raises:
            BusError: It cannot be reached.
        """
        realm, robot, _ = self._prefix.split("/")
        one = Connection(Link("peer", (), (end,), realm=realm, robot=robot))
        with self._growing:
            if self._is_closed:  # an open session would keep the process from ending
                one.close()
                return
            self._more = (*self._more, one)
            if self._mesh is not None:
                self._near = (*self._near, one)
            self._all = (*self._all, one)
            for declare in self._declared:
                declare(one)

    def _declare(self, declare: Callable[[Connection], None]) -> None:
        """Declare something on every connection, and on those to come."""
        with self._growing:
            # Kept for connections to come, see `reach`.
            self._declared.append(declare)
            for one in self._all:
                declare(one)

    @property
    def losses(self) -> int:
        """How often it lost its router and rejoined."""
        return self._outer.losses

    @property
    def moves(self) -> int:
        """How often it moved to a new session without a loss."""
        return self._outer.moves

    @property
    def denials(self) -> int:
        """How often it kept its session because the router did not know its new certificate."""
        return self._outer.denials

    def neighbours(self) -> int:
        """Number of processes that this one is linked to."""
        return sum(one.neighbours() for one in self._all)

    def has_router(self) -> bool:
        """Whether it is linked to its router."""
        return self._outer.neighbours() > 0

    def clients(self) -> int:
        """Number of clients that are linked to this router."""
        return self._outer.clients()

    def tell(self, key: str) -> None:
        """Send one empty message reliably."""
        self._outer.tell(key)

    def publication(self, key: str, quality: Quality, lossless: bool = False) -> Publication:
        """Declare a stream to publish. If `lossless`, sending waits where it would otherwise drop."""
        made = Publication(())
        self._declare(lambda one: made.add(one.publish(key, quality, lossless)))
        return made

    def subscribe(self, key_expr: str, receive: Receive, most: int = LARGEST) -> None:
        """Subscribe to a stream, or to several with `*`.

        Args:
            key_expr: The streams.
            receive: Called with each message.
            most: Largest message, bytes; a larger one is not copied.
        """

        def declare(one: Connection) -> None:
            def take(key: str, data: bytes | None, label: str) -> None:
                if self._is_from(one, key):
                    receive(key, data, label)

            ways = self._ways(key_expr)
            if one in ways:
                # With one way there is nothing to tell apart, and each message is spared a look at its key.
                one.subscribe(key_expr, receive if len(ways) == 1 else take, most)

        self._declare(declare)

    def announce(self, key: str) -> None:
        """Declare a liveliness token until the process leaves."""
        self._declare(lambda one: one.announce(key))

    def watch(self, key_expr: str, change: Callable[[str, bool], None]) -> None:
        """Call `change` with each liveliness token that exists, appears or disappears."""

        def declare(one: Connection) -> None:
            def take(key: str, is_there: bool) -> None:
                if self._is_from(one, key):
                    change(key, is_there)

            if one in self._ways(key_expr):
                one.watch(key_expr, take)

        self._declare(declare)

    def alive(self, key_expr: str, timeout: float = 1.0) -> list[str]:
        """Existing liveliness tokens."""
        asked = [(connection, connection.alive(key_expr, timeout)) for connection in self._ways(key_expr)]
        return sorted({answer.key for one, replies in asked for answer in replies if self._is_from(one, answer.key)})

    def shown(self, key_expr: str, timeout: float = 1.0) -> list[str]:
        """Liveliness tokens that the router shows, including those of this host's processes."""
        return sorted({answer.key for answer in self._outer.alive(key_expr, timeout) if answer.key})

    def serve(self, key: str, take: Callable[[Question], None], is_large: bool = False) -> None:
        """Serve queries of a key. `take` is called on the network's thread: it must pass a query on or answer at once.
        Set `is_large` if answers may be large."""
        self._declare(lambda one: one.serve(key, take, is_large))

    def ask(self, key_expr: str, data: bytes = b"", timeout: float = 2.0) -> Iterator[Answer]:
        """Query a key: the answers of all that serve it, as they arrive, for at most `timeout`, s.

        A server that received the query and does not answer in time yields the refusal TIMED_OUT. No answer at all
        means that, as far as this process knows, no one serves the key.
        """
        asked = [(connection, connection.ask(key_expr, data, timeout)) for connection in self._ways(key_expr)]
        # Asked on all ways before the first answer is read: their times of waiting overlap.
        for one, replies in asked:
            for answer in replies:
                if answer.refusal or self._is_from(one, answer.key):
                    yield answer

    def _ways(self, key_expr: str) -> tuple[Connection, ...]:
        """Connections by which a key, which may have wildcards, can be reached."""
        if self._mesh is None:
            return self._all
        place = self._place(key_expr)
        if place in self._here:
            return self._near
        if "*" not in place:
            return (self._outer,)
        # A query with * of a whole robot need not wait for a router that may hang.
        return self._near if self._is_whole else self._all

    def _is_from(self, connection: Connection, key: str) -> bool:
        """Whether messages with this key are taken from a connection."""
        return bool(key) and (self._mesh is None or (self._place(key) in self._here) == (connection is not self._outer))

    def _place(self, key: str) -> str:
        """Role and instance of a key, or "process" and a process's name, joined by "/"."""
        return "/".join(key.removeprefix(self._prefix).split("/", 2)[:2])
