"""Parameters of the trackers."""

from __future__ import annotations

from typing import Self

from navloom import Params
from pydantic import Field, model_validator

__all__ = ["FierroLewisParams", "KanayamaParams", "PurePursuitParams", "RamseteParams", "TrackerParams"]


class TrackerParams(Params):
    """Parameters that all trackers share."""

    turn_in_place_above_deg: float = Field(
        60.0, gt=0.0, le=180.0, description="Heading error that starts a turn in place, degrees; 180: never."
    )
    turn_in_place_until_deg: float = Field(20.0, ge=2.0, description="Heading error that ends it, degrees.")
    approach_deg: float = Field(
        45.0, gt=0.0, le=90.0, description="Largest angle to head back to the path, degrees; 90: as the law gives."
    )
    max_wheel_speed: float | None = Field(
        None, gt=0.0, le=1000.0, description="Highest speed of a wheel, rad/s; left out: the robot's own limits only."
    )
    may_reverse: bool = Field(False, description="Drive backwards where the law asks for it.")

    @model_validator(mode="after")
    def _ends_below_its_start(self) -> Self:
        if self.turn_in_place_until_deg >= self.turn_in_place_above_deg:
            raise ValueError(
                f"turn_in_place_until_deg is {self.turn_in_place_until_deg:g}, expected less than "
                f"turn_in_place_above_deg, {self.turn_in_place_above_deg:g}"
            )
        return self


class KanayamaParams(TrackerParams):
    """Gains of eq. (8) of Kanayama et al. 1990."""

    k_x: float = Field(1.0, gt=0.0, le=50.0, description="Gain of the longitudinal error, 1/s (10 in the paper).")
    k_y: float = Field(64.0, gt=0.0, le=1000.0, description="Gain of the lateral error, 1/m².")
    k_theta: float | None = Field(
        None, gt=0.0, le=100.0, description="Gain of the heading error, 1/m; left out: critical, 2 sqrt(k_y)."
    )


class FierroLewisParams(TrackerParams):
    """Gains of the kinematic law and of the velocity loop, Fierro & Lewis 1997."""

    k1: float = Field(1.0, gt=0.0, le=50.0, description="Gain of the longitudinal error, 1/s (10 in the paper).")
    k2: float = Field(5.0, gt=0.0, le=1000.0, description="Gain of the lateral error, 1/m².")
    k3: float = Field(4.0, gt=0.0, le=100.0, description="Gain of the heading error, 1/m.")
    k4: float = Field(40.0, gt=0.0, le=1000.0, description="Rate at which the velocity follows, 1/s.")


class RamseteParams(TrackerParams):
    """Gains of the nonlinear tracker of De Luca et al. 2001."""

    b: float = Field(16.0, gt=0.0, le=1000.0, description="Gain of the lateral error, 1/m².")
    zeta: float = Field(0.7, gt=0.0, le=5.0, description="Damping of the lateral error.")


class PurePursuitParams(TrackerParams):
    """Look-ahead and regulation of speed, Macenski et al. 2023."""

    look_ahead_time: float = Field(1.5, gt=0.0, le=10.0, description="Look-ahead distance per speed, s.")
    min_look_ahead: float = Field(0.5, gt=0.0, le=10.0, description="Least look-ahead, m.")
    max_look_ahead: float = Field(0.9, gt=0.0, le=50.0, description="Largest look-ahead, m.")
    slow_radius: float = Field(0.9, gt=0.0, le=50.0, description="Arcs tighter than this are driven more slowly, m.")
    min_arc_speed: float = Field(0.1, gt=0.0, le=5.0, description="Least speed on such arcs, m/s.")
    approach_distance: float = Field(
        0.6, gt=0.0, le=10.0, description="Remaining distance below which the robot slows down, m."
    )
    min_approach_speed: float = Field(0.05, gt=0.0, le=5.0, description="Least speed near the end, m/s.")

    @model_validator(mode="after")
    def _bounds_rise(self) -> Self:
        if self.min_look_ahead > self.max_look_ahead:
            raise ValueError(
                f"min_look_ahead is {self.min_look_ahead:g} m, expected at most max_look_ahead, "
                f"{self.max_look_ahead:g} m"
            )
        return self
