"""What is on its way to the wheels: commands that were given and that the motors do not follow yet."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

__all__ = ["SPEED_ERROR", "TURN_ERROR", "Motors"]

SPEED_ERROR, TURN_ERROR = 0.1, 0.2
"""A robot that is this far off its command does not follow it, m/s and rad/s."""
FOREIGN = 0.1
"""A robot this much further off its command than its motors explain follows another one, m/s."""


class Motors:
    """The motors of a robot, and the commands of one node that they have not followed yet.

    A command acts `dead_time` after it was given; the wheels then approach it with the time constant `lag`.

    Args:
        lag, dead_time: s.
        period: Of the commands, s.
        acceleration, deceleration: Of the command gate, m/s^2.
    """

    def __init__(self, lag: float, dead_time: float, period: float, acceleration: float, deceleration: float) -> None:
        self.lag, self.dead_time, self.period = lag, dead_time, period
        self.up, self.down = acceleration, deceleration
        self.delay = lag + dead_time
        self._count = max(1, math.ceil(dead_time / period - 1e-9))
        self.reset()

    def reset(self) -> None:
        """Forget every command."""
        self._passed = deque([(0.0, 0.0)] * self._count, self._count)
        self._sent = (0.0, 0.0)

    def give(self, v: float, w: float) -> None:
        """Keep the command of this tick: m/s and rad/s."""
        self._sent = (v, w)

    def in_flight(self, twist: tuple[float, float], share: float) -> NDArray[np.float64]:
        """(n, 2) m/s and rad/s: commands that are not followed yet, a period apart, the newest last; once a tick.

        Ideal motors follow at once: what they do is what was measured.

        Args:
            twist: Measured forward speed, m/s, and turn rate, rad/s.
            share: Of the last command that the gate let through.
        """
        if self.delay == 0.0:
            return np.array([twist])
        before, wanted = self._passed[-1][0], share * self._sent[0]
        speed = min(max(wanted, before - self.down * self.period), before + self.up * self.period)
        self._passed.append((speed, share * self._sent[1]))
        if abs(speed - twist[0]) > FOREIGN + max(self.up, self.down) * (self.delay + self.period):
            self._passed.extend([twist] * self._count)
        return np.array(self._passed)
