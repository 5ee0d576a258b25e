"""Parameters of the tracker."""

from __future__ import annotations

from typing import Self

from navloom import Params
from pydantic import Field, model_validator

__all__ = ["LyapunovTrackerParams"]


class LyapunovTrackerParams(Params):
    """Gains of law (6), and the heading errors at which a turn in place starts and ends."""

    k1: float = Field(1.0, gt=0.0, le=20.0, description="gain of the longitudinal error, 1/s")
    k3: float = Field(0.6, gt=0.0, le=20.0, description="gain of the heading error, 1/s; critical at 2 v_r")
    turn_in_place_above_deg: float = Field(
        60.0, gt=0.0, le=180.0, description="heading error that starts a turn in place, degrees; 180: never (the paper)"
    )
    turn_in_place_until_deg: float = Field(20.0, ge=2.0, description="heading error that ends it, degrees")

    @model_validator(mode="after")
    def _ends_below_its_start(self) -> Self:
        if self.turn_in_place_until_deg >= self.turn_in_place_above_deg:
            raise ValueError(
                f"turn_in_place_until_deg is {self.turn_in_place_until_deg:g}, expected less than "
                f"turn_in_place_above_deg, {self.turn_in_place_above_deg:g}"
            )
        return self
