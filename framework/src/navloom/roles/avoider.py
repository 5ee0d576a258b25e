"""Avoider: the velocity that passes what the map does not know."""

from __future__ import annotations

import math
from abc import abstractmethod

from navloom.messages import Avoidance, Point2D, PoseEstimate, RangeScan, Twist2D
from navloom.roles.base import P, Role
from navloom.roles.extra import NO_EXTRAS, Extras
from navloom.roles.readings import NO_READINGS, Readings
from navloom.roles.struct import struct

__all__ = ["Avoider", "AvoiderInput"]


@struct
class AvoiderInput:
    """What an avoider sees. Its footprint and limits are in the context.

    Attributes:
        stamp_ns: Run clock.
        scans: What the range sensors gave in this tick, in order of sensor; empty where none was due.
        estimate: Pose in the map and velocity in base.
        target: Point to steer to, m, map frame.
        corridor: Half width of the strip to the target that must be free, m.
        desired: What the controller asks for.
        remaining: Distance still to drive after the target, m; 0 where the target is the goal.
        share: Of the last command that the gate's monitor let through; 1 where it saw nothing in the way.
        sensors: Name of the sensor that gave each scan.
        readings: What accepted sensors of other kinds gave, by sensor name, oldest first.
        extra: The plugin's own extra inputs, see `Extra`.
    """

    stamp_ns: int
    scans: tuple[RangeScan, ...]
    estimate: PoseEstimate
    target: Point2D
    corridor: float
    desired: Twist2D
    remaining: float
    share: float = 1.0
    sensors: tuple[str, ...] = ()
    readings: Readings = NO_READINGS
    extra: Extras = NO_EXTRAS


class Avoider(Role[P]):
    """Steers round what is sensed. It steps every tick, whether it drives or not."""

    role = "avoider"
    needs_sensor = True
    _interval, _last_status = -1, ""

    @abstractmethod
    def avoid(self, given: AvoiderInput) -> Avoidance:
        """Velocity for this tick, the status, and why, which may be left out: see `is_to_explain`."""

    def is_to_explain(self, stamp_ns: int, status: str) -> bool:
        """Whether the answer of this step is to hold diagnostics. Ask once a step.

        They are due in the first step of each interval of the declared rate, and where the robot becomes trapped. Both
        depend on the run alone, never on who reads them, so that a trace is the same whatever is recorded beside it.

        Args:
            stamp_ns: Run clock.
            status: Of the answer.
        """
        rate = self.context.diagnostics_rate_hz
        if math.isinf(rate):
            return True
        before, self._last_status = self._last_status, status
        interval = stamp_ns // max(1, round(1e9 / rate)) if rate > 0.0 else self._interval
        is_due, self._interval = interval != self._interval, interval
        return is_due or (status == "trapped" and before != "trapped")
