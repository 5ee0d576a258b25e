"""Learns from the gate which motion it does not let pass, and bars it for a while."""

from __future__ import annotations

from dataclasses import dataclass

HELD = 0.1  # the gate holds a robot of whose command it passes less than this share
PATIENCE = 0.3  # s: longer than noise holds a robot
BARRED = 1.0  # s: long enough to move away, short enough to try again before a recovery starts


@dataclass
class Held:
    """The motions that the gate's monitor holds: turning to one side, or backing up.

    The monitor has its own memory and margins. A robot that repeats a held command stands until a recovery starts.

    Attributes:
        side: Side to which turns are barred: 1 left, -1 right, 0 none.
        is_back_barred: Whether backing up is barred.
    """

    side: int = 0
    is_back_barred: bool = False
    _time: float = 0.0
    _since: float = 0.0

    def note(self, share: float, sent: tuple[float, float], period: float) -> None:
        """Note the share of the last command, m/s and rad/s, that the gate let pass in the last period, s."""
        self._since += period
        if self._since > BARRED:
            self.side, self.is_back_barred = 0, False
        self._time = self._time + period if share < HELD and sent != (0.0, 0.0) else 0.0
        if self._time > PATIENCE:
            self._time, self._since = 0.0, 0.0
            self.is_back_barred = self.is_back_barred or sent[0] < 0.0
            if sent[0] >= 0.0 and sent[1] != 0.0:
                self.side = 1 if sent[1] > 0.0 else -1

    @property
    def is_held(self) -> bool:
        """Whether the gate holds the robot now."""
        return self._time > 0.0

    def allows(self, command: tuple[float, float]) -> bool:
        """Whether a command, m/s and rad/s, is not barred."""
        return not (self.is_back_barred if command[0] < 0.0 else command[1] * self.side > 0.0)
