"""The protocol between a base and its driver: frames that survive noise, and their contents. Bytes in, values out.

A frame is `AA 55`, length of the body, body, CRC-16 of length and body (CCITT: polynomial 0x1021, initial value
0xFFFF), little endian. The first byte of the body is its type:

- 0x01, to the base: speeds of the left and the right wheel, mm/s. A base that receives none for `WATCHDOG` s stops.
- 0x81, from the base every 20 ms: uptime, ms; ticks of the left and the right encoder, which wrap; flags; battery, mV.
"""

import binascii
import struct
from dataclasses import dataclass

START = b"\xaa\x55"
SPEEDS, STATUS = struct.Struct("<Bhh"), struct.Struct("<BIiiBH")
TO_BASE, FROM_BASE = 0x01, 0x81
EMERGENCY_STOP, BUMPER, STOPPED_ITSELF = 1, 2, 4
"""Flags of a status."""
WATCHDOG = 0.25
"""Time without speeds after which a base stops by itself, s."""
TICKS = 1 << 32
"""Number at which encoder counts and the uptime wrap."""
LONGEST = 64
"""Longest body, bytes."""


@dataclass(frozen=True)
class Status:
    """Status of the base; see the top of this module for the units."""

    uptime_ms: int
    left: int
    right: int
    flags: int
    battery_mv: int


def framed(body: bytes) -> bytes:
    """A frame around a body."""
    counted = bytes([len(body)]) + body
    return START + counted + struct.pack("<H", binascii.crc_hqx(counted, 0xFFFF))


def speeds(left: float, right: float) -> bytes:
    """The frame that sets the wheels' speeds, m/s."""
    return framed(SPEEDS.pack(TO_BASE, *(max(-32767, min(32767, round(1000.0 * one))) for one in (left, right))))


def status(given: Status) -> bytes:
    """The frame that reports a status."""
    values = (given.uptime_ms % TICKS, signed(given.left), signed(given.right), given.flags, given.battery_mv)
    return framed(STATUS.pack(FROM_BASE, *values))


def signed(count: int) -> int:
    """A count wrapped to a signed 32-bit number, as an encoder counts."""
    return (count + TICKS // 2) % TICKS - TICKS // 2


class Frames:
    """Finds frames in the bytes of a line, with any noise between them. It never keeps more than one frame.

    Attributes:
        refused: Number of bytes that were part of no frame.
    """

    def __init__(self) -> None:
        self.refused = 0
        self._held = b""

    def clear(self) -> None:
        """Drop an incomplete frame."""
        self._held = b""

    def take(self, data: bytes) -> list[bytes]:
        """Bodies of the frames that end in the data."""
        found, held = [], self._held + data
        while True:
            start = held.find(START)
            if start < 0:
                keep = 1 if held.endswith(START[:1]) else 0
                self.refused += len(held) - keep
                self._held = held[len(held) - keep :]
                return found
            self.refused += start
            held = held[start:]
            size = held[2] if len(held) > 2 else 0
            if size > LONGEST:
                held, self.refused = held[1:], self.refused + 1
                continue
            if len(held) < size + 5:
                self._held = held
                return found
            counted, crc = held[2 : size + 3], held[size + 3 : size + 5]
            if struct.pack("<H", binascii.crc_hqx(counted, 0xFFFF)) == crc:
                found.append(counted[1:])
                held = held[size + 5 :]
            else:  # noise that looks like a start: the real one may be inside
                held, self.refused = held[1:], self.refused + 1


def status_of(body: bytes) -> Status | None:
    """The status in a body; None if the body is of another type."""
    if len(body) != STATUS.size or body[0] != FROM_BASE:
        return None
    return Status(*STATUS.unpack(body)[1:])


def speeds_of(body: bytes) -> tuple[float, float] | None:
    """The speeds of the wheels in a body, m/s; None if the body is of another type."""
    if len(body) != SPEEDS.size or body[0] != TO_BASE:
        return None
    left, right = SPEEDS.unpack(body)[1:]
    return left / 1000.0, right / 1000.0
