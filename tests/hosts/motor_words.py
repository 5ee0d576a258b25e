"""What a motor log says about a fault: how long the motors ran on, when they stood, and when they turned again."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Fault", "MotorWords"]

STILL = 1e-3
"""m/s and rad/s below which the robot stands."""


@dataclass(frozen=True)
class Fault:
    """What came of one fault.

    Attributes:
        ran_on: Longest time without a word to motors that turned, s.
        stopped: From its beginning to the first zero, s; None where the motors never stopped.
        stood: From that zero until the robot stood, s.
        again: From its end until the motors turned again, s; None where they turned then.
    """

    ran_on: float
    stopped: float | None
    stood: float | None
    again: float | None


class MotorWords:
    """Reads a motor log as it grows.

    Attributes:
        words: (s, forward speed m/s, turn rate rad/s) of each word to the motors, monotonic time of the base.
        states: (s, forward speed, turn rate) of the robot at each tick.
        place: (x, y) at the newest tick, m.
        touched: It touched something.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._read = 0
        self.words: list[tuple[float, float, float]] = []
        self.states: list[tuple[float, float, float]] = []
        self.place = (0.0, 0.0)
        self.touched = False

    def look(self) -> MotorWords:
        """Take in what was added."""
        if not self._path.exists():
            return self
        with self._path.open("rb") as file:
            file.seek(self._read)
            text = file.read()
        text = text[: text.rfind(b"\n") + 1]
        self._read += len(text)
        for line in text.decode().splitlines():
            if line.startswith("at "):
                time_ns, speed, turn, touching, x, y = line.split()[1:]
                self.states.append((int(time_ns) * 1e-9, float(speed), float(turn)))
                self.place = (float(x), float(y))
                self.touched = self.touched or touching != "0"
            else:
                time_ns, speed, turn = line.split()
                self.words.append((int(time_ns) * 1e-9, float(speed), float(turn)))
        return self

    @property
    def speed(self) -> float:
        """The newest word to the motors, m/s; 0 before the first."""
        return self.look().words[-1][1] if self.look().words else 0.0

    def turned_after(self, time: float) -> float | None:
        """When the motors were first told to turn after a time, s."""
        return next((at for at, speed, turn in self.look().words if at > time and (speed or turn)), None)

    def fault(self, began: float, ended: float, limit: float) -> Fault:
        """What came of a fault.

        Args:
            began, ended: Its times, s.
            limit: Time up to which it is looked at, s: the motors turn again by then.
        """
        words = [word for word in self.words if began - 0.2 < word[0] <= limit]
        gaps = [after[0] - word[0] for word, after in itertools.pairwise(words) if word[1] or word[2]]
        zero = next((at for at, speed, turn in words if at > began and not speed and not turn), None)
        stood = again = None
        if zero is not None:
            stood = next((at - zero for at, *twist in self.states if at >= zero and max(map(abs, twist)) < STILL), None)
        before = [word for word in words if word[0] <= ended]
        if before and not any(before[-1][1:]):
            again = self.turned_after(ended)
        return Fault(
            max(gaps, default=0.0),
            None if zero is None else zero - began,
            stood,
            None if again is None else again - ended,
        )
