"""Recovery: motions that free a robot that is stuck."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from navloom.messages import PoseEstimate, RangeScan, RecoveryStep
from navloom.roles.base import P, Role
from navloom.roles.extra import NO_EXTRAS, Extras
from navloom.roles.readings import NO_READINGS, Readings

__all__ = ["Recovery", "RecoveryInput"]


@dataclass(frozen=True, slots=True)
class RecoveryInput:
    """Input of a recovery.

    Attributes:
        stamp_ns: Run clock.
        scans: New scans of all range sensors.
        estimate: Pose in the map and velocity in base.
        attempt: 1 for the first attempt at this goal.
        reason: Why the goal is stuck.
        starts: True in the first tick of an attempt.
        trail: (k, 3) x, y, m, heading, rad, map frame: poses of base on the last metres, oldest first.
        sensors: Name of the sensor of each scan.
        readings: New messages of other accepted sensors, by sensor name, oldest first.
        extra: The plugin's own extra inputs, see `Extra`.
    """

    stamp_ns: int
    scans: tuple[RangeScan, ...]
    estimate: PoseEstimate
    attempt: int
    reason: str
    starts: bool
    trail: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    sensors: tuple[str, ...] = ()
    readings: Readings = NO_READINGS
    extra: Extras = NO_EXTRAS


class Recovery(Role[P]):
    """Frees a robot that is stuck. It is called each tick while the goal requests it."""

    role = "recovery"
    is_patient = True

    @abstractmethod
    def recover(self, given: RecoveryInput) -> RecoveryStep:
        """Velocity for this tick, the state of the recovery, and whether the map is to be cleared."""
