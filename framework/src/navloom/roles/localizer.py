"""Localizer: where the robot is in the map."""

from __future__ import annotations

from abc import abstractmethod

from navloom.messages import MapUpdate, Odometry, PoseEstimate, RangeScan
from navloom.roles.base import P, Role
from navloom.roles.extra import NO_EXTRAS, Extras
from navloom.roles.readings import NO_READINGS, Readings
from navloom.roles.struct import struct

__all__ = ["Localizer", "LocalizerInput"]


@struct
class LocalizerInput:
    """What a localizer sees.

    Attributes:
        odometry: Newest dead reckoning.
        scans: Of this tick.
        map: The newest one; None before the first.
        sensors: Name of the sensor that gave each scan.
        readings: What accepted sensors of other kinds gave, by sensor name, oldest first.
        extra: The plugin's own extra inputs, see `Extra`.
    """

    odometry: Odometry
    scans: tuple[RangeScan, ...]
    map: MapUpdate | None
    sensors: tuple[str, ...] = ()
    readings: Readings = NO_READINGS
    extra: Extras = NO_EXTRAS


class Localizer(Role[P]):
    """Turns odometry and scans into a pose in the map."""

    role = "localizer"

    @abstractmethod
    def localize(self, given: LocalizerInput) -> PoseEstimate:
        """Pose in the map at the odometry's stamp."""
