"""The record of a robot's motors, each command and true state with its time, and measurements of faults from it.

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

__all__ = ["ADVANCE", "DRIVE", "RECORD", "START", "Line", "MotorRecord", "longest_gap", "old_words", "ran_on"]

RECORD = "NAVLOOM_MOTOR_RECORD"
"""Environment variable: file of the record."""
DRIVE, ADVANCE, START = 1, 2, 3
"""Kinds of entry: a command to the motors, a tick driven, and the start of a new process."""
STILL = 1e-3
"""Speed below which the robot is stopped, m/s and rad/s."""
_FORM = struct.Struct("<BBxxiq7d")


class Line(NamedTuple):
    """One entry.

    Attributes:
        kind: DRIVE, ADVANCE or START.
        touching: The robot touches something; set in ADVANCE entries only, like all fields after `wz`.
        pid: Process of the platform.
        time_ns: Time of the entry.
        vx, wz: The command, m/s and rad/s.
        x, y: True place, m, map frame.
        speed, turn: True velocity, m/s and rad/s.
        clearance: Distance to the nearest wall, m.
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
        """The entry as in the file."""
        return _FORM.pack(*self)

    @property
    def turns(self) -> bool:
        """Whether the command turns the motors."""
        return bool(self.vx or self.wz)

    @property
    def stands(self) -> bool:
        """Whether the robot is stopped."""
        return max(abs(self.speed), abs(self.turn)) < STILL


def ran_on(words: Sequence[Line], end_ns: int) -> float:
    """Longest time that the motors repeated one command, s, until another command, a stop or the end.

    A healthy chain gives a new command each tick, which slip makes different from the last; an equal one is the old
    command, sent again. Each process has its own motors: no command carries over from one process to the next, so the
    last one of a process counts until it was last sent.

    Args:
        words: DRIVE and START entries in order of time.
        end_ns: Time of the look, until which the last command is in effect.
    """
    runs = [list(run) for _, run in itertools.groupby(words, lambda word: (word.kind, word.vx, word.wz))]
    longest = 0
    for run, after in itertools.zip_longest(runs, runs[1:]):
        if not run[0].turns:
            continue
        if after is None:
            end = end_ns
        else:
            end = run[-1].time_ns if after[0].kind == START else after[0].time_ns
        longest = max(longest, end - run[0].time_ns)
    return longest * 1e-9


def longest_gap(words: Sequence[Line]) -> float:
    """Longest time from a command that turns the motors to the next entry, s; 0 without such a pair.

    The platform writes a command only when a new one of the gate arrives. So a robot that turns in place at its limit
    repeats one command for seconds without a gap, and one whose commands stay away has a gap.
    """
    return (
        max((after.time_ns - word.time_ns for word, after in itertools.pairwise(words) if word.turns), default=0) * 1e-9
    )


def old_words(words: Sequence[Line], since_ns: int) -> int:
    """Number of commands after a time that equal an earlier one, with another one in between.

    Slip makes each command of a healthy chain differ from all before, so these are old commands that got through.
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
        self._lock = threading.Lock()  # the driver's thread and the test's read it
        self.words: list[Line] = []
        self.ticks: list[Line] = []

    def look(self) -> MotorRecord:
        """Read the entries that were added."""
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
        """Lowest forward speed in the newest `words` commands, m/s; 0 if there are fewer."""
        newest = self.look().words[-words:]
        return min(word.vx for word in newest) if len(newest) == words else 0.0

    @property
    def place(self) -> tuple[float, float]:
        """True place at the newest tick, m, map frame; NaN before the first."""
        return (self.ticks[-1].x, self.ticks[-1].y) if self.look().ticks else (math.nan, math.nan)

    @property
    def touched(self) -> bool:
        """Whether the robot has touched something at any time."""
        return any(tick.touching for tick in self.look().ticks)

    def between(self, begin_ns: int, end_ns: int) -> list[Line]:
        """DRIVE and START entries of an interval."""
        return [word for word in self.look().words if begin_ns <= word.time_ns <= end_ns]

    def zero_after(self, time_ns: int) -> Line | None:
        """The first stop command, or start of a process, after a time."""
        return next((word for word in self.look().words if word.time_ns > time_ns and not word.turns), None)

    def turn_after(self, time_ns: int) -> Line | None:
        """The first command that turns the motors after a time."""
        return next((word for word in self.look().words if word.time_ns > time_ns and word.turns), None)

    def standing_after(self, time_ns: int) -> Line | None:
        """The first tick, from a time on, in which the robot is stopped."""
        return next((tick for tick in self.look().ticks if tick.time_ns >= time_ns and tick.stands), None)
