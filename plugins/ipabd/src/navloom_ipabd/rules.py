"""Rules for which points of a 3D image count as obstacles and why the others are dropped."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from math import inf
from typing import Literal, NamedTuple

from navloom_ipabd.errors import SettingError

__all__ = ["FilterOrder", "Filters", "HeightFrame", "Heights", "Rule"]

FilterOrder = Literal["before_min", "paper"]
HeightFrame = Literal["floor", "sensor"]


class Rule(IntEnum):
    """Outcome of one point. The first rule that applies counts, so the counts sum to the number of points."""

    NO_RETURN = 0
    """Range +inf."""
    BEYOND_MAX = 1
    """Range above the sensor's maximum less the tolerance: some sensors report "no return" as a number."""
    BELOW_MIN = 2
    """Range below the sensor's minimum: dust, the sensor's window, the robot itself."""
    BELOW_FLOOR = 3
    """Below the floor by more than the tolerance: a reflection, a stairwell, a pitch error."""
    FLOOR = 4
    TOO_HIGH = 5
    NOT_MINIMUM = 6
    """An obstacle point that is not the nearest one on its bearing."""
    KEPT = 7


class Heights(NamedTuple):
    """Which heights above the floor, m, are obstacles: those in (`low`, `high`], and those lower than `deep`.

    Heights lower than `below` count as below the floor, others up to `low` as floor.
    """

    below: float
    deep: float
    low: float
    high: float


@dataclass(frozen=True)
class Filters:
    """Limits of steps 2 and 3 of IPaBD (Hoang et al. 2013, II.B).

    Attributes:
        floor_tolerance: Largest distance from the floor of a point that counts as floor, m.
        z_limit: Height above which points are no obstacles, m.
        frame: Where heights are 0. "floor": at the floor. "sensor": at the sensor, as z of eq. (1). Step 3 as printed,
            z > z_limit and z = 0, then removes the sensor's own level instead of the floor, and keeps the floor, whose
            z is negative.
        order: "before_min" drops floor and overhead points, then takes the nearest point of each bearing. "paper" takes
            the nearest point first, as printed. A wall behind visible floor or under a girder is then lost with it.
        min_range: Lower limit of the range in addition to the sensor's own, m.
        max_range_tolerance: Distance below the sensor's maximum from which a range means "no return", m.
    """

    floor_tolerance: float = 0.06
    z_limit: float = 1.2
    frame: HeightFrame = "floor"
    order: FilterOrder = "before_min"
    min_range: float = 0.0
    max_range_tolerance: float = 0.05

    def __post_init__(self) -> None:
        if not 0.0 <= self.floor_tolerance < self.z_limit:
            given = f"{self.floor_tolerance:g} and {self.z_limit:g} m"
            raise SettingError("filters.floor_tolerance, z_limit", given, "0 <= floor_tolerance < z_limit")
        if self.frame not in ("floor", "sensor"):
            raise SettingError("filters.frame", repr(self.frame), "'floor' or 'sensor'")
        if self.order not in ("before_min", "paper"):
            raise SettingError("filters.order", repr(self.order), "'before_min' or 'paper'")
        if not (self.min_range >= 0.0 and self.max_range_tolerance >= 0.0):
            given = f"{self.min_range:g} and {self.max_range_tolerance:g} m"
            raise SettingError("filters.min_range, max_range_tolerance", given, "lengths >= 0")

    def heights(self, sensor_z: float) -> Heights:
        """The limits as heights above the floor, m, for a sensor `sensor_z`, m, above it."""
        if self.frame == "floor":
            return Heights(-self.floor_tolerance, -inf, self.floor_tolerance, self.z_limit)
        return Heights(-inf, sensor_z - self.floor_tolerance, sensor_z + self.floor_tolerance, sensor_z + self.z_limit)
