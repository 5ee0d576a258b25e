"""Parameters of the trackers, and their presets: the papers' values, and the defaults, which are ours."""

from __future__ import annotations

from typing import Any, Self

from navloom import LEFT_OUT, Derivable, Params, Preset
from pydantic import Field, model_validator

__all__ = [
    "DERIVED",
    "FIERRO_LEWIS_PRINTED",
    "GRACEFUL_PRINTED",
    "KANAYAMA_PRINTED",
    "PURE_PURSUIT_PRINTED",
    "RAMSETE_PRINTED",
    "ROBUST",
    "FierroLewisParams",
    "GracefulParams",
    "KanayamaParams",
    "PurePursuitParams",
    "RamseteParams",
    "RegulatedPurePursuitParams",
    "TrackerParams",
]


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

    k_x: float = Field(1.0, gt=0.0, le=50.0, description="Gain of the longitudinal error, 1/s.")
    k_y: float = Field(64.0, gt=0.0, le=1000.0, description="Gain of the lateral error, 1/m².")
    k_theta: Derivable[float] = Field(
        LEFT_OUT, gt=0.0, le=100.0, description="Gain of the heading error, 1/m; left out: critical, 2 sqrt(k_y)."
    )


class FierroLewisParams(TrackerParams):
    """Gains of the kinematic law and of the velocity loop, Fierro & Lewis 1997."""

    k1: float = Field(1.0, gt=0.0, le=50.0, description="Gain of the longitudinal error, 1/s.")
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


class _DerivedParams(TrackerParams):
    """Look-ahead and approach of a law whose lengths follow from the robot where they are left out."""

    look_ahead_time: Derivable[float] = Field(
        LEFT_OUT, gt=0.0, le=10.0, description="Look-ahead distance per speed, s; left out: from the robot's lags."
    )
    min_look_ahead: Derivable[float] = Field(
        LEFT_OUT, gt=0.0, le=10.0, description="Least look-ahead, m; left out: half the inscribed radius."
    )
    max_look_ahead: Derivable[float] = Field(
        LEFT_OUT, gt=0.0, le=50.0, description="Largest look-ahead, m; left out: that of the robot's largest speed."
    )
    approach_distance: Derivable[float] = Field(
        LEFT_OUT,
        gt=0.0,
        le=10.0,
        description="Remaining distance below which the robot slows down, m; left out: braking.",
    )
    min_approach_speed: float = Field(0.05, gt=0.0, le=5.0, description="Least speed near the end, m/s.")

    @model_validator(mode="after")
    def _bounds_rise(self) -> Self:
        given = {key: getattr(self, key) for key in ("min_look_ahead", "max_look_ahead")}
        if None not in given.values() and self.min_look_ahead > self.max_look_ahead:
            raise ValueError(
                "min_look_ahead is {:g} m, expected at most max_look_ahead, {:g} m".format(*given.values())
            )
        return self


class RegulatedPurePursuitParams(_DerivedParams):
    """Regulated pure pursuit, Macenski et al. 2023, by the limits of the robot."""

    slow_radius: Derivable[float] = Field(
        LEFT_OUT,
        gt=0.0,
        le=50.0,
        description="Arcs tighter than this are driven more slowly, m; left out: largest speed over largest turn rate.",
    )
    min_arc_speed: float = Field(0.0, ge=0.0, le=5.0, description="Least speed on such arcs, m/s.")


class GracefulParams(_DerivedParams):
    """Gains of the smooth control law of Park & Kuipers 2011."""

    k1: float = Field(1.0, gt=0.0, le=20.0, description="Ratio of the rate of θ to that of the distance.")
    k2: float = Field(3.0, gt=0.0, le=20.0, description="Ratio of the rate of the heading to that of the distance.")
    beta: Derivable[float] = Field(
        LEFT_OUT, ge=0.0, le=100.0, description="Weight of the curvature in the speed, m^exponent; left out: turn rate."
    )
    exponent: float = Field(2.0, gt=1.0, le=10.0, description="Exponent of the curvature in the speed.")
    keeps_turn_rate: bool = Field(
        True, description="In tighter arcs than those of the largest turn rate, keep that turn rate; false: as printed."
    )


ROBUST = Preset("our choice: an angle of approach, and turns in place")

DERIVED = Preset("our choice: as the others, with lengths that follow from the robot")

PLAIN: dict[str, tuple[Any, str]] = {
    "turn_in_place_above_deg": (180.0, "not in the paper: the law alone turns the robot"),
    "approach_deg": (90.0, "not in the paper: the law alone leads back to the path"),
    "may_reverse": (True, "not restricted in the paper"),
}
"""What the papers leave out, and the defaults add."""

KANAYAMA_PRINTED = Preset(
    "Kanayama, Kimura, Miyazaki & Noguchi 1990",
    {
        "k_x": (10.0, "K_x = 10 /s"),
        "k_y": (64.0, "K_y = 6.4e-3 /cm^2"),
        "k_theta": (16.0, "K_theta = 0.16 /cm, critical by eq. (20)"),
        **PLAIN,
    },
)

FIERRO_LEWIS_PRINTED = Preset(
    "Fierro & Lewis 1997",
    {
        "k1": (10.0, "k_1 = 10"),
        "k2": (5.0, "k_2 = 5"),
        "k3": (4.0, "k_3 = 4"),
        "k4": (40.0, "not known to us; decided: faster than a tick"),
        **PLAIN,
    },
)

RAMSETE_PRINTED = Preset(
    "De Luca, Oriolo & Vendittelli 2001",
    {
        "b": (16.0, "b > 0; decided: 16, which settles in 2.4 s from 0.3 m"),
        "zeta": (0.7, "zeta in (0, 1); decided: 0.7"),
        **PLAIN,
    },
)

PURE_PURSUIT_PRINTED = Preset(
    "Macenski, Singh, Martin & Gines 2023, with the values that their controller in Nav2 ships",
    {
        "turn_in_place_above_deg": (45.0, "rotate_to_heading_min_angle = 0.785 rad"),
        "approach_deg": (90.0, "not in the paper: the arc to the point alone leads back to the path"),
        "look_ahead_time": (1.5, "lookahead_time = 1.5 s"),
        "min_look_ahead": (0.3, "min_lookahead_dist = 0.3 m"),
        "max_look_ahead": (0.9, "max_lookahead_dist = 0.9 m"),
        "slow_radius": (0.9, "regulated_linear_scaling_min_radius = 0.9 m"),
        "min_arc_speed": (0.25, "regulated_linear_scaling_min_speed = 0.25 m/s"),
        "approach_distance": (0.6, "approach_velocity_scaling_dist = 0.6 m"),
        "min_approach_speed": (0.05, "min_approach_linear_velocity = 0.05 m/s"),
    },
)

GRACEFUL_PRINTED = Preset(
    "Park & Kuipers 2011, as the literature quotes it",
    {
        "k1": (1.0, "k_1 = 1"),
        "k2": (3.0, "k_2 = 3"),
        "beta": (0.4, "beta = 0.4"),
        "exponent": (2.0, "lambda = 2"),
        "keeps_turn_rate": (False, "not in the paper: the turn rate falls"),
        "turn_in_place_above_deg": PLAIN["turn_in_place_above_deg"],
        "approach_deg": PLAIN["approach_deg"],
    },
)
