"""Mapper: a map from range data."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from navloom.messages import MapUpdate, Message, OccupancyGrid, PoseTrack, RangeScan, Sweep
from navloom.roles.base import P, Role
from navloom.roles.claims import Claim
from navloom.roles.extra import NO_EXTRAS, Extras
from navloom.roles.facts import RoleFacts
from navloom.roles.readings import NO_READINGS, Readings
from navloom.roles.struct import struct

__all__ = ["Mapper", "MapperInput"]


@struct
class MapperInput:
    """What a mapper sees.

    Attributes:
        stamp_ns: Run clock.
        sweeps, scans: New data, in stamp order; both may be empty.
        track: Poses in the map that cover the time of the data.
        clear: The map may be wrong. Forget what the newest data, or the next, can show again, but not what is out of
            sight: the robot plans with the rest.
        sensors: Name of the sensor of each scan.
        sweep_sensors: Name of the sensor of each sweep.
        readings: New messages of accepted sensors of other kinds, by sensor name, oldest first.
        extra: The plugin's own extra inputs, see `Extra`.
        is_tracking: The localizer knew at its newest pose where the robot is.
    """

    stamp_ns: int
    sweeps: tuple[Sweep, ...]
    scans: tuple[RangeScan, ...]
    track: PoseTrack
    # Not an empty map: one of the next sweep alone would lack what is behind the robot, and what only a map can show,
    # such as a girder above the sonars.
    clear: bool = False
    sensors: tuple[str, ...] = ()
    sweep_sensors: tuple[str, ...] = ()
    readings: Readings = NO_READINGS
    extra: Extras = NO_EXTRAS
    is_tracking: bool = True


class Mapper(Role[P]):
    """Turns range data into a map. Raises InputError for data that it cannot use."""

    role = "mapper"
    facts = RoleFacts(
        called="Called for new sweeps or scans, and when the map is to be cleared. `navloom.geometry.echoes` turns "
        "both into points, see [Geometry](geometry.md).",
        purpose=frozenset({Claim.ACCURATE}),
        default_plugin="ipabd",
        process="think",
        sees_map=True,
        has_large_messages=True,
    )
    is_patient = True
    accepts: ClassVar[tuple[type[Message], ...]] = (Sweep,)
    needs_sensor = True

    @abstractmethod
    def update(self, given: MapperInput) -> MapUpdate | None:
        """The map with the new data; None if nothing changed."""

    def known(self) -> OccupancyGrid | None:
        """The map without what this mapper adds to it from its sensors. Localizers match it, it is saved, and the gate
        slows the robot before its surfaces.

        Called after each `update`; it is published whenever it is another object. None if there is no such map.
        """
        return None
