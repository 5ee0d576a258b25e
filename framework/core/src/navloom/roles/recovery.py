"""Recovery: behaviour that frees a stuck robot."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navloom.messages import PoseEstimate, RangeScan, RecoveryStep
from navloom.roles.base import P, Role
from navloom.roles.claims import Claim
from navloom.roles.extra import NO_EXTRAS, Extras
from navloom.roles.facts import RoleFacts
from navloom.roles.readings import NO_READINGS, Readings

__all__ = ["Recovery", "RecoveryInput"]


@dataclass(frozen=True, slots=True)
class RecoveryInput:
    """What a recovery sees.

    Attributes:
        stamp_ns: Run clock.
        scans: New scans of the range sensors in this tick.
        estimate: Pose in the map and velocity in base.
        attempt: Number of the attempt for this goal, from 1.
        reason: Why the goal is stuck; "searching" while the localizer is not tracking, see `Recovery.looks_around`.
        starts: True in the first tick of an attempt.
        trail: (k, 3) x, y, m, heading, rad, map frame: poses of base over the last metres, oldest first.
        sensors: Name of the sensor of each scan.
        readings: New messages of accepted sensors of other kinds, by sensor name, oldest first.
        extra: The plugin's own extra inputs, see `Extra`.
        surfaces: (n, 2) points of the map's surfaces within 5 m, m, base frame, at most 2.5 cm apart; n = 0 while the
            localizer does not track.
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
    surfaces: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))


class Recovery(Role[P]):
    """Frees a stuck robot. It is called in each tick while the goal requests it.

    Class attributes:
        looks_around: It is also requested, with the reason "searching", while a localizer that can search is not
            tracking: it then moves the robot so that its sensors see more, until the goal ends the request. The pose
            of the estimate is not to be trusted meanwhile, only its velocity.
    """

    role = "recovery"
    facts = RoleFacts(
        called="Called in every tick while the goal requests a recovery.",
        purpose=frozenset({Claim.NO_CONTACT, Claim.ENDS}),
        default_plugin="wait_and_replan",
        process="drive",
        commands=True,
    )
    is_patient = True
    looks_around: ClassVar[bool] = False

    @abstractmethod
    def recover(self, given: RecoveryInput) -> RecoveryStep:
        """Velocity for this tick, state of the attempt, and whether to clear the map."""
