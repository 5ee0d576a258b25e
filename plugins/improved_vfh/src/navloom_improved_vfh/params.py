"""Parameters of the improved VFH, and its presets: the paper's values, and the defaults, which are ours."""

from typing import Annotated, Literal

from navloom import Params, Preset
from navloom_avoidance.histogram import window_reach
from navloom_avoidance.support import LONGEST_MEMORY
from pydantic import Field


class ImprovedVfhParams(Params):
    """Hoang et al. 2013, III.C."""

    cell: float = Field(0.1, gt=0.0, le=0.5, description="Side of a certainty cell, m.")
    window: int = Field(33, ge=11, le=161, description="Cells along a side of the certainty window (33 in VFH).")
    reset_scope: Literal["cone", "window"] = Field(
        "cone", description="What a scan may set to 0: its own cones (memory survives), or everything."
    )
    conflict: Literal["seen_through", "echo"] = Field(
        "seen_through", description="Part of an arc that another cone of the sensor sees through: left out, or drawn."
    )
    blind_depth: float = Field(
        0.25, ge=0.0, le=1.0, description="A reading at range_min marks the cone this far before it too, m."
    )
    clears_blind_zone: bool = Field(
        True,
        description="Readings beyond range_min clear what is nearer: the sensor reports nearer things as range_min.",
    )
    clear_margin: float = Field(
        0.05, ge=0.0, le=0.5, description="Left uncleared before an echo and along a cone's flanks, m."
    )
    consistency: int = Field(
        0,
        ge=0,
        le=LONGEST_MEMORY,
        description="An echo of a cone counts only if one of this many scans before supports it, scans.",
    )
    clears_footprint: bool = Field(True, description="Cells deep under the robot are set to 0.")
    agreement: float = Field(
        0.1, ge=0.0, le=1.0, description="Neighbouring readings of a laser this near to each other are averaged, m."
    )
    sectors: int = Field(72, ge=36, le=360, description="Sectors of the polar histogram (72: 5 degrees each).")
    reach: Annotated[float, Field(gt=0.2, le=8.0)] | Literal["window"] = Field(
        1.3, description="Distance at which a cell's magnitude falls to 0, m; window: d_max of VFH, its corner."
    )
    threshold: float = Field(
        0.12,
        gt=0.0,
        lt=10.0,
        description="Density of an obstacle, before smoothing, that blocks its sector; 1: an axis cell at the robot.",
    )
    enlargement: Literal["footprint", "none"] = Field(
        "footprint",
        description="Shade cells by arcsin(radius / d) as in VFH+, or sum and smooth them as in VFH.",
    )
    safety_distance: float = Field(
        0.05, ge=0.0, le=2.0, description="d_s: added to the footprint's half width for the enlargement, m."
    )
    smoothing: int = Field(
        5, ge=0, le=12, description="l, half width of the smoothing, sectors; used where enlargement is none."
    )
    normalisation: Literal["arc", "none"] = Field(
        "arc", description="Divide by the cells an arc has in a sector, or not; where enlargement is none."
    )
    stops_at_target: bool = Field(True, description="Cells farther than the target and the radius do not count.")
    widest_slot: int = Field(
        18, ge=2, le=72, description="s_max, sectors: slots up to this width are driven in the middle."
    )
    inset: float = Field(9.0, ge=0.0, le=36.0, description="Offset inside a wide slot's edge, sectors (s_max / 2).")
    slot_window_deg: float = Field(
        100.0, gt=0.0, le=180.0, description="Slots within this of the heading count, degrees."
    )
    case_limit_deg: float = Field(
        90.0,
        gt=0.0,
        le=180.0,
        description="Nearest to the target below this angle, else nearest to the heading, degrees.",
    )
    loyalty_deg: float = Field(20.0, ge=0.0, le=90.0, description="Preference for the direction chosen last, degrees.")
    rotation_deg: float = Field(
        100.0, gt=0.0, le=360.0, description="Size of one rotation when there is no slot, degrees."
    )
    attempts: int = Field(4, ge=1, le=100, description="Rotations without progress before the robot counts as trapped.")
    patience: float = Field(
        30.0, gt=0.0, le=3600.0, description="Time without progress before the robot counts as trapped, s."
    )
    progress_step: float = Field(0.1, gt=0.0, le=5.0, description="Approach to the target that counts as progress, m.")
    target_shift: float = Field(0.5, gt=0.0, le=5.0, description="Movement beyond which a target counts as new, m.")
    release_distance: float = Field(0.3, gt=0.0, le=5.0, description="Movement after which the trap is left, m.")
    release_deg: float = Field(45.0, gt=0.0, le=180.0, description="Turn after which the trap is left, degrees.")
    turn_gain: float = Field(10.0, gt=0.0, le=50.0, description="omega per heading error, 1/s; period * gain < 2.")
    max_turn_deg: float = Field(25.0, gt=0.0, le=180.0, description="Limit of omega, degrees per second.")
    max_speed: float = Field(0.5, gt=0.0, le=3.0, description="V_max, m/s; the robot's own limit also applies.")
    speed_gain: float = Field(5.0, gt=0.0, le=50.0, description="V per metre of d30 beyond the standoff, 1/s.")
    standoff: float = Field(0.4, ge=0.0, le=3.0, description="d30 at which V is 0, m.")
    front_sector_deg: float = Field(30.0, gt=0.0, le=90.0, description="Half the sector of d30, degrees.")
    distance_from: Literal["front", "centre"] = Field(
        "front", description="Where d30 starts: at the robot's front, or at its centre."
    )
    brakes: bool = Field(True, description="Cap V so that the robot can stop in the free run.")
    slow_factor: float = Field(2.5, ge=1.0, le=20.0, description="V is divided by this while turning.")
    slow_on_deg: float = Field(10.0, gt=0.0, le=180.0, description="Turning starts at this omega, degrees per second.")
    slow_off_deg: float = Field(8.0, gt=0.0, le=180.0, description="Turning ends below this omega, degrees per second.")
    pivot_deg: float = Field(
        45.0,
        gt=0.0,
        le=180.0,
        description="No forward speed while theta_d is farther off the heading, degrees.",
    )
    arc_check: bool = Field(True, description="Roll the command forward and reduce it until it is free.")
    arc_margin: float = Field(0.12, ge=0.0, le=1.0, description="Margin between footprint and cell centres, m.")
    laser_cell: float = Field(
        0.05, gt=0.0, le=0.5, description="cell of a robot whose range sensors are lasers, m; the window stays as wide."
    )
    laser_safety_distance: float = Field(0.03, ge=0.0, le=2.0, description="safety_distance of such a robot, m.")
    laser_margin: float = Field(0.06, ge=0.0, le=1.0, description="arc_margin of such a robot, m.")
    laser_floor: float = Field(
        0.02, ge=0.0, le=1.0, description="Smaller margin kept where the robot is already within laser_margin, m."
    )
    turn_horizon: float = Field(0.2, ge=0.0, le=2.0, description="Time a turn in place is rolled forward, s.")
    creep: float = Field(0.1, ge=0.0, le=1.0, description="Speed to leave a corner without room to turn, m/s.")
    blocked_patience: float = Field(1.0, gt=0.0, le=60.0, description="Time blocked before turning the other way, s.")

    @property
    def d_max(self) -> float:
        """The reach, m."""
        return window_reach(self.window, self.cell) if self.reach == "window" else self.reach


