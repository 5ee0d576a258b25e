"""Manual driving by an operator: commands to the gate, each derived from the newest platform stamp."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from dataclasses import replace
from types import TracebackType

from navloom.messages import Command, Envelope, GateStatus, Message, Odometry, Twist2D
from navloom.messages.codec import CodecError, decode, encode, schema_label
from navloom.navigation.status_words import has_no_path, who_drives, why_stopped

from navloom_live.live.service import ENTER_UNSEEN, RELEASE, Nothing
from navloom_live.operating.client import Client, ClientError
from navloom_live.operating.introspection import last
from navloom_live.transport.quality_of_service import most_of, quality_of

__all__ = ["Driver", "limit_in_words"]

RESUMED_WAIT = 0.5
"""Longest wait for the status that a `resume` just before changes with the next tick, s: longer than a tick."""
PLATFORM_WAIT = 3.0
"""Longest wait for the platform, s."""


SAME = 0.005
"""Tolerance below which two speeds count as equal, m/s or rad/s."""


def limit_in_words(asked: Twist2D, granted: Twist2D, before: Twist2D, status: GateStatus | None) -> str:
    """How the gate limits an operator's command; empty if it grants all of it.

    Args:
        asked: The operator's command.
        granted, before: The gate's newest command and the one before it.
        status: Status of the gate; None if it is not known.
    """
    if status is not None and status.stopped:
        return "not taken yet" if has_no_path(status) else f"stopped: {why_stopped(status)[0]}"
    if status is not None and status.source != "operator":
        return who_drives(status)
    found = []
    if _apart(granted, asked) > SAME:
        found.append("acceleration" if _apart(granted, before) > SAME else "speed")
    if abs(granted.wz - asked.wz) > SAME:
        found.append("turn rate")
    return f"limited: {', '.join(found)}" if found else ""


def _apart(one: Twist2D, other: Twist2D) -> float:
    """Difference of two velocities without their turn rates, m/s."""
    return math.hypot(one.vx - other.vx, one.vy - other.vy)


class Driver:
    """Drives a live robot manually within a `with` statement, then releases it to its own navigation.

    Args:
        client: Client on the robot's network.
        enters_unseen: The gate lets it enter space that no sensor has seen, and reports that.

    Attributes:
        asked: Last command sent.
        granted, before: The gate's newest command and the one before it.
        measured: Velocity that the platform measured last.
        status: Status of the gate, or None.

    Raises:
        ClientError: No message comes from the platform, or the robot is stopped until `resume`.
    """

    def __init__(self, client: Client, enters_unseen: bool = False) -> None:
        self._client, self._enters_unseen = client, enters_unseen
        self._heard = threading.Event()
        self._newest = (-1, 0, 0.0)
        self._latched = ""
        self._sequence = 0
        self.asked = self.granted = self.before = self.measured = Twist2D(0.0, 0.0, 0.0)
        self.status: GateStatus | None = None

    def __enter__(self) -> Driver:
        keys, bus = self._client.keys, self._client.bus
        self._key = keys.port("operator", "main", "command")
        self._publication = bus.publication(self._key, quality_of(Command))
        bus.subscribe(keys.port("platform", "*", "odometry"), self._hear, most_of(Odometry))
        if not self._heard.wait(PLATFORM_WAIT):
            raise ClientError(f"robot {keys.prefix}: its platform is silent; `navloom doctor` says why")
        for port, kind in (("status", GateStatus), ("command", Command)):
            bus.subscribe(keys.port("gate", "main", port), self._hear_gate, most_of(kind))
        # The status is published on changes only: the present one must be asked for.
        self._heed(last(self._client, "gate", "main", "status"))
        until = time.monotonic() + RESUMED_WAIT
        while self._latched and time.monotonic() < until:
            time.sleep(0.02)
        self._refuse_if_latched()
        if self._enters_unseen:
            self._client.call("gate", "main", ENTER_UNSEEN, Nothing())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # A robot that is gone needs no release.
        with contextlib.suppress(ClientError):
            self._client.call("gate", "main", RELEASE, Nothing())

    def send(self, vx: float, wz_deg: float, vy: float = 0.0) -> None:
        """Command a speed, m/s, a turn rate, deg/s, and a speed to the left, m/s; nothing without platform messages.

        Raises:
            ClientError: The platform went silent, or the robot is stopped until `resume`.
        """
        stamp_ns, tick, heard = self._newest
        if time.monotonic() - heard > PLATFORM_WAIT:
            raise ClientError("the platform has gone silent; the robot has stopped by itself")
        self._refuse_if_latched()
        self._sequence += 1
        # It derives from what the operator saw last: the gate refuses it if that is too old.
        envelope = Envelope(self._key, self._sequence, tick, stamp_ns, stamp_ns, 0)
        self.asked = Twist2D(vx, vy, math.radians(wz_deg))
        self._publication.put(encode(Command(self.asked), envelope), schema_label(Command))

    @property
    def limit(self) -> str:
        """What limits the operator's command; empty if nothing does."""
        return limit_in_words(self.asked, self.granted, self.before, self.status)

    def _refuse_if_latched(self) -> None:
        if self._latched:
            raise ClientError(f"robot {self._client.keys.prefix} is stopped: {self._latched}")

    def _hear_gate(self, key: str, data: bytes | None, label: str) -> None:
        with contextlib.suppress(CodecError):
            if data is not None:
                self._heed(decode(data, label)[0])

    def _heed(self, said: Message | None) -> None:
        if isinstance(said, Command):
            self.before, self.granted = self.granted, said.twist
        elif isinstance(said, GateStatus):
            self.status = said
            # Also while it still brakes, when it is not stopped yet.
            self._latched = "; ".join(why_stopped(replace(said, stopped=True))) if said.latched else ""

    def _hear(self, key: str, data: bytes | None, label: str) -> None:
        with contextlib.suppress(CodecError):
            if data is not None:
                message, envelope = decode(data, label)
                if isinstance(message, Odometry):
                    self.measured = message.twist
                self._newest = (envelope.stamp_ns, envelope.tick, time.monotonic())
                self._heard.set()
