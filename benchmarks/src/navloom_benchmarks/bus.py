"""The entry `bus` of `navloom bench`: round trips between two processes, compared with raw Zenoh in the same run.

`python -m navloom_benchmarks.bus PART FOLDER` runs one of the processes: `ping` sends, `echo` answers. Each holds one
end of our bus and one of each raw peer.
"""

from __future__ import annotations

import json
import queue
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from navloom.messages import Envelope, Message
from navloom_live.live.mailbox import Mailbox
from navloom_live.live.process_streams import Switchboard
from navloom_live.transport.keyspace import KeySpace
from navloom_live.transport.links import Link, peer_link, settings
from navloom_live.transport.quality_of_service import quality_of
from navloom_live.transport.zenoh_bus import Bus

from navloom_benchmarks.pairs import Block, Child, Effort, Peer, PeerError, Row, paired, peer_module
from navloom_benchmarks.samples import samples, wire_bytes, wire_size

__all__ = ["BACK", "THERE", "OurEnd", "RawEnd", "bus"]

KEYS = KeySpace("bench", "r1")
RAW = {"callback": "zenoh, raw bytes", "thread": "zenoh, raw bytes, answered on a thread"}
"""The raw peers: how the peer answers, which is also the robot name in its keys, and its name in the table."""
THERE, BACK = ("platform", "there"), ("platform", "back")
"""Role and instance of the two streams, ping to echo and back."""
DATA = "data"
PATIENCE = 2.0
"""Longest wait for an answer, s; then the trip counts as lost."""
NOTE = "wall clock; ours makes, encodes and decodes messages on a node's thread, Zenoh passes ready-made bytes"
SWITCH = 0.0005
"""Switch interval of Python threads, as in the live runtime, s; the same for all peers."""


