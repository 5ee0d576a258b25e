"""Localizer: where the robot is in the map."""

from __future__ import annotations

from abc import abstractmethod

from navloom.messages import MapUpdate, OccupancyGrid, Odometry, Pose2D, PoseEstimate, RangeScan
from navloom.roles.base import InputError, P, Role
from navloom.roles.claims import Claim
from navloom.roles.extra import NO_EXTRAS, Extras
from navloom.roles.facts import RoleFacts
from navloom.roles.readings import NO_READINGS, Readings
from navloom.roles.struct import struct

__all__ = ["Localizer", "LocalizerInput"]


@struct
class LocalizerInput:
    """What a localizer sees.

    Attributes:
        odometry: The newest odometry.
        scans: New scans of this tick.
        map: The mapper's known map if it publishes one, otherwise its newest map; None before the first.
        sensors: Name of the sensor of each scan.
        readings: New messages of accepted sensors of other kinds, by sensor name, oldest first.
        extra: The plugin's own extra inputs, see `Extra`.
        known: The mapper's known map, see `Mapper.known`; None if it publishes none.
    """

    odometry: Odometry
    scans: tuple[RangeScan, ...]
    map: MapUpdate | None
    sensors: tuple[str, ...] = ()
    readings: Readings = NO_READINGS
    extra: Extras = NO_EXTRAS
    known: OccupancyGrid | None = None


class Localizer(Role[P]):
    """Turns odometry and scans into a pose in the map."""

    role = "localizer"
    facts = RoleFacts(
        called="Called in every tick, with the new odometry and scans.",
        purpose=frozenset({Claim.ACCURATE}),
        default_plugin="odometry",
        process="robot",
        sees_map=True,
    )

    def place(self, pose: Pose2D) -> None:
        """Take this pose in the map, which an operator gives, as the robot's. Called live, between two steps.

        Raises:
            InputError: This localizer does not accept a pose.
        """
        raise InputError(f"localizer {self.name} does not accept a pose")

    @abstractmethod
    def localize(self, given: LocalizerInput) -> PoseEstimate:
        """Pose in the map at the odometry's stamp."""
