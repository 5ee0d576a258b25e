"""The record of a robot's motors: each word they got, what the robot did and when; and what it says of a fault.

Times are ns of this machine's monotonic clock, the same for all its processes.
"""

from __future__ import annotations

import itertools
import math
import struct
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

__all__ = ["ADVANCE", "DRIVE", "RECORD", "START", "Line", "MotorRecord", "old_words", "ran_on"]

RECORD = "NAVLOOM_MOTOR_RECORD"
"""Environment variable: file of the record."""
DRIVE, ADVANCE, START = 1, 2, 3
"""A word to the motors, a tick driven, and the beginning of a new process."""
STILL = 1e-3
"""m/s and rad/s below which the robot stands."""
_FORM = struct.Struct("<BBxxiq7d")


class Line(NamedTuple):
    """One entry.

    Attributes:
        kind: DRIVE, ADVANCE or START.
        touching: The robot touches something; ADVANCE only, as all that follows `wz`.
        pid: Of the platform's process.
        time_ns: When.
        vx, wz: The word, m/s and rad/s.
        x, y: True place, m, map frame.
        speed, turn: True velocity, m/s and rad/s.
        clearance: To the nearest wall, m.
    """

    kind: int
    touching: bool
    pid: int
    time_ns: int
    vx: float
    wz: float
    x: float
    y: float
    speed: float
    turn: float
    clearance: float

    def bytes(self) -> bytes:
        """As it lies in the file."""
        return _FORM.pack(*self)

    @property
    def turns(self) -> bool:
        """The motors are told to turn."""
        return bool(self.vx or self.wz)

    @property
    def stands(self) -> bool:
        """The robot stands."""
        return max(abs(self.speed), abs(self.turn)) < STILL


def ran_on(words: Sequence[Line]) -> float:
    """Longest time that motors went on with one and the same word, s, before they got another, or zero.

    A healthy chain gives a new word each tick, which slip makes different from the last; one that comes again is the
    same old command, sent again. A process of its own has motors of its own: nothing runs on from one to the next.

    Args:
        words: DRIVE and START entries in order of time.
    """
    longest, since = 0, None
    for word, after in itertools.pairwise(words):
        if word.kind == START or not word.turns:
            since = None
            continue
        since = word.time_ns if since is None else since
        if after.kind == START:
            since = None
        elif (after.vx, after.wz) != (word.vx, word.wz):
            longest, since = max(longest, after.time_ns - since), None
    return longest * 1e-9


def old_words(words: Sequence[Line], since_ns: int) -> int:
    """How many words after a time turned the motors just as an earlier one had, with another one in between.

    Slip makes each word of a healthy chain differ from all before: such a word is an old command that was let in.
    """
    seen: set[tuple[float, float]] = set()
    last, found = (0.0, 0.0), 0
    for word in words:
        twist = (word.vx, word.wz)
        if word.turns and twist != last:
            found += word.time_ns > since_ns and twist in seen
            seen.add(twist)
        last = twist
    return found


class MotorRecord:
    """Reads a record as it grows.

    Attributes:
        words: DRIVE and START entries.
        ticks: ADVANCE entries.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._read = 0
        self._lock = threading.Lock()  # its readers are the driver's thread and the test's
        self.words: list[Line] = []
        self.ticks: list[Line] = []

    def look(self) -> MotorRecord:
        """Take in what was added."""
        with self._lock:
            if not self._path.exists():
                return self
            with self._path.open("rb") as file:
                file.seek(self._read)
                data = file.read()
            data = data[: len(data) - len(data) % _FORM.size]
            self._read += len(data)
            for values in _FORM.iter_unpack(data):
                line = Line(values[0], bool(values[1]), *values[2:])
                (self.ticks if line.kind == ADVANCE else self.words).append(line)
        return self

    def speed(self, words: int = 1) -> float:
        """Least forward speed, m/s, in the newest so many words; 0 where there are fewer."""
        newest = self.look().words[-words:]
        return min(word.vx for word in newest) if len(newest) == words else 0.0

    @property
    def place(self) -> tuple[float, float]:
        """True place, m."""
        return (self.ticks[-1].x, self.ticks[-1].y) if self.look().ticks else (math.nan, math.nan)

    @property
    def touched(self) -> bool:
        """It touched something, at any time."""
        return any(tick.touching for tick in self.look().ticks)

    def between(self, begin_ns: int, end_ns: int) -> list[Line]:
        """DRIVE and START entries of a time."""
        return [word for word in self.look().words if begin_ns <= word.time_ns <= end_ns]

    def zero_after(self, time_ns: int) -> Line | None:
        """The first word to stand, or the first life of a process, after a time."""
        return next((word for word in self.look().words if word.time_ns > time_ns and not word.turns), None)

    def turn_after(self, time_ns: int) -> Line | None:
        """The first word to turn after a time."""
        return next((word for word in self.look().words if word.time_ns > time_ns and word.turns), None)

    def standing_after(self, time_ns: int) -> Line | None:
        """The first tick in which the robot stands, after a time."""
        return next((tick for tick in self.look().ticks if tick.time_ns >= time_ns and tick.stands), None)
