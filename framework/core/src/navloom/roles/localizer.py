"""Localizer: where the robot is in the map."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from navloom.messages import Hypotheses, MapUpdate, OccupancyGrid, Odometry, Pose2D, PoseEstimate, RangeScan
from navloom.roles.base import ANYWHERE, InputError, P, Role
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
    """Turns odometry and scans into a pose in the map.

    Class attributes:
        can_search: It finds a robot whose place is not known: it reads `Context.start_sigma` and has `search`.
    """

    role = "localizer"
    facts = RoleFacts(
        called="Called in every tick, with the new odometry and scans.",
        purpose=frozenset({Claim.ACCURATE}),
        default_plugin="odometry",
        process="robot",
        sees_map=True,
    )

    can_search: ClassVar[bool] = False

    def place(self, pose: Pose2D) -> None:
        """Take this pose in the map, which an operator gives, as the robot's. Called live, between two steps.

        Raises:
            InputError: This localizer does not accept a pose.
        """
        raise InputError(f"localizer {self.name} does not accept a pose")

    def search(self, near: Pose2D | None = None, sigma: tuple[float, float] = ANYWHERE) -> None:
        """Forget where the robot is and find it again. Called live, between two steps.

        Args:
            near: Where it probably is, map frame; None for anywhere on the map.
            sigma: Standard deviations of `near`: of x and of y, m, and of the heading, rad.

        Raises:
            InputError: This localizer cannot search.
        """
        raise InputError(f"localizer {self.name} cannot search for the robot: place it")

    def hypotheses(self) -> Hypotheses | None:
        """The places where the robot may be; None for a localizer that keeps one.

        Called after each `localize`; published whenever it is another object. While it tracks, that is its pose alone.
        """
        return None

    @abstractmethod
    def localize(self, given: LocalizerInput) -> PoseEstimate:
        """Pose in the map at the odometry's stamp."""