def bus(effort: Effort, say: Callable[[str], None]) -> Iterator[Row]:
    """Round trips of 64 B and 110 KB. Raises PeerError if a process does not start."""
    with tempfile.TemporaryDirectory(prefix="nlb") as top, ExitStack() as stack:
        ends = []
        for part in ("echo", "ping"):
            command = [sys.executable, "-m", "navloom_benchmarks.bus", part, top]
            ends.append(stack.enter_context(Child(f"bus {part}", command, Path(top))))
        trips = effort.size(40, 3)

        def block(peer: str, name: str) -> Block:
            def trip() -> float:
                spent = sorted(trip_ns for trip_ns in ends[1].ask([peer, name, trips]) if trip_ns is not None)
                if not spent:
                    raise PeerError(f"bus: every one of {trips} trips of {peer} was lost")
                return float(spent[len(spent) // 2]) * 1e-9

            return trip

        for name in samples():
            say(f"bus: {name}")
            for how, called in RAW.items():
                theirs = Peer(called, block(how, name))
                yield paired(f"bus round trip {name}", "µs", block("ours", name), theirs, effort.rounds, NOTE)


class OurEnd:
    """The streams of one node as in the live runtime: an outlet, an inlet and a mailbox.

    Args:
        bus: Connection of the process.
        gives, takes: Role and instance of the published and of the received stream.
    """

    def __init__(self, bus: Bus, gives: tuple[str, str], takes: tuple[str, str]) -> None:
        board = Switchboard(bus, KEYS, lossless=False)
        self._mailbox = Mailbox()
        self._outlet = board.outlet(gives, DATA)
        self._inlet = board.inlet(takes, DATA, self._mailbox, 4)
        self._seen = 0
        board.connect()

    def give(self, message: Message) -> None:
        """Publish a message."""
        self._outlet.publish(message, 1, 0, 0, 0)

    def take(self, timeout: float) -> list[tuple[Message, Envelope]]:
        """Messages that arrive within `timeout` s, decoded, with their envelopes."""
        self._seen = self._mailbox.wait(self._seen, timeout)
        return list(self._inlet.take())

    def trip(self, message: Message) -> int | None:
        """Time of a round trip, ns, until a message of the same type is back; None if it was lost."""
        self.take(0.0)  # drop an answer that came too late
        began = time.perf_counter_ns()
        self.give(message)
        back = self.take(PATIENCE)
        spent = time.perf_counter_ns() - began
        return spent if back and type(back[-1][0]) is type(message) else None


class RawEnd:
    """Raw Zenoh as in its documentation: puts bytes with our quality of service, copies received ones in a callback.

    Args:
        link: Zenoh settings of the process.
        gives, takes: Role and instance of the published and of the received stream.
        answers: Whether received bytes are answered: "no", in the "callback", or on a separate "thread", as in a node.
    """

    def __init__(self, link: Link, gives: tuple[str, str], takes: tuple[str, str], answers: str) -> None:
        zenoh = peer_module("zenoh", "eclipse-zenoh")
        keys = KeySpace(link.realm, link.robot)
        self._waiting: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._answer)
        self._session = zenoh.open(zenoh.Config.from_json5(json.dumps(settings(link))))
        self._publishers = {
            size: self._session.declare_publisher(
                keys.port(*gives, DATA),
                congestion_control=getattr(zenoh.CongestionControl, quality_of(kind).congestion.upper()),
                priority=getattr(zenoh.Priority, quality_of(kind).priority.upper()),
            )
            for size, kind in ((wire_size(message), type(message)) for message in samples().values())
        }
        take = self._put if answers == "callback" else self._waiting.put
        handler = zenoh.handlers.Callback(lambda sample: take(sample.payload.to_bytes()), indirect=False)
        self._held = self._session.declare_subscriber(keys.port(*takes, DATA), handler)
        if answers == "thread":
            self._thread.start()

    def trip(self, data: bytes) -> int | None:
        """Time of a round trip, ns, until as many bytes are back; None if it was lost."""
        while not self._waiting.empty():
            self._waiting.get()
        began = time.perf_counter_ns()
        self._put(data)
        try:
            got = self._waiting.get(timeout=PATIENCE)
        except queue.Empty:
            return None
        spent = time.perf_counter_ns() - began
        return spent if len(got) == len(data) else None

    def close(self) -> None:
        """Close the session; an open one hangs the process at exit."""
        if self._thread.is_alive():
            self._waiting.put(b"")
            self._thread.join()
        self._session.close()

    def _answer(self) -> None:
        while data := self._waiting.get():
            self._put(data)

    def _put(self, data: bytes) -> None:
        self._publishers[len(data)].put(data)


def serve(part: str, folder: str) -> None:
    """Run one process, `ping` or `echo`, until standard input ends."""
    sys.setswitchinterval(SWITCH)
    gives, takes = (BACK, THERE) if part == "echo" else (THERE, BACK)
    with ExitStack() as stack:
        ours = OurEnd(stack.enter_context(Bus(_link(folder, part, "r1"))), gives, takes)
        raw = {}
        for how in RAW:
            raw[how] = RawEnd(_link(folder, part, how), gives, takes, how if part == "echo" else "no")
            stack.callback(raw[how].close)
        if part == "echo":
            _answer_until_the_end(ours)
        else:
            _make_trips(ours, raw)


def _link(folder: str, part: str, robot: str) -> Link:
    """The link that `navloom up` makes between two processes of one host."""
    sockets = {name: f"unixsock-stream/{folder}/{name}-{robot}" for name in ("echo", "ping")}
    return peer_link(sockets[part], sockets.values(), KEYS.realm, robot)


def _answer_until_the_end(ours: OurEnd) -> None:
    """Answer each message with another one of its type and size, on a separate thread, as a node does."""
    answers = {type(message): message for message in samples().values()}
    ending = threading.Event()

    def work() -> None:
        while not ending.is_set():
            for message, _ in ours.take(0.1):
                ours.give(answers[type(message)])

    thread = threading.Thread(target=work)
    thread.start()
    print('"ready"', flush=True)
    sys.stdin.read()
    ending.set()
    thread.join()


def _make_trips(ours: OurEnd, raw: dict[str, RawEnd]) -> None:
    messages = samples()
    data = {name: wire_bytes(message) for name, message in messages.items()}
    print('"ready"', flush=True)
    for line in sys.stdin:
        peer, name, count = json.loads(line)
        found: list[Any] = []
        for _ in range(count):
            found.append(ours.trip(messages[name]) if peer == "ours" else raw[peer].trip(data[name]))
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    serve(*sys.argv[1:])
