"""The two processes of one peer over Zenoh, for `wire`: `python zenoh_ends.py PEER PART FOLDER SOCKET`.

PART is `ping` or `echo`. Every peer uses the link and the settings of two processes of a robot on one host.

| peer | does |
|---|---|
| ours | `Outlet.publish`, mailbox and thread of the other process, decode, `Outlet.publish` of the answer, decode |
| zenoh | a put of prepared bytes; a callback copies the received ones and immediately puts as many |
| zenoh-thread | the same, but the callback queues the bytes and a thread answers, as in a node |
| zenoh-default | as `zenoh-thread`, with Zenoh's default threads instead of those of the live runtime |
| zenoh-shared | as `zenoh`, with shared memory |
"""

from __future__ import annotations

import json
import queue
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import zenoh
from navloom.messages import MapUpdate, Message
from navloom_benchmarks.bus import BACK, THERE, OurEnd
from navloom_live.transport.keyspace import KeySpace
from navloom_live.transport.links import Link, peer_link, settings
from navloom_live.transport.quality_of_service import quality_of
from navloom_live.transport.zenoh_bus import Bus
from samples import samples, wire_bytes
from trips import PATIENCE, Lost, Trip, as_the_runtime_does, serve_trips, wait_for_the_end

KEYS = KeySpace("bench", "r1")
DATA = "data"
_CONGESTION = {
    "drop": zenoh.CongestionControl.DROP,
    "block": zenoh.CongestionControl.BLOCK,
    "block_first": zenoh.CongestionControl.BLOCK_FIRST,
}


def link_of(folder: str, part: str, is_shared: bool = False) -> Link:
    """Link two processes of one host as `up` does, with or without shared memory."""
    sockets = {name: f"unixsock-stream/{folder}/{name}.sock" for name in ("echo", "ping")}
    return peer_link(sockets[part], sockets.values(), KEYS.realm, KEYS.robot, is_shared)


@contextmanager
def our_ping(link: Link) -> Iterator[Trip]:
    """A function that publishes a message and waits for its answer, decoded."""
    messages = samples()
    with Bus(link) as bus:
        end = OurEnd(bus, THERE, BACK)

        def trip(name: str) -> int:
            message = messages[name]
            end.take(0.0)  # drop an answer that came too late
            began = time.perf_counter_ns()
            end.give(message)
            back = end.take(PATIENCE)
            spent = time.perf_counter_ns() - began
            if not back or _shape(back[-1][0]) != _shape(message):
                raise Lost
            return spent

        yield trip


def our_echo(link: Link, report: Callable[[], None]) -> None:
    """Answer each message with another of its type and size, on a separate thread."""
    answers = {_shape(message): message for message in samples().values()}
    ending = threading.Event()
    with Bus(link) as bus:
        end = OurEnd(bus, BACK, THERE)

        def work() -> None:
            while not ending.is_set():
                for message, _ in end.take(0.1):
                    end.give(answers[_shape(message)])

        thread = threading.Thread(target=work)
        thread.start()
        report()
        ending.set()
        thread.join()


def _shape(message: Message) -> tuple[Any, ...]:
    return type(message), message.grid.cells.shape if isinstance(message, MapUpdate) else ()


class RawEnd:
    """A publisher per message, with the quality of service of our runtime, and a subscriber."""

    def __init__(
        self, session: Any, gives: tuple[str, str], takes: tuple[str, str], take: Callable[[Any], Any]
    ) -> None:
        self.payloads = {name: wire_bytes(message) for name, message in samples().items()}
        self.sizes = {name: len(payload) for name, payload in self.payloads.items()}
        self.publishers = {
            name: session.declare_publisher(
                KEYS.port(*gives, DATA),
                congestion_control=_CONGESTION[quality_of(type(message)).congestion],
                priority=getattr(zenoh.Priority, quality_of(type(message)).priority.upper()),
            )
            for name, message in samples().items()
        }
        handler = zenoh.handlers.Callback(take, indirect=False)
        self._held = session.declare_subscriber(KEYS.port(*takes, DATA), handler)

    def put(self, name: str) -> None:
        """Send the bytes of the message with a name."""
        self.publishers[name].put(self.payloads[name])


@contextmanager
def raw_session(link: Link) -> Iterator[Any]:
    """A Zenoh session with the settings of the live runtime."""
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings(link)))) as session:
        yield session


@contextmanager
def raw_ping(link: Link) -> Iterator[Trip]:
    """A function that puts bytes and waits for the bytes of the answer."""
    back: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    with raw_session(link) as session:
        end = RawEnd(session, THERE, BACK, lambda sample: back.put(sample.payload.to_bytes()))

        def trip(name: str) -> int:
            while not back.empty():
                back.get()
            began = time.perf_counter_ns()
            end.put(name)
            try:
                got = back.get(timeout=PATIENCE)
            except queue.Empty:
                raise Lost from None
            spent = time.perf_counter_ns() - began
            if len(got) != end.sizes[name]:
                raise Lost
            return spent

        yield trip


def raw_echo(link: Link, has_thread: bool, report: Callable[[], None]) -> None:
    """Answer bytes with as many other bytes, in the callback or on a thread."""
    names: dict[int, str] = {}
    waiting: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()

    def answer(sample: Any) -> None:
        end.put(names[len(sample.payload.to_bytes())])

    def work() -> None:
        while (data := waiting.get()) is not None:
            end.put(names[len(data)])

    take = (lambda sample: waiting.put(sample.payload.to_bytes())) if has_thread else answer
    with raw_session(link) as session:
        end = RawEnd(session, BACK, THERE, take)
        names |= {size: name for name, size in end.sizes.items()}
        thread = threading.Thread(target=work)
        thread.start()
        report()
        waiting.put(None)
        thread.join()


def main(peer: str, part: str, folder: str, socket: str) -> None:
    """Run one end until the benchmark ends."""
    as_the_runtime_does()
    link, end = link_of(folder, part, peer == "zenoh-shared"), f"{peer} {part}"

    def report() -> None:
        wait_for_the_end(socket, end)

    if part == "ping":
        with our_ping(link) if peer == "ours" else raw_ping(link) as trip:
            serve_trips(socket, end, trip)
    elif peer == "ours":
        our_echo(link, report)
    else:
        raw_echo(link, peer in ("zenoh-thread", "zenoh-default"), report)


if __name__ == "__main__":
    main(*sys.argv[1:])
