"""Controller: the velocity that follows a trajectory."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from navloom.messages import Message, PoseEstimate, Reference, TrackingCommand, Trajectory
from navloom.roles.base import P, Role
from navloom.roles.claims import Claim
from navloom.roles.extra import NO_EXTRAS, Extras
from navloom.roles.facts import RoleFacts
from navloom.roles.struct import struct

__all__ = ["Controller", "ControllerInput"]


@struct
class ControllerInput:
    """What a controller sees.

    Attributes:
        stamp_ns: Run clock.
        trajectory: The whole trajectory to follow.
        reference: The robot's place on it (progress, reference pose, speed and turn rate).
        estimate: Pose in the map and velocity in base.
        extra: The plugin's own extra inputs, see `Extra`.
    """

    stamp_ns: int
    trajectory: Trajectory
    reference: Reference
    estimate: PoseEstimate
    extra: Extras = NO_EXTRAS


class Controller(Role[P]):
    """Follows trajectories. It steps in every tick while a trajectory is followed."""

    role = "controller"
    facts = RoleFacts(
        called="Called in every tick while a trajectory is followed.",
        purpose=frozenset({Claim.SETTLES}),
        default_plugin="lyapunov_tracker",
        process="drive",
        commands=True,
    )
    accepts: ClassVar[tuple[type[Message], ...]] = ()

    @abstractmethod
    def control(self, given: ControllerInput) -> TrackingCommand:
        """Velocity for this tick, and the tracking errors that it corrects."""
