"""Parameters of the three methods, and their presets: the papers' values, and the defaults, which are ours."""

from typing import Annotated, Any, Literal

from navloom import LEFT_OUT, Derivable, Params, Preset
from navloom_avoidance.histogram import window_reach
from pydantic import Field, model_validator


class HistogramParams(Params):
    """Parameters that the three methods share."""

    cell: float = Field(0.1, gt=0.0, le=0.5, description="Side of a certainty cell, m.")
    window: int = Field(33, ge=11, le=161, description="Cells along a side of the certainty window (33 in VFH).")
    count_up: int = Field(3, ge=1, le=15, description="Added to the cell of a reading (HIMM: 3, VFH: 1).")
    count_down: int = Field(1, ge=0, le=15, description="Taken off the cells before it (HIMM: 1, VFH: 0).")
    clear_margin: float = Field(0.1, ge=0.0, le=0.5, description="Not counted down before an echo, m.")
    blind_depth: float = Field(
        0.1, ge=0.0, le=1.0, description="A reading at range_min counts this far before it too, m."
    )
    agreement: float = Field(
        0.1, ge=0.0, le=1.0, description="Neighbouring readings of a laser this near to each other are averaged, m."
    )
    sectors: int = Field(72, ge=36, le=360, description="Sectors of the polar histogram (72: 5 degrees each).")
    disc: Literal["inscribed", "enclosing", "point"] = Field(
        "inscribed", description="Cells block the directions in which this disc of the footprint would meet them."
    )
    safety_distance: float = Field(
        0.1, ge=0.0, le=2.0, description="d_s: added to the disc's radius, m; a point stays a point."
    )
    reach: Annotated[float, Field(gt=0.2, le=8.0)] | Literal["window"] = Field(
        1.6, description="Distance at which a cell's magnitude falls to 0, m; window: d_max of VFH, its corner."
    )
    stops_at_target: bool = Field(True, description="Cells farther than target and disc do not count.")
    widest_slot: int = Field(18, ge=2, le=72, description="s_max, sectors: a wider opening is followed along its edge.")
    turn_gain: float = Field(2.0, gt=0.0, le=50.0, description="Turn rate per heading error, 1/s; period * gain < 2.")
    max_turn_deg: float = Field(120.0, gt=0.0, le=360.0, description="Omega_max, degrees per second.")
    max_speed: float = Field(0.78, gt=0.0, le=3.0, description="V_max, m/s; the robot's own limit also applies.")
    min_speed: float = Field(0.04, ge=0.0, le=1.0, description="V_min, m/s: least speed that the density slows to.")
    slow_density: float = Field(
        4.0, gt=0.0, le=100.0, description="h_m: density ahead, before smoothing, that slows to V_min."
    )
    rotation_deg: float = Field(
        100.0, gt=0.0, le=360.0, description="Size of one rotation when nothing is free, degrees."
    )
    attempts: int = Field(4, ge=1, le=100, description="Rotations without progress before the robot counts as trapped.")
    patience: float = Field(
        60.0, gt=0.0, le=3600.0, description="Time without progress before the robot counts as trapped, s."
    )
    blocked_patience: float = Field(1.0, gt=0.0, le=60.0, description="Time blocked before turning the other way, s.")
    progress_step: float = Field(0.1, gt=0.0, le=5.0, description="Approach to the target that counts as progress, m.")
    target_shift: float = Field(0.5, gt=0.0, le=5.0, description="Movement beyond which a target counts as new, m.")
    release_distance: float = Field(0.3, gt=0.0, le=5.0, description="Movement after which the trap is left, m.")
    release_deg: float = Field(45.0, gt=0.0, le=180.0, description="Turn after which the trap is left, degrees.")
    arc_check: bool = Field(True, description="Roll the command forward and reduce it until it is free.")
    arc_margin: float = Field(0.12, ge=0.0, le=1.0, description="Margin between footprint and cell centres, m.")
    turn_horizon: float = Field(0.2, ge=0.0, le=2.0, description="Time a turn in place is rolled forward, s.")
    creep: float = Field(0.1, ge=0.0, le=1.0, description="Speed to leave a corner without room to turn, m/s.")

    @property
    def d_max(self) -> float:
        """The reach, m."""
        return window_reach(self.window, self.cell) if self.reach == "window" else self.reach


class VfhParams(HistogramParams):
    """Borenstein & Koren 1991."""

    smoothing: int = Field(1, ge=0, le=12, description="l, sectors: half width of the smoothing.")
    threshold: float = Field(
        0.3, gt=0.0, le=100.0, description="Density of an obstacle, before smoothing, that blocks its sector."
    )


