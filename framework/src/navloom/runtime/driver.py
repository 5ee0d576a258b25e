"""An operator's own driving: commands to the gate, each made on a platform stamp that was just heard."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from types import TracebackType

from navloom.messages import Command, Envelope, GateStatus, Message, Twist2D
from navloom.messages.codec import CodecError, decode, encode, schema_label
from navloom.runtime.client import Client, ClientError
from navloom.runtime.looking import why_stopped
from navloom.runtime.quality import quality_of

__all__ = ["Driver"]

HEAR = 3.0
"""s to wait for the platform."""


class Driver:
    """Drives a live robot by hand, in a `with` statement; at its end the robot is left to itself.

    Args:
        client: On the robot's network.

    Raises:
        ClientError: The platform is not heard, or the robot stands until `resume`.
    """

    def __init__(self, client: Client) -> None:
        self._client = client
        self._heard = threading.Event()
        self._newest = (-1, 0, 0.0)
        self._latched = ""
        self._sequence = 0

    def __enter__(self) -> Driver:
        keys, bus = self._client.keys, self._client.bus
        self._key = keys.port("operator", "main", "command")
        self._publication = bus.publication(self._key, quality_of(Command))
        bus.subscribe(keys.port("platform", "*", "odometry"), self._hear)
        if not self._heard.wait(HEAR):
            raise ClientError(f"robot {keys.prefix}: its platform is not heard; `navloom doctor` says why")
        bus.subscribe(keys.port("gate", "main", "status"), self._hear_gate)
        self._heed(self._client.last("gate", "main", "status"))
        self._refuse_where_it_stands()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(ClientError):
            self._client.call("gate", "main", "release", {})

    def send(self, vx: float, wz_deg: float) -> None:
        """Ask for a speed, m/s, and a turn rate, deg/s. Without the platform nothing is sent, and the gate stops it."""
        stamp_ns, tick, heard = self._newest
        if time.monotonic() - heard > HEAR:
            raise ClientError("the platform is not heard any more; the robot has stopped by itself")
        self._refuse_where_it_stands()
        self._sequence += 1
        envelope = Envelope(self._key, self._sequence, tick, stamp_ns, stamp_ns, 0)
        message = Command(Twist2D(vx, 0.0, math.radians(wz_deg)))
        self._publication.put(encode(message, envelope), schema_label(Command))

    def _refuse_where_it_stands(self) -> None:
        if self._latched:
            raise ClientError(f"robot {self._client.keys.prefix} stands: {self._latched}")

    def _hear_gate(self, key: str, data: bytes | None, label: str) -> None:
        with contextlib.suppress(CodecError):
            if data is not None:
                self._heed(decode(data, label)[0])

    def _heed(self, status: Message | None) -> None:
        if isinstance(status, GateStatus):
            self._latched = "; ".join(why_stopped(status)) if status.latched else ""

    def _hear(self, key: str, data: bytes | None, label: str) -> None:
        with contextlib.suppress(CodecError):
            if data is not None:
                envelope = decode(data, label)[1]
                self._newest = (envelope.stamp_ns, envelope.tick, time.monotonic())
                self._heard.set()
