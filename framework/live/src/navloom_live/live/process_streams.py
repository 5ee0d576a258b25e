"""A process's streams: connects its nodes' inputs to nodes of the same process or to the network."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from navloom.engine.catalogue import FRAMEWORK, Catalogue
from navloom.messages import Message

from navloom_live.live.mailbox import Inlet, Mailbox, Packet
from navloom_live.live.node_output import Outlet
from navloom_live.transport.keyspace import KeySpace
from navloom_live.transport.quality_of_service import PARAMETERS, is_retained, kind_of, most_of, retained_ports
from navloom_live.transport.query_limits import TOO_MANY
from navloom_live.transport.zenoh_bus import Bus

__all__ = ["Switchboard"]

RETAINED_RETRY_INTERVAL, RETAINED_RETRIES = 0.03, 5
"""Time between two queries for a retained message, s, and the number of retries if no answer comes or too many queries
are made: a router drops queries that come too soon after another of their kind, see `access.PACES`."""


class Switchboard:
    """Makes inlets and outlets, then connects them.

    Args:
        bus: The process's session.
        keys: Keys of the robot.
        lossless: No stream may drop a message.
        age: Age of a Platform stamp, s; None if it is not known.
        catalogue: The robot's nodes and streams.
    """

    def __init__(
        self,
        bus: Bus,
        keys: KeySpace,
        lossless: bool,
        age: Callable[[int], float | None] | None = None,
        catalogue: Catalogue = FRAMEWORK,
    ) -> None:
        self.bus, self.keys, self.lossless, self.catalogue = bus, keys, lossless, catalogue
        self._age = age
        self._inlets: dict[str, list[Inlet]] = {}
        self._kinds: dict[str, type[Message] | None] = {}
        self._outlets: dict[str, Outlet] = {}
        self._connected: set[str] = set()

    def inlet(
        self, source: tuple[str, str], port: str, mailbox: Mailbox, limit: int | None, rings: bool = True
    ) -> Inlet:
        """A reader of a stream. Without loss it has no limit and always rings."""
        key, is_lossless = self.keys.port(*source, port), self.lossless
        inlet = Inlet(
            key, mailbox, None if is_lossless else limit, self._age, source[0] == "platform", rings or is_lossless
        )
        self._inlets.setdefault(key, []).append(inlet)
        self._kinds[key] = kind_of(source[0], port, self.catalogue)
        return inlet

    def outlet(self, source: tuple[str, str], port: str) -> Outlet:
        """The outlet of a stream that this process publishes."""
        key = self.keys.port(*source, port)
        if key in self._outlets:
            return self._outlets[key]
        declared = self.catalogue.port(source[0], port)
        outlet = self._outlets[key] = Outlet(
            key,
            self.bus,
            self.lossless,
            is_retained(source[0], port, self.catalogue),
            None if declared is None else declared.quality,
        )
        kind = kind_of(source[0], port, self.catalogue)
        if kind is not None:
            outlet.prepare(kind)
        return outlet

    def connect(self) -> None:
        """Connect every inlet to its stream: by reference within the process, otherwise over the bus.

        After more inlets were made, it connects those.
        """
        # A copy: an added instance makes further inlets on another thread.
        for key, inlets in [*self._inlets.items()]:
            if key in self._outlets:
                self._outlets[key].readers = inlets
            elif key not in self._connected:
                self._connected.add(key)
                self.bus.subscribe(key, self._receive, most_of(self._kinds[key]))

    def fetch(self, source: tuple[str, str]) -> None:
        """Query an instance that came up for the last messages of its retained streams."""
        role, _ = source
        for port in (PARAMETERS, *(port for _, port in retained_ports(role, self.catalogue))):
            key = self.keys.port(*source, port)
            if key in self._inlets and key not in self._outlets:
                self._fetch(key)

    def _fetch(self, key: str) -> None:
        """Query one stream's last message; retry a few times if there is no answer or there are too many queries."""
        for pause in (*[RETAINED_RETRY_INTERVAL] * RETAINED_RETRIES, 0.0):
            # Before the query: newer messages of the stream may overtake the answer.
            asked_ns, answers = time.monotonic_ns(), list(self.bus.ask(key))
            for answer in answers:
                if not answer.refusal:
                    self._receive(answer.key, answer.data, answer.label, asked_ns)
            if answers and not any(answer.refusal == TOO_MANY for answer in answers):
                return
            time.sleep(pause)

    def inlets(self) -> Iterable[tuple[str, list[Inlet]]]:
        """Every stream that this process reads, with its readers."""
        return self._inlets.items()

    def _receive(self, key: str, data: bytes | None, label: str, asked_ns: int = 0) -> None:
        inlets = self._inlets.get(key, ())
        if data is None:
            kind = self._kinds.get(key)
            carries = "no message" if kind is None else f"no {kind.__name__}"
            for inlet in inlets:
                inlet.refuse(f"{carries} is larger than {most_of(kind)} bytes")
            return
        packet = Packet(data, label, key, self._kinds.get(key), asked_ns)
        for inlet in inlets:
            inlet.give(packet)
