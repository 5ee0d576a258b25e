"""Commands in flight: given, but not yet followed by the motors."""

from __future__ import annotations

import math
from collections import deque
from typing import Self

import numpy as np
from numpy.typing import NDArray

from navloom_avoidance.robot import Robot

__all__ = ["Motors"]

SPEED_ERROR, TURN_ERROR = 0.1, 0.2
"""Deviation from its command at which a robot does not follow it, m/s and rad/s."""
FOREIGN = 0.1
"""Deviation beyond the motors' dynamics at which the robot follows commands of another source, m/s."""


class Motors:
    """Model of a robot's motors, with the commands of one node that they have not followed yet.

    A command acts `dead_time` after it was given; the wheels then approach it with the time constant `lag`.

    Args:
        lag, dead_time: s.
        period: Period of the commands, s.
        acceleration, deceleration: Limits of the command gate, m/s^2.
    """

    def __init__(self, lag: float, dead_time: float, period: float, acceleration: float, deceleration: float) -> None:
        self.lag, self.dead_time, self.period = lag, dead_time, period
        self.up, self.down = acceleration, deceleration
        self.delay = lag + dead_time
        self._count = max(1, math.ceil(dead_time / period - 1e-9))
        self.reset()

    @classmethod
    def of(cls, robot: Robot, period: float) -> Self:
        """Of a robot, for commands that are a period apart, s."""
        return cls(robot.motor_lag, robot.dead_time, period, robot.max_acceleration, robot.max_deceleration)

    def reset(self) -> None:
        """Forget every command."""
        self._passed = deque([(0.0, 0.0)] * self._count, self._count)
        self._sent = (0.0, 0.0)

    def give(self, v: float, w: float) -> None:
        """Record the command of this tick: m/s and rad/s."""
        self._sent = (v, w)

    def obeyed(self, twist: tuple[float, float]) -> bool:
        """Whether the robot does what it was given last; one that was stopped, or is driven by another, does not."""
        return abs(twist[0] - self._sent[0]) < SPEED_ERROR and abs(twist[1] - self._sent[1]) < TURN_ERROR

    def in_flight(self, twist: tuple[float, float], share: float) -> NDArray[np.float64]:
        """(n, 2) m/s and rad/s: commands not followed yet, a period apart, the newest last. Call it once per tick.

        Ideal motors follow at once: then it is the measured velocity.

        Args:
            twist: Measured forward speed, m/s, and turn rate, rad/s.
            share: Share of the last command that the gate let pass.
        """
        if self.delay == 0.0:
            return np.array([twist])
        before, wanted = self._passed[-1][0], share * self._sent[0]
        speed = min(max(wanted, before - self.down * self.period), before + self.up * self.period)
        self._passed.append((speed, share * self._sent[1]))
        if abs(speed - twist[0]) > FOREIGN + max(self.up, self.down) * (self.delay + self.period):
            self._passed.extend([twist] * self._count)
        return np.array(self._passed)