class VfhPlusParams(HistogramParams):
    """Ulrich & Borenstein 1998."""

    widest_slot: int = Field(16, ge=2, le=72, description="s_max, sectors: a wider opening is followed along its edge.")
    threshold_low: float = Field(0.2, ge=0.0, le=100.0, description="tau_low: a blocked sector is free below it.")
    threshold_high: float = Field(0.4, gt=0.0, le=100.0, description="tau_high: a free sector is blocked above it.")
    mask_certainty: int = Field(3, ge=0, le=14, description="Cells above this certainty block turning circles.")
    target_weight: float = Field(5.0, gt=0.0, le=100.0, description="mu_1, of the angle to the target; no unit.")
    heading_weight: float = Field(2.0, ge=0.0, le=100.0, description="mu_2, of the angle to the heading; no unit.")
    previous_weight: float = Field(2.0, ge=0.0, le=100.0, description="mu_3, of the angle to the last choice; no unit.")

    @model_validator(mode="after")
    def _is_led_by_the_target(self) -> "VfhPlusParams":
        if self.target_weight <= self.heading_weight + self.previous_weight:
            raise ValueError(
                f"target_weight {self.target_weight:g} must be more than heading_weight {self.heading_weight:g} and "
                f"previous_weight {self.previous_weight:g} together, or the robot may never turn to its target"
            )
        if self.threshold_low > self.threshold_high:
            raise ValueError(
                f"threshold_low {self.threshold_low:g} must not be more than threshold_high {self.threshold_high:g}"
            )
        return self


class VfhStarParams(VfhPlusParams):
    """Ulrich & Borenstein 2000."""

    window: int = Field(81, ge=11, le=161, description="Cells along a side: look_ahead * step + reach to each side.")
    look_ahead: int = Field(5, ge=1, le=20, description="n_g, steps looked ahead; 1 is VFH+.")
    step: float = Field(0.5, gt=0.0, le=5.0, description="d_s, length of a projected step, m.")
    discount: float = Field(0.8, gt=0.0, le=1.0, description="lambda, factor on the cost of each further step.")
    projected_target_weight: float = Field(
        5.0, gt=0.0, le=100.0, description="mu_1', of the angle to the target; no unit."
    )
    projected_heading_weight: float = Field(
        1.0, ge=0.0, le=100.0, description="mu_2', of the angle to the heading; no unit."
    )
    projected_previous_weight: float = Field(1.0, ge=0.0, le=100.0, description="mu_3', to the previous step; no unit.")
    node_limit: int = Field(400, ge=120, le=5000, description="Nodes of the search tree; bounds the time of a tick.")

    @model_validator(mode="after")
    def _has_an_admissible_heuristic(self) -> "VfhStarParams":
        others = self.projected_heading_weight + self.projected_previous_weight
        if self.projected_target_weight <= others:
            raise ValueError(
                f"projected_target_weight {self.projected_target_weight:g} must be more than projected_heading_weight "
                f"and projected_previous_weight together, {others:g}, or the search may miss the cheapest way"
            )
        return self


class VfhSweptParams(VfhStarParams):
    """VFH* for fast robots with a laser, ours."""

    safety_distance: float = Field(
        0.1, ge=0.0, le=2.0, description="d_s: added to the disc's radius where there are cells, m."
    )
    point_distance: float = Field(0.02, ge=0.0, le=2.0, description="The same where there are echo points alone, m.")
    max_turn_deg: Derivable[float] = Field(
        LEFT_OUT, gt=0.0, le=360.0, description="Omega_max, degrees per second; left out: the robot's own limit."
    )
    max_speed: Derivable[float] = Field(
        LEFT_OUT, gt=0.0, le=5.0, description="V_max, m/s; the robot's own limit also applies; left out: that."
    )
    echoes: Literal["points", "cells"] = Field(
        "points", description="A laser's echoes count as points at its resolution, or in the certainty cells."
    )
    memory: float = Field(20.0, ge=0.0, le=600.0, description="How long points out of a laser's sight count, s.")
    spacing: float = Field(0.05, gt=0.0, le=0.5, description="One point in a square of this counts in histograms, m.")
    point_margin: float = Field(0.05, ge=0.0, le=1.0, description="Margin between footprint and echo points, m.")
    point_floor: float = Field(
        0.02, ge=0.0, le=1.0, description="An echo point that is this near may come no nearer, m."
    )
    speed_law: Literal["free_run", "density"] = Field(
        "free_run", description="Speed by the run that is free on the arc, or by the density ahead."
    )
    turn_rates: int = Field(3, ge=0, le=20, description="Turn rates up to half of Omega_max that are tried.")
    horizon: float = Field(0.4, gt=0.0, le=5.0, description="Time after which a command's progress is compared, s.")
    nose: float = Field(0.3, ge=0.0, le=5.0, description="Weight of the heading error in that, m per rad.")
    keep_target: float = Field(
        3.0, ge=0.0, le=60.0, description="How long a seen way is kept if the path jumps to a longer one, s; 0: not."
    )
    back_up: float = Field(0.4, ge=0.0, le=5.0, description="Distance to back up when stuck, m; 0: never.")
    back_speed: float = Field(0.2, gt=0.0, le=1.0, description="Speed of backing up, m/s.")
    stuck_patience: float = Field(0.8, gt=0.0, le=60.0, description="Time without motion before backing up, s.")


