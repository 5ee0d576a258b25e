"""Subscribes programs outside a live robot to its streams."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import NamedTuple

from navloom.messages import Message
from navloom.messages.codec import CodecError
from navloom.plugins.message_opening import OPENER

from navloom_live.live.mailbox import Inlet, Mailbox
from navloom_live.operating.client import Client
from navloom_live.operating.introspection import tap
from navloom_live.transport.quality_of_service import is_retained

__all__ = ["Listening", "Told"]


class Told(NamedTuple):
    """A message of a robot.

    Attributes:
        role, instance, port: The stream that it came from.
        message: The message itself.
        stamp_ns: Time of the step on the run clock, ns.
    """

    role: str
    instance: str
    port: str
    message: Message
    stamp_ns: int


class Listening:
    """Subscription to some streams of a live robot.

    Args:
        client: Client of the robot.
        streams: Each as role/port, for every instance, or as role/instance/port; messages retained for late joiners
            come first.
        limit: Most waiting messages of a stream; beyond it the oldest is dropped.
    """

    def __init__(self, client: Client, streams: Sequence[str], limit: int = 4096) -> None:
        self._client, self._limit = client, limit
        self._mailbox = Mailbox()
        self._seen = 0
        self._inlets: dict[str, Inlet] = {}
        self._first: list[Told] = []
        self.add(streams)

    def add(self, streams: Sequence[str]) -> None:
        """Subscribe to further streams; those that it has already are left out."""
        parts = [stream.split("/") for stream in streams]
        keys = [key for key in ("/".join((one[0], *(one[1:-1] or "*"), one[-1])) for one in parts)
                if key not in self._inlets]  # fmt: skip
        self._inlets |= tap(self._client, keys, self._mailbox, self._limit)
        self._first += [told for key in keys for told in self._kept(*key.split("/"))]

    def take(self, timeout: float) -> list[Told]:
        """Messages since the last call, grouped by stream, oldest first; waits at most `timeout` seconds for one."""
        found, self._first = self._first, []
        if not found:
            self._seen = self._mailbox.wait(self._seen, timeout)
        for inlet in self._inlets.values():
            for message, envelope in inlet.take():
                found.append(Told(*self._client.keys.split(envelope.key), message, envelope.stamp_ns))
        return found

    def _kept(self, role: str, instance: str, port: str) -> list[Told]:
        if not is_retained(role, port):
            return []
        found = []
        for answer in self._client.bus.ask(self._client.keys.port(role, instance, port), timeout=1.0):
            with contextlib.suppress(CodecError):
                if not answer.refusal:
                    message, envelope = OPENER.open(answer.data, answer.label)
                    found.append(Told(*self._client.keys.split(answer.key), message, envelope.stamp_ns))
        return found