ROBUST = Preset("our choice: the robot has a size, and brakes")

PRINTED = Preset(
    "Hoang et al. 2013, III.C; where it inherits from VFH, Borenstein & Koren 1991",
    {
        "cell": (0.1, "VFH: squares of 10 cm"),
        "window": (33, "VFH: active window of 33 x 33"),
        "reset_scope": ("window", "III.C: other squares are assigned the value 0"),
        "conflict": ("echo", "not in the paper: each reading is drawn whole"),
        "blind_depth": (0.0, "not in the paper"),
        "clear_margin": (0.0, "not in the paper"),
        "consistency": (0, "not in the paper: each reading counts at once"),
        "clears_footprint": (False, "not in the paper"),
        "agreement": (0.0, "not in the paper"),
        "sectors": (72, "VFH: alpha = 5 deg"),
        "reach": ("window", "VFH: a - b d_max = 0, d_max = sqrt(2) (ws - 1) / 2"),
        "threshold": (0.53, "not printed; decided: the echo (2, 3, 2) blocks from 1.5 m, 59 in the units of VFH"),
        "enlargement": ("none", "VFH: the robot is a point, densities are summed and smoothed"),
        "smoothing": (5, "VFH: l = 5"),
        "normalisation": ("none", "VFH: the plain sum"),
        "stops_at_target": (False, "not in the paper"),
        "widest_slot": (18, "VFH: s_max = 18"),
        "inset": (9.0, "VFH: s_max / 2 inside the edge of a wide slot"),
        "slot_window_deg": (100.0, "III.C, step 1: |theta - theta_d| < 100 deg"),
        "case_limit_deg": (90.0, "III.C, cases 1 and 2: |theta - theta_t| < 90 deg or not"),
        "loyalty_deg": (0.0, "not in the paper"),
        "rotation_deg": (100.0, "III.C, step 2: a rotation by 100 deg"),
        "turn_gain": (10.0, "III.C: omega = 10 (theta_d - theta)"),
        "max_turn_deg": (25.0, "III.C: |omega| <= 25 deg/s"),
        "max_speed": (0.5, "III.C: V_max = 0.5 m/s"),
        "speed_gain": (5.0, "III.C: V = 5 (d30 - 0.4) m/s"),
        "standoff": (0.4, "III.C: V = 5 (d30 - 0.4) m/s"),
        "front_sector_deg": (30.0, "III.C: d30 within -30 to 30 deg"),
        "distance_from": ("centre", "III.C: d30 in the polar coordinates of the robot"),
        "brakes": (False, "not in the paper"),
        "slow_factor": (2.5, "III.C: V* = V / 2.5"),
        "slow_on_deg": (10.0, "III.C: from omega = 10 deg/s on"),
        "slow_off_deg": (10.0, "III.C: one limit, no hysteresis"),
        "pivot_deg": (180.0, "not in the paper: the robot never turns in place towards a slot"),
        "arc_check": (False, "not in the paper: the command is sent as it is"),
        "laser_cell": (0.1, "the paper has sonars only; decided: the cells of the sonars"),
        "creep": (0.0, "not in the paper"),
    },
)
