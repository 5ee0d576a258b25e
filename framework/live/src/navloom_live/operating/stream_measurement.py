"""Measures a robot's streams and the clock offsets of its hosts from outside."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from navloom.messages.codec import CodecError

from navloom_live.live.description import Description, DescriptionError
from navloom_live.live.mailbox import Mailbox, Packet
from navloom_live.operating.client import REQUEST_SPACING, Client
from navloom_live.operating.introspection import tap

__all__ = ["Offset", "StreamMeter", "clock_offsets", "measure"]

ROUNDS = 5
"""Number of clock queries to each host; the fastest answer counts."""


class Offset(NamedTuple):
    """Offset of a host's wall clock from this host's; positive if it is ahead.

    Attributes:
        seconds: Estimate, s.
        uncertain: Largest error of the estimate, s: half the round-trip time.
    """

    seconds: float
    uncertain: float


@dataclass
class StreamMeter:
    """Collects statistics of a stream: arrival times and platform stamps, ns, and gaps in its sequence."""

    arrived_ns: list[int] = field(default_factory=list)
    cause_ns: list[int] = field(default_factory=list)
    size: int = 0
    lost: int = 0
    malformed: int = 0
    complaint: str = ""
    _last: int = 0

    def note(self, packet: Packet) -> None:
        """Record one message."""
        self.size += len(packet.data)
        try:
            _, envelope = packet.open()
        except CodecError as error:
            self.malformed += 1
            self.complaint = str(error)
            return
        self.arrived_ns.append(packet.arrived_ns)
        self.cause_ns.append(envelope.cause_ns)
        if self._last and envelope.sequence > self._last + 1:
            self.lost += envelope.sequence - self._last - 1
        self._last = envelope.sequence

    def summary(self, seconds: float, run_clock_ns: int | None) -> dict[str, Any]:
        """Statistics of the stream over the time of listening, in SI units.

        Args:
            seconds: Duration of listening, s.
            run_clock_ns: Run clock minus this host's monotonic clock, ns; None if it is not known.
        """
        arrived = np.array(self.arrived_ns, dtype=np.int64)
        gaps = np.diff(arrived) * 1e-9
        found: dict[str, Any] = {
            "messages": int(arrived.size),
            "rate_hz": float(1.0 / gaps.mean()) if gaps.size and gaps.sum() > 0.0 else arrived.size / seconds,
            "jitter_std_s": float(gaps.std()) if gaps.size else None,
            "interval_max_s": float(gaps.max()) if gaps.size else None,
            "age_p50_s": None,
            "age_p99_s": None,
            "bytes_per_s": self.size / seconds,
            "lost": self.lost,
            "malformed": self.malformed,
            "complaint": self.complaint,
        }
        if run_clock_ns is not None and arrived.size:
            ages = (arrived + run_clock_ns - np.array(self.cause_ns, dtype=np.int64)) * 1e-9
            found["age_p50_s"], found["age_p99_s"] = (float(np.percentile(ages, share)) for share in (50, 99))
        return found


def measure(
    client: Client, names: Sequence[str], odometry: Sequence[str], seconds: float, has_clock: bool
) -> dict[str, dict[str, Any]]:
    """Measure streams. Ctrl-C ends the listening; what was measured so far is returned.

    Args:
        client: Client of the robot.
        names: Streams as role/instance/port.
        odometry: Odometry streams of the platform. Their fastest message sets the clock offset for the ages.
        seconds: Duration, s.
        has_clock: Whether the run clock advances with real time, as it does except under a barrier.

    Returns:
        Statistics of each stream, see `StreamMeter.summary`.
    """
    mailbox, meters = Mailbox(), {name: StreamMeter() for name in names}
    taps = tap(client, list(dict.fromkeys((*names, *odometry))), mailbox)
    fastest: int | None = None
    began, seen = time.monotonic(), 0
    try:
        while (left := began + seconds - time.monotonic()) > 0.0:
            seen = mailbox.wait(seen, min(left, 0.1))
            for name, inlet in taps.items():
                for packet in inlet.packets():
                    opened = packet.try_open() if name in odometry else None
                    if opened is not None and has_clock:
                        ahead = opened[1].stamp_ns - packet.arrived_ns
                        fastest = ahead if fastest is None else max(fastest, ahead)
                    if name in meters:
                        meters[name].note(packet)
    except KeyboardInterrupt:
        pass
    listened = max(1e-3, time.monotonic() - began)
    for name, meter in meters.items():
        counts = taps[name].counts  # messages that were too large to copy
        meter.malformed += counts.malformed
        meter.complaint = counts.complaint or meter.complaint
    return {name: meter.summary(listened, fastest) for name, meter in meters.items()}


def clock_offsets(client: Client, nodes: Sequence[Description]) -> dict[str, Offset]:
    """Offset of each host's wall clock, from queries to one node of each host."""
    asked = {node.host: (node.role, node.instance) for node in nodes}
    best: dict[str, Offset] = {}
    for host, source in asked.items():
        for _ in range(ROUNDS):
            time.sleep(REQUEST_SPACING)
            before, started = time.time_ns(), time.perf_counter_ns()
            for answer in client.bus.ask(client.keys.port(*source, "describe"), timeout=1.0):
                if answer.refusal:
                    continue
                trip = time.perf_counter_ns() - started
                try:
                    wall_ns = client.described(answer).wall_ns
                except DescriptionError:
                    continue
                if wall_ns is None:
                    continue
                offset = Offset((wall_ns - before - trip / 2) * 1e-9, trip * 0.5e-9)
                if host not in best or offset.uncertain < best[host].uncertain:
                    best[host] = offset
    return best
