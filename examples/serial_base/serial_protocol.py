"""The bytes between a base and its driver: frames that survive noise, and what is in them. Bytes in, values out.

A frame is `AA 55`, length of the body, body, CRC-16 of length and body (CCITT: polynomial 0x1021, begins with 0xFFFF),
little endian. The body's first byte says what it is:

- 0x01, to the base: speeds of the left and the right wheel, mm/s. A base that gets none for `WATCHDOG` s stops.
- 0x81, from the base every 20 ms: uptime, ms; ticks of the left and the right encoder, which wrap; flags; battery, mV.
"""

import binascii
import struct
from dataclasses import dataclass

START = b"\xaa\x55"
SPEEDS, STATUS = struct.Struct("<Bhh"), struct.Struct("<BIiiBH")
TO_BASE, FROM_BASE = 0x01, 0x81
EMERGENCY_STOP, BUMPER, STOPPED_ITSELF = 1, 2, 4
WATCHDOG = 0.25
TICKS = 1 << 32
LONGEST = 64


@dataclass(frozen=True)
class Status:
    """What the base says of itself."""

    uptime_ms: int
    left: int
    right: int
    flags: int
    battery_mv: int


def framed(body: bytes) -> bytes:
    """A frame round a body."""
    counted = bytes([len(body)]) + body
    return START + counted + struct.pack("<H", binascii.crc_hqx(counted, 0xFFFF))


def speeds(left: float, right: float) -> bytes:
    """The frame that sets the wheels' speeds, m/s."""
    return framed(SPEEDS.pack(TO_BASE, *(max(-32767, min(32767, round(1000.0 * one))) for one in (left, right))))


def status(given: Status) -> bytes:
    """The frame of a status."""
    values = (given.uptime_ms % TICKS, signed(given.left), signed(given.right), given.flags, given.battery_mv)
    return framed(STATUS.pack(FROM_BASE, *values))


def signed(count: int) -> int:
    """A count as the 32 bits of an encoder hold it."""
    return (count + TICKS // 2) % TICKS - TICKS // 2


class Frames:
    """Finds frames in what a line gives, whatever is between them. It never keeps more than a frame's bytes.

    Attributes:
        refused: Bytes that were part of no frame.
    """

    def __init__(self) -> None:
        self.refused = 0
        self._held = b""

    def clear(self) -> None:
        """Forget a frame that was half read."""
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
    """The status in a body; None where it is something else."""
    if len(body) != STATUS.size or body[0] != FROM_BASE:
        return None
    return Status(*STATUS.unpack(body)[1:])


def speeds_of(body: bytes) -> tuple[float, float] | None:
    """The speeds of the wheels in a body, m/s; None where it is something else."""
    if len(body) != SPEEDS.size or body[0] != TO_BASE:
        return None
    left, right = SPEEDS.unpack(body)[1:]
    return left / 1000.0, right / 1000.0
