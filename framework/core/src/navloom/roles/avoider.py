"""Avoider: the velocity that avoids obstacles, whether the map knows them or not."""

from __future__ import annotations

import math
from abc import abstractmethod

from navloom.messages import Avoidance, Point2D, PoseEstimate, RangeScan, Rollouts, Twist2D
from navloom.roles.base import P, Role
from navloom.roles.claims import Claim
from navloom.roles.extra import NO_EXTRAS, Extras
from navloom.roles.facts import RoleFacts
from navloom.roles.readings import NO_READINGS, Readings
from navloom.roles.struct import struct

__all__ = ["Avoider", "AvoiderInput"]


@struct
class AvoiderInput:
    """What an avoider sees. The robot's footprint and limits are in the context.

    Attributes:
        stamp_ns: Run clock.
        scans: New scans of the range sensors in this tick, in order of time; empty if none was due.
        estimate: Pose in the map and velocity in base.
        target: Point to steer to, m, map frame.
        corridor: Half width of the strip to the target that must be free, m.
        desired: Velocity that the controller requests.
        remaining: Distance from the target to the goal along the trajectory, m; 0 if the target is the goal.
        share: Share of the last command that the gate's monitor let pass; 1 if nothing was in the way.
        sensors: Name of the sensor of each scan.
        readings: New messages of accepted sensors of other kinds, by sensor name, oldest first.
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
    """Steers around sensed obstacles. While a trajectory is followed, it steps in every tick, driving or not."""

    role = "avoider"
    facts = RoleFacts(
        called="Called in every tick while a trajectory is followed, whether it drives or not. The framework decides "
        "whether it drives.",
        purpose=frozenset({Claim.NO_CONTACT, Claim.REACHES}),
        default_plugin="improved_vfh",
        process="drive",
        commands=True,
        gives_diagnostics=True,
    )
    needs_sensor = True
    _interval, _last_status = -1, ""

    @abstractmethod
    def avoid(self, given: AvoiderInput) -> Avoidance:
        """Velocity for this tick, status, and diagnostics, which may be left out: see `is_to_explain`."""

    def rollouts(self) -> Rollouts | None:
        """Some of the motions that were rolled out in this step; None for a method without them.

        Called after each `avoid` whose answer has diagnostics.
        """
        return None

    def is_to_explain(self, stamp_ns: int, status: str) -> bool:
        """Whether the answer of this step should hold diagnostics. Call it once per step.

        Diagnostics are due in the first step of each interval of the configured rate, and when the robot becomes
        trapped. Both depend only on the run, not on its readers, so that a trace does not depend on what is recorded.

        Args:
            stamp_ns: Run clock.
            status: Status of the answer.
        """
        rate = self.context.diagnostics_rate_hz
        if math.isinf(rate):
            return True
        before, self._last_status = self._last_status, status
        interval = stamp_ns // max(1, round(1e9 / rate)) if rate > 0.0 else self._interval
        is_due, self._interval = interval != self._interval, interval
        return is_due or (status == "trapped" and before != "trapped")