ROBUST = Preset("our choice: for a robot with a size, sonars or a laser")

AS_VFH = "as VFH 1991, on which the method builds"
PLAIN: dict[str, tuple[Any, str]] = {
    "clear_margin": (0.0, "not in the paper"),
    "blind_depth": (0.0, "not in the paper"),
    "agreement": (0.0, "not in the paper"),
    "stops_at_target": (False, "not in the paper: every cell of the window counts"),
    "arc_check": (False, "not in the paper: the command is sent as it is"),
    "creep": (0.0, "not in the paper"),
}
"""What the papers leave out, and the defaults add."""

VFH_PRINTED = Preset(
    "Borenstein & Koren 1991",
    {
        "cell": (0.1, "squares of 10 cm"),
        "window": (33, "active window of 33 x 33"),
        "count_up": (1, "a reading adds 1 to one cell"),
        "count_down": (0, "readings only add"),
        "disc": ("point", "the robot is a point; the smoothing stands in for its width"),
        "sectors": (72, "alpha = 5 deg"),
        "reach": ("window", "a - b d_max = 0, d_max = sqrt(2) (ws - 1) / 2"),
        "smoothing": (5, "l = 5"),
        "threshold": (0.3, "not printed; decided: as for a robot with a size"),
        "widest_slot": (18, "s_max = 18"),
        "turn_gain": (2.0, "not printed; decided: as by default"),
        "max_turn_deg": (120.0, "Omega_max = 120 deg/s"),
        "max_speed": (0.78, "V_max = 0.78 m/s"),
        "min_speed": (0.04, "V_min = 4 cm/s"),
        "slow_density": (4.0, "h_m is not printed; decided: as by default"),
        **PLAIN,
    },
)

VFH_PLUS_PRINTED = Preset(
    "Ulrich & Borenstein 1998",
    {
        "cell": (0.1, AS_VFH),
        "window": (33, AS_VFH),
        "sectors": (72, "alpha = 5 deg"),
        "count_up": (3, "not printed; decided: HIMM, by one of the authors"),
        "count_down": (1, "not printed; decided: HIMM, by one of the authors"),
        "disc": ("inscribed", "r_r; a square robot turns within its half width only where there is room"),
        "safety_distance": (0.1, "d_s is not printed; decided: one cell"),
        "reach": (1.6, "half the window, (ws - 1) / 2 cells"),
        "widest_slot": (16, "s_max = 16"),
        "threshold_low": (0.2, "tau_low is not printed; decided: as by default"),
        "threshold_high": (0.4, "tau_high is not printed; decided: as by default"),
        "target_weight": (5.0, "mu_1 = 5"),
        "heading_weight": (2.0, "mu_2 = 2"),
        "previous_weight": (2.0, "mu_3 = 2"),
        "max_turn_deg": (120.0, AS_VFH),
        "max_speed": (0.78, AS_VFH),
        "min_speed": (0.04, AS_VFH),
        **PLAIN,
    },
)

VFH_STAR_PRINTED = Preset(
    "Ulrich & Borenstein 2000",
    {
        **VFH_PLUS_PRINTED.settings,
        "window": (81, "not printed; decided: n_g steps and the reach of VFH+ fit into it"),
        "look_ahead": (5, "n_g: goal depths of 1 to 10 were tried; decided: 5"),
        "step": (0.5, "d_s depends on the robot; decided: about its half width"),
        "discount": (0.8, "lambda = 0.8"),
        "projected_target_weight": (5.0, "mu_1' = 5"),
        "projected_heading_weight": (1.0, "mu_2' = 1"),
        "projected_previous_weight": (1.0, "mu_3' = 1"),
    },
)
