"""Parameters of the three methods. Defaults are engineering choices; `paper_literal()` lists the papers' values."""

from typing import Any, Literal

from navloom import Params
from pydantic import Field, model_validator


class HistogramParams(Params):
    """Parameters that the three methods share."""

    cell: float = Field(0.1, gt=0.0, le=0.5, description="Side of a certainty cell, m.")
    window: int = Field(33, ge=11, le=161, description="Cells along a side of the certainty window (33 in VFH).")
    count_up: int = Field(3, ge=1, le=15, description="Added to the cell of a reading (HIMM: 3, VFH: 1).")
    count_down: int = Field(1, ge=0, le=15, description="Taken off the cells before it (HIMM: 1, VFH: 0).")
    clear_margin: float = Field(0.1, ge=0.0, le=0.5, description="Not counted down before an echo, m. Paper: 0.")
    blind_depth: float = Field(
        0.1, ge=0.0, le=1.0, description="A reading at range_min counts this far before it too, m. Paper: 0."
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
    reach: float = Field(1.6, gt=0.2, le=8.0, description="Distance at which a cell's magnitude falls to 0, m.")
    stops_at_target: bool = Field(True, description="Cells farther than target and disc do not count. Paper: false.")
    widest_slot: int = Field(18, ge=2, le=72, description="s_max, sectors: a wider opening is followed along its edge.")
    turn_gain: float = Field(2.0, gt=0.0, le=50.0, description="Turn rate per heading error, 1/s; period * gain < 2.")
    max_turn_deg: float = Field(120.0, gt=0.0, le=360.0, description="Omega_max, degrees per second.")
    max_speed: float = Field(0.78, gt=0.0, le=3.0, description="V_max, m/s; the robot's own limit also applies.")
    min_speed: float = Field(0.04, ge=0.0, le=1.0, description="V_min, m/s: least speed that the density slows to.")
    slow_density: float = Field(4.0, gt=0.0, le=100.0, description="h_m: density ahead that slows to V_min.")
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
    arc_check: bool = Field(True, description="Roll the command forward and reduce it until it is free. Paper: false.")
    arc_margin: float = Field(0.12, ge=0.0, le=1.0, description="Margin between footprint and cell centres, m.")
    turn_horizon: float = Field(0.2, ge=0.0, le=2.0, description="Time a turn in place is rolled forward, s.")
    creep: float = Field(0.1, ge=0.0, le=1.0, description="Speed to leave a corner without room to turn, m/s.")


class VfhParams(HistogramParams):
    """Borenstein & Koren 1991. A value that the paper prints is the default, or the description names it."""

    smoothing: int = Field(1, ge=0, le=12, description="l, sectors: half width of the smoothing.")
    threshold: float = Field(0.3, gt=0.0, le=100.0, description="Density from which a sector is blocked.")


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


def paper_literal(name: str) -> dict[str, Any]:
    """Parameters with which one of the three methods follows the printed text, for comparison with the defaults.

    Args:
        name: vfh, vfh_plus or vfh_star.
    """
    literal: dict[str, Any] = {
        "clear_margin": 0.0,
        "blind_depth": 0.0,
        "agreement": 0.0,
        "stops_at_target": False,
        "arc_check": False,
        "creep": 0.0,
    }
    if name == "vfh":
        literal |= {"count_up": 1, "count_down": 0, "disc": "point", "reach": 2.26, "smoothing": 5}
    return literal
