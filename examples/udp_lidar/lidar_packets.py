"""The datagrams of a lidar: a scan consists of several, which may be lost, late or duplicated. Bytes in, arrays out.

A datagram is `NLDR`, version 1, and, little endian: number of the scan (16 bits), index of the datagram in the scan and
number of its datagrams (8 bits each), the device's clock in µs at the first beam of the datagram (32 bits, wraps),
first bearing and step in 1/100 degree (16 bits each, signed), duration of a beam in ns (32 bits), number of beams (16
bits), then one range per beam in mm (16 bits each): 0 is no measurement, 65535 no echo.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

HEAD = struct.Struct("<4sBHBBIhhIH")
MAGIC, VERSION = b"NLDR", 1
NO_ECHO = 65535
"""Range of a beam without an echo."""
MOST_BEAMS = 720
"""Most beams of a datagram."""
LATE_NS = 200_000_000
"""Silence after which a lower number of a scan means a restart of the lidar, ns."""
CLOCK_NS = 2**32 * 1000
"""Time at which the device's clock wraps, ns."""


class BadPacket(ValueError):
    """A datagram that is not valid for this lidar."""


@dataclass(frozen=True, eq=False)
class Packet:
    """Part of a scan: for each beam its bearing, rad, time after `device_ns`, s, and range, m, NaN if not measured."""

    scan: int
    number: int
    count: int
    device_ns: int
    bearings: NDArray[np.float64]
    times: NDArray[np.float64]
    ranges: NDArray[np.float64]


def packet_of(data: bytes) -> Packet:
    """The contents of a datagram. Raises BadPacket if it is not valid."""
    if len(data) < HEAD.size:
        raise BadPacket(f"{len(data)} bytes, expected at least {HEAD.size}")
    magic, version, scan, number, count, clock, first, step, beam_ns, beams = HEAD.unpack_from(data)
    if magic != MAGIC or version != VERSION:
        raise BadPacket(f"begins with {data[:5]!r}, expected {MAGIC!r} and version {VERSION}")
    if not (number < count and 0 < beams <= MOST_BEAMS and len(data) == HEAD.size + 2 * beams):
        raise BadPacket(f"datagram {number} of {count} with {beams} beams in {len(data)} bytes")
    raw = np.frombuffer(data, "<u2", beams, HEAD.size).astype(np.float64)
    ranges = np.where(raw == NO_ECHO, np.inf, np.where(raw == 0, np.nan, raw / 1000.0))
    places = np.arange(beams, dtype=np.float64)
    bearings = np.radians((first + step * places) / 100.0)
    return Packet(scan, number, count, clock * 1000, bearings, places * beam_ns * 1e-9, ranges)


def packets_of(
    scan: int, clock_us: int, first_deg: float, step_deg: float, beam_ns: int, ranges: NDArray[np.float64], parts: int
) -> Iterator[bytes]:
    """The datagrams of a scan, for tests and for simulating a lidar."""
    at = 0
    for number, part in enumerate(np.array_split(ranges, parts)):
        raw = np.where(np.isinf(part), NO_ECHO, np.round(1000.0 * np.nan_to_num(part, posinf=0.0)))
        clock = (clock_us + at * beam_ns // 1000) % 2**32
        bearing = round(100.0 * (first_deg + step_deg * at))
        head = HEAD.pack(MAGIC, VERSION, scan % 65536, number, parts, clock, bearing, round(100.0 * step_deg), beam_ns,
                         len(part))  # fmt: skip
        yield head + raw.astype("<u2").tobytes()
        at += len(part)


class Scans:
    """Assembles scans from datagrams. A scan ends when it is complete, or at the first datagram of the next one.

    Attributes:
        lost: Number of datagrams missing from ended scans.
        refused: Number of datagrams that were invalid, duplicated or too late.
    """

    def __init__(self) -> None:
        self.lost = self.refused = 0
        self._parts: dict[int, Packet] = {}
        self._scan = self._whole = -1
        self._heard_ns = -LATE_NS

    def take(self, data: bytes, now_ns: int) -> list[list[Packet]]:
        """The scans that end with this datagram, each as its datagrams in order; a scan may lack some."""
        try:
            packet = packet_of(data)
        except BadPacket:
            self.refused += 1
            return []
        ended = []
        if packet.scan != self._scan:
            # After a silence, a lower number means that the lidar restarted, not that the datagram is late.
            if now_ns - self._heard_ns < LATE_NS and 0 < (self._scan - packet.scan) % 65536 < 32768:
                self.refused += 1
                return []
            ended += self._end()
            self._scan, self._whole = packet.scan, -1
        self._heard_ns = now_ns
        if packet.number in self._parts or packet.scan == self._whole:
            self.refused += 1
            return ended
        self._parts[packet.number] = packet
        if len(self._parts) == packet.count:
            ended += self._end()
            self._whole = packet.scan
        return ended

    def _end(self) -> list[list[Packet]]:
        parts = [self._parts[number] for number in sorted(self._parts)]
        self._parts = {}
        if not parts:
            return []
        self.lost += parts[0].count - len(parts)
        return [parts]
