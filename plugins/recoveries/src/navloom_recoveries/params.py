"""Parameters of the retrace recovery, as a config file gives them."""

from __future__ import annotations

from navloom import Params
from pydantic import Field

__all__ = ["LookAroundParams", "RetraceParams"]


class RetraceParams(Params):
    """How far to go back and to turn. The README gives the source of each default."""

    distance: float = Field(
        0.4, ge=0.0, le=10.0, description="Distance back in the first attempt, m; n times in the n-th."
    )
    speed: float = Field(0.15, gt=0.0, le=5.0, description="Backward speed, m/s.")
    turn_deg: float = Field(
        90.0, ge=0.0, le=360.0, description="Turn after going back, from the second attempt on, degrees."
    )
    turn_rate_deg: float = Field(45.0, gt=0.0, le=360.0, description="Rate of that turn, degrees per second.")
    margin: float = Field(0.03, ge=0.0, le=1.0, description="Gap to keep to what is sensed, m.")
    noise: float = Field(
        0.04,
        ge=0.0,
        le=0.5,
        description="Largest error by which the nearest of many echoes is too near, m; the gate checks too.",
    )
    memory: float = Field(1.0, ge=0.0, le=60.0, description="How long an echo counts, s.")
    patience: float = Field(15.0, gt=0.0, le=600.0, description="Longest time of an attempt, s.")
    wait: float = Field(0.5, ge=0.0, le=600.0, description="Time stopped before an attempt ends, s.")
    clear_map: bool = Field(True, description="Ask the mapper to forget, so that phantoms do not block the next plan.")


class LookAroundParams(RetraceParams):
    """Those of `retrace`, and how to look around."""

    look_speed: float = Field(0.3, gt=0.0, le=5.0, description="Speed from place to place, m/s.")
    leg: float = Field(2.0, gt=0.0, le=50.0, description="Longest way from a place to the next, m.")
    look_time: float = Field(115.0, gt=0.0, le=600.0, description="Longest time of an attempt to look around, s.")
    look_way: float = Field(60.0, gt=0.0, le=1000.0, description="Longest way of an attempt to look around, m.")
