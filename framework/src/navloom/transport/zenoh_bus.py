"""What a process publishes, hears and asks by: the processes of its host beside it, and a router to all others."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import TracebackType
from typing import TYPE_CHECKING

from navloom.transport.connection import BusError, Connection, Way
from navloom.transport.keyspace import LARGEST
from navloom.transport.links import Link
from navloom.transport.sender import Sender
from navloom.transport.zenoh_session import TIMED_OUT, Answer, Question, Receive

if TYPE_CHECKING:  # a router starts anew in a moment if it needs neither messages nor numpy
    from navloom.transport.quality import Quality

__all__ = ["TIMED_OUT", "Answer", "Bus", "BusError", "Publication", "Question"]


class Publication:
    """A stream that this process publishes; readers within the process are served by reference, not by this."""

    def __init__(self, ways: tuple[Way, ...]) -> None:
        self._ways = ways

    @property
    def is_heard(self) -> bool:
        """Some other process hears the stream, as far as this one knows by now: else nothing need be encoded."""
        return any(way.is_heard for way in self._ways)

    def put(self, data: bytes, label: str) -> None:
        """Send a message. A link that is gone loses it, as the stream's quality allows."""
        for way in self._ways:
            way.put(data, label)


class Bus:
    """A process on a robot's network. Use it in a `with` statement: an open session hangs the process at its end.

    With a mesh (`Link.mesh`) it has two connections. Everything is published, announced and offered on both. What
    comes from an instance or process of this host is taken from the mesh alone, all else from the router alone. So
    nothing comes twice, and neither the load nor the loss of the router reaches what the host's processes say to each
    other. Where all of the robot is on this host, nothing waits for the router either.

    Args:
        link: How to join.
        patience: s to try for, where the router is not there yet.
        say: Told once that the router is waited for, and why.
        goes_on: Asked after each try that failed.
        waits: The router is waited for even where all of the robot is on this host.

    Raises:
        LinkError: A link that is refused; BusError: one that does not work.
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
        self._mesh = None if mesh is None else Connection(mesh.link)
        try:
            waits = waits or not self._is_whole
            self._outer = Connection(link, patience, say, goes_on, waits, self._sender)
        except BaseException:
            self._leave()
            raise
        self._all = tuple(one for one in (self._mesh, self._outer) if one is not None)

    def __enter__(self) -> Bus:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the network."""
        self._leave()
        self._outer.close()

    def _leave(self) -> None:
        if self._sender is not None:
            self._sender.close()
        if self._mesh is not None:
            self._mesh.close()

    @property
    def losses(self) -> int:
        """How often it lost its router and joined anew."""
        return self._outer.losses

    @property
    def moves(self) -> int:
        """How often it went over to another session without a loss."""
        return self._outer.moves

    @property
    def denials(self) -> int:
        """How often it stayed in its session, because the router did not know its new certificate."""
        return self._outer.denials

    def neighbours(self) -> int:
        """Processes this one is linked to."""
        return sum(one.neighbours() for one in self._all)

    def has_router(self) -> bool:
        """It is linked to its router."""
        return self._outer.neighbours() > 0

    def clients(self) -> int:
        """Clients that are linked to this router."""
        return self._outer.clients()

    def tell(self, key: str) -> None:
        """Send an empty message, once, that must arrive."""
        self._outer.tell(key)

    def publication(self, key: str, quality: Quality, lossless: bool = False) -> Publication:
        """A stream to publish to; lossless waits where it would drop."""
        return Publication(tuple(one.publish(key, quality, lossless) for one in self._all))

    def subscribe(self, key_expr: str, receive: Receive, most: int = LARGEST) -> None:
        """Hear a stream, or several with `*`.

        Args:
            key_expr: The streams.
            receive: Takes each message.
            most: Bytes of a message at most: a larger one is not copied.
        """
        ways = self._ways(key_expr)
        for one in ways:

            def take(key: str, data: bytes | None, label: str, one: Connection = one) -> None:
                if self._is_from(one, key):
                    receive(key, data, label)

            one.subscribe(key_expr, receive if len(ways) == 1 else take, most)

    def announce(self, key: str) -> None:
        """Show others that something is alive, until the process leaves."""
        for one in self._all:
            one.announce(key)

    def watch(self, key_expr: str, change: Callable[[str, bool], None]) -> None:
        """Be told who is alive, who comes and who goes."""
        for one in self._ways(key_expr):

            def take(key: str, is_there: bool, one: Connection = one) -> None:
                if self._is_from(one, key):
                    change(key, is_there)

            one.watch(key_expr, take)

    def alive(self, key_expr: str, timeout: float = 1.0) -> list[str]:
        """Tokens that are there."""
        asked = [(one, one.alive(key_expr, timeout)) for one in self._ways(key_expr)]
        return sorted({answer.key for one, replies in asked for answer in replies if self._is_from(one, answer.key)})

    def shown(self, key_expr: str, timeout: float = 1.0) -> list[str]:
        """Tokens that the router shows, of this host's processes too."""
        return sorted({answer.key for answer in self._outer.alive(key_expr, timeout) if answer.key})

    def serve(self, key: str, take: Callable[[Question], None], is_large: bool = False) -> None:
        """Answer questions; `take` is called on the network's thread and must only pass them on, or have at hand what
        it answers. Say so where answers may be large."""
        for one in self._all:
            one.serve(key, take, is_large)

    def ask(self, key_expr: str, data: bytes = b"", timeout: float = 2.0) -> Iterator[Answer]:
        """Answers of all who serve a key, as they come, for at most this many s.

        Whoever has the question and does not answer it in that time gives the refusal TIMED_OUT. Without any answer
        nobody serves the key, as far as this process knows.
        """
        asked = [(one, one.ask(key_expr, data, timeout)) for one in self._ways(key_expr)]
        for one, replies in asked:
            for answer in replies:
                if answer.refusal or self._is_from(one, answer.key):
                    yield answer

    def _ways(self, key_expr: str) -> tuple[Connection, ...]:
        """Connections by which a key may be reached, perhaps with wildcards."""
        if self._mesh is None:
            return self._all
        place = self._place(key_expr)
        if place in self._here:
            return (self._mesh,)
        if "*" not in place:
            return (self._outer,)
        return (self._mesh,) if self._is_whole else self._all

    def _is_from(self, one: Connection, key: str) -> bool:
        """Whether what has this key is taken from a connection."""
        return bool(key) and (self._mesh is None or (self._place(key) in self._here) == (one is self._mesh))

    def _place(self, key: str) -> str:
        """Role and instance of a key, or "process" and a process's name."""
        return "/".join(key.removeprefix(self._prefix).split("/", 2)[:2])
