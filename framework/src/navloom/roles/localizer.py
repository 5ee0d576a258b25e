"""Localizer: where the robot is in the map."""

from __future__ import annotations

from abc import abstractmethod

from navloom.messages import MapUpdate, Odometry, PoseEstimate, RangeScan
from navloom.roles.base import Role
from navloom.roles.struct import struct

__all__ = ["Localizer", "LocalizerInput"]


@struct
class LocalizerInput:
    """What a localizer sees: odometry, the scans of this tick, and the newest map."""

    odometry: Odometry
    scans: tuple[RangeScan, ...]
    map: MapUpdate | None


class Localizer(Role):
    """Turns odometry and scans into a pose in the map."""

    role = "localizer"

    @abstractmethod
    def localize(self, given: LocalizerInput) -> PoseEstimate:
        """Pose in the map at the odometry's stamp."""
