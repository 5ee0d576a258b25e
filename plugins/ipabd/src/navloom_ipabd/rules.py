"""Which points of a 3D image count as obstacles, and what became of the others."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from navloom_ipabd.errors import SettingError

__all__ = ["FilterOrder", "Filters", "Rule"]

FilterOrder = Literal["before_min", "paper"]


class Rule(IntEnum):
    """What became of one point. The first rule that applies counts; their numbers sum to the points given."""

    NO_RETURN = 0
    """Range +inf."""
    BEYOND_MAX = 1
    """Range within the tolerance of the sensor's maximum, or above: such sensors report "nothing" as a number."""
    BELOW_MIN = 2
    """Range under the sensor's minimum: dust, the sensor's window, the robot itself."""
    BELOW_FLOOR = 3
    """Lower than the floor by more than the tolerance: a mirror image, a stairwell, an error of pitch."""
    FLOOR = 4
    TOO_HIGH = 5
    NOT_MINIMUM = 6
    """An obstacle point, but another one on its bearing is nearer."""
    KEPT = 7


@dataclass(frozen=True)
class Filters:
    """Steps 2 and 3 of IPaBD (Hoang et al. 2013, II.B), in floor heights.

    Attributes:
        floor_tolerance: Points within this of the floor are floor, m.
        z_limit: Points above this do not hinder the robot, m above the floor.
        order: "before_min" drops floor and overhead points, then takes the nearest of each bearing. "paper" takes the
            nearest first, as printed: a wall behind visible floor or under a girder is lost with it.
        min_range: Lower limit of the range besides the sensor's own, m.
        max_range_tolerance: A range this near to the sensor's maximum means no return, m.
    """

    floor_tolerance: float = 0.06
    z_limit: float = 1.2
    order: FilterOrder = "before_min"
    min_range: float = 0.0
    max_range_tolerance: float = 0.05

    def __post_init__(self) -> None:
        if not 0.0 <= self.floor_tolerance < self.z_limit:
            given = f"{self.floor_tolerance:g} and {self.z_limit:g} m"
            raise SettingError("filters.floor_tolerance, z_limit", given, "0 <= floor_tolerance < z_limit")
        if self.order not in ("before_min", "paper"):
            raise SettingError("filters.order", repr(self.order), "'before_min' or 'paper'")
        if not (self.min_range >= 0.0 and self.max_range_tolerance >= 0.0):
            given = f"{self.min_range:g} and {self.max_range_tolerance:g} m"
            raise SettingError("filters.min_range, max_range_tolerance", given, "lengths >= 0")
