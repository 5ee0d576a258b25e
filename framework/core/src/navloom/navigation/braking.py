"""How a robot comes to rest: the way that it needs, the speed that fits a way, and when it stands."""

from __future__ import annotations

import math
from dataclasses import dataclass

from navloom.messages import Twist2D
from navloom.roles import RobotSpec

__all__ = ["ACROSS", "Braking", "Ending", "Standstill", "braked"]

AT_REST = 0.005
"""Measured speed of a robot that stands, m/s and rad/s: below it, a robot with a lag of 1 s moves 5 mm further."""
SETTLING = 5.0
"""Lags after which less than 1 % of a motor's speed is left."""
ACROSS = 1.5
"""Longest way to standstill from where a robot comes within a tolerance, in tolerances: 2 lead across it."""
MORE = 1.0
"""Additional wait for a robot whose measured speed does not fall to `AT_REST`, s."""


def braked(speed: float, by: float) -> float:
    """A speed, m/s, that is nearer to zero by a step, m/s, but not beyond it."""
    return math.copysign(max(0.0, abs(speed) - by), speed)


@dataclass(frozen=True)
class Braking:
    """A robot that brakes along a ramp of commands.

    Attributes:
        robot: Its limits and delays.
        period: Control tick, s.
    """

    robot: RobotSpec
    period: float

    @property
    def delay(self) -> float:
        """Time for which a robot drives on unbraked: a tick until it is seen, the dead time and the lag, s."""
        return self.period + self.robot.dead_time + self.robot.motor_lag

    @property
    def patience(self) -> float:
        """Longest time until a robot stands: the ramp from the largest speed, and all delays, s."""
        robot = self.robot
        # Every part is an upper bound: what ends too early would decide on a moving robot.
        return robot.max_linear / robot.max_deceleration + self.delay + SETTLING * robot.motor_lag + MORE

    def way(self, speed: float) -> float:
        """Distance to standstill, m, from a speed, m/s: v t + v² / 2a."""
        return speed * self.delay + 0.5 * speed * speed / self.robot.max_deceleration

    def turn(self, rate: float) -> float:
        """Angle to standstill, rad, from a turn rate, rad/s."""
        return abs(rate) * self.delay + 0.5 * rate * rate / self.robot.max_angular_acceleration

    def speed_within(self, way: float) -> float:
        """Speed, m/s, from which a distance, m, is enough to stop: the inverse of `way`."""
        deceleration = self.robot.max_deceleration
        free = deceleration * self.delay
        # The positive root of way = v t + v² / 2a.
        return math.sqrt(free * free + 2.0 * deceleration * way) - free


class Standstill:
    """Whether a robot stands: commanded and measured.

    Args:
        braking: Its delays.
    """

    def __init__(self, braking: Braking) -> None:
        # A robot with dead time may stand while a command to drive is still on its way to the wheels.
        self._held = braking.robot.dead_time + braking.period
        self._moved_at = -math.inf

    def note(self, is_commanded: bool, time: float) -> None:
        """Take whether the robot is commanded to move, at a run time, s."""
        if is_commanded:
            self._moved_at = time

    def stands(self, measured: Twist2D, time: float) -> bool:
        """Whether the robot stands at a run time, s, with a measured velocity: no command can still be on its way."""
        # Not exactly zero: motors with a lag approach zero without reaching it.
        is_slow = max(abs(measured.vx), abs(measured.vy), abs(measured.wz)) <= AT_REST
        # Times are sums of ticks; rounding must not cost a tick.
        return is_slow and time - self._moved_at > self._held - 1e-9


class Ending:
    """When a run ends: its last goal has ended, and the robot stands or has had more than enough time for it.

    Args:
        braking: How the robot comes to rest.
        last_request: Tick of the last operator's request.
    """

    def __init__(self, braking: Braking, last_request: int) -> None:
        self._standstill, self._last_request, self._braking = Standstill(braking), last_request, braking
        self._idle_since = math.inf

    def is_over(self, number: int, is_idle: bool, is_commanded: bool, measured: Twist2D | None) -> bool:
        """Whether the run ends with this tick.

        Args:
            number: The tick.
            is_idle: No goal is active.
            is_commanded: The gate commands motion.
            measured: Velocity by the odometry; None before the first.
        """
        time = number * self._braking.period
        self._standstill.note(is_commanded, time)
        # A run goes on until the last event of its config has happened, also if no goal is active.
        if not is_idle or number <= self._last_request:
            self._idle_since = math.inf
            return False
        self._idle_since = min(self._idle_since, time)
        stands = measured is None or self._standstill.stands(measured, time)
        return stands or time - self._idle_since >= self._braking.patience
