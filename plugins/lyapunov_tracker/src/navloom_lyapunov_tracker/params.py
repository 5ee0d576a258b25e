"""Parameters of the tracker, and its presets: the paper's values, and the defaults, which are ours."""

from __future__ import annotations

from typing import Self

from navloom import Params, Preset
from pydantic import Field, model_validator

__all__ = ["PRINTED", "ROBUST", "LyapunovTrackerParams"]


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


ROBUST = Preset("ours: a robot that faces away turns in place first")

PRINTED = Preset(
    "Hoang et al. 2013, III.B",
    {
        "k1": (1.0, "k1 > 0; decided: 1, so that e1 falls within seconds at 0.4 m/s"),
        "k3": (0.6, "k3 > 0; decided: 0.6, critical at 0.3 m/s"),
        "turn_in_place_above_deg": (180.0, "not in the paper: law (6) alone turns the robot"),
    },
)
