"""Measures from a motor log how long the motors ran on after a fault, when they stopped, and when they turned again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

__all__ = ["Fault", "MotorWords"]

STILL = 1e-3
"""Speed below which the robot is stopped, m/s and rad/s."""


@dataclass(frozen=True)
class Fault:
    """Effects of one fault on the motors.

    Attributes:
        ran_on: Longest time without a new command while the motors turned, s, up to the end of the measurement.
        stopped: Time from the start of the fault to the first stop command, s; None if there was none.
        stood: Time from that command until the robot was stopped, s.
        again: Time from the end of the fault until the motors turned again, s; None if they were turning at its end.
    """

    ran_on: float
    stopped: float | None
    stood: float | None
    again: float | None


class MotorWords:
    """Reads a motor log as it grows.

    Attributes:
        words: (time s, forward speed m/s, turn rate rad/s) of each command, monotonic clock of the base.
        states: (time, forward speed, turn rate) of the robot at each tick, same units.
        place: (x, y) at the newest tick, m.
        touched: The robot has touched something.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._read = 0
        self.words: list[tuple[float, float, float]] = []
        self.states: list[tuple[float, float, float]] = []
        self.place = (0.0, 0.0)
        self.touched = False

    def look(self) -> MotorWords:
        """Read the lines that were added."""
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
        """Forward speed of the newest command, m/s; 0 before the first."""
        return self.look().words[-1][1] if self.look().words else 0.0

    def turned_after(self, time: float) -> float | None:
        """Time of the first command after a time that turns the motors, s; None if there is none."""
        return next((at for at, speed, turn in self.look().words if at > time and (speed or turn)), None)

    def fault(self, began: float, ended: float, limit: float) -> Fault:
        """Effects of a fault.

        Args:
            began, ended: Start and end of the fault, s.
            limit: End of the measurement, s; the motors turn again by then.
        """
        words = [word for word in self.look().words if began - 0.2 < word[0] <= limit]
        ends = [*(word[0] for word in words[1:]), limit]
        gaps = [end - word[0] for word, end in zip(words, ends, strict=False) if word[1] or word[2]]
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
