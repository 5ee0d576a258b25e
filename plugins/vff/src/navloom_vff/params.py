"""Parameters of the VFF, and its presets: the paper's values, and the defaults, which are ours."""

from typing import Literal

from navloom import Params, Preset
from pydantic import Field


class VffParams(Params):
    """Borenstein & Koren 1989."""

    cell: float = Field(0.1, gt=0.0, le=0.5, description="Side of a certainty cell, m.")
    window: int = Field(33, ge=11, le=161, description="Cells along a side of the certainty window (33 in the paper).")
    count_up: int = Field(3, ge=1, le=15, description="Added to the cell of a reading (HIMM: 3).")
    count_down: int = Field(1, ge=1, le=15, description="Taken off the cells before it (HIMM: 1).")
    clear_margin: float = Field(0.1, ge=0.0, le=0.5, description="Not counted down before an echo, m.")
    blind_depth: float = Field(
        0.1, ge=0.0, le=1.0, description="A reading at range_min counts this far before it too, m."
    )
    disc: Literal["enclosing", "inscribed", "point"] = Field(
        "enclosing", description="Distances are from this disc of the footprint, or from its centre."
    )
    balance: float = Field(
        0.25,
        gt=0.0,
        le=2.0,
        description="Distance from the body at which a cell of certainty 15 pushes as the target pulls, m.",
    )
    least_distance: float = Field(0.1, gt=0.0, le=1.0, description="Cells nearer than this push no harder, m.")
    stops_at_target: bool = Field(True, description="Cells farther than target and disc do not push.")
    damping: float = Field(0.25, ge=0.0, le=1.0, description="w, share of the force that is left along a wall.")
    may_pull: bool = Field(False, description="Obstacles behind pull, as in the damping formula.")
    turn_gain: float = Field(1.25, gt=0.0, le=50.0, description="K_s, turn rate per angle, 1/s.")
    time_constant: float = Field(0.4, ge=0.0, le=5.0, description="tau of the low-pass on the turn rate, s.")
    max_turn_deg: float = Field(120.0, gt=0.0, le=360.0, description="Limit of the turn rate, degrees per second.")
    max_speed: float = Field(0.78, gt=0.0, le=3.0, description="V_max, m/s; the robot's own limit also applies.")
    min_speed: float = Field(0.04, ge=0.0, le=1.0, description="Least speed that the forces slow to, m/s.")
    slow_force: float = Field(
        1.0, ge=0.0, le=100.0, description="Force at which slowing takes full effect, no unit; 0: always."
    )
    slows_leaving: bool = Field(False, description="Slow also when heading away from an obstacle.")
    slows_for_turns: bool = Field(True, description="Slow by the cosine of the turn to make.")
    trap_rule: Literal["forces", "heading"] = Field(
        "forces", description="A trap: heading and forces lead away from the target, or the heading alone."
    )
    hesitation: float = Field(
        4.0, gt=0.0, le=3600.0, description="Time without progress that also counts as a trap, s."
    )
    wall_angle_deg: float = Field(145.0, gt=90.0, lt=180.0, description="alpha, from F_r to the pull along a wall.")
    leave_rule: Literal["past", "heading"] = Field(
        "past", description="Follow until past the obstacle, or until the robot heads for the target."
    )
    patience: float = Field(
        60.0, gt=0.0, le=3600.0, description="Time without progress before the robot counts as trapped, s."
    )
    blocked_patience: float = Field(
        5.0, gt=0.0, le=60.0, description="Time blocked before the robot counts as trapped, s."
    )
    progress_step: float = Field(0.1, gt=0.0, le=5.0, description="Approach to the target that counts as progress, m.")
    target_shift: float = Field(0.5, gt=0.0, le=5.0, description="Movement beyond which a target counts as new, m.")
    release_distance: float = Field(0.3, gt=0.0, le=5.0, description="Movement after which the trap is left, m.")
    release_deg: float = Field(45.0, gt=0.0, le=180.0, description="Turn after which the trap is left, degrees.")
    arc_check: bool = Field(True, description="Roll the command forward and reduce it until it is free.")
    arc_margin: float = Field(0.12, ge=0.0, le=1.0, description="Margin between footprint and cell centres, m.")
    turn_horizon: float = Field(0.2, ge=0.0, le=2.0, description="Time a turn in place is rolled forward, s.")
    creep: float = Field(0.1, ge=0.0, le=1.0, description="Speed to leave a corner without room to turn, m/s.")
    sectors: int = Field(72, ge=8, le=360, description="Sectors of the force by direction in the diagnostics.")


ROBUST = Preset("our choice: the robot has a size, follows walls until past them, and slows for turns")

PRINTED = Preset(
    "Borenstein & Koren 1989; certainty by HIMM, by the same authors",
    {
        "cell": (0.1, "squares of 10 cm"),
        "window": (33, "active window of 33 x 33"),
        "count_up": (3, "HIMM: +3"),
        "count_down": (1, "HIMM: -1"),
        "clear_margin": (0.0, "not in the paper"),
        "blind_depth": (0.0, "not in the paper"),
        "disc": ("point", "d is the distance from the robot's centre"),
        "balance": (0.25, "F_cr is not printed; decided: the body counts from its half width"),
        "stops_at_target": (False, "not in the paper: every cell of the window pushes"),
        "damping": (0.25, "w = 0.25"),
        "may_pull": (True, "F' = w F + (1 - w) F (-cos theta), also where it is negative"),
        "turn_gain": (1.25, "K_s is not printed; decided: 1 / (2 tau), a damping of 0.71"),
        "time_constant": (0.4, "tau = 0.4 s"),
        "max_turn_deg": (120.0, "120 deg/s"),
        "max_speed": (0.78, "V_max = 0.78 m/s"),
        "slow_force": (0.0, "V = V_max (1 - |cos theta|) wherever there is a force"),
        "slows_leaving": (True, "|cos theta|: also when heading away"),
        "slows_for_turns": (False, "not in the paper"),
        "trap_rule": ("heading", "a trap is |theta_0 - theta_t| > 90 deg"),
        "hesitation": (3600.0, "not in the paper"),
        "wall_angle_deg": (145.0, "alpha is between 90 and 180 deg; decided: 145"),
        "leave_rule": ("heading", "until the robot heads for the target again"),
        "arc_check": (False, "not in the paper: the command is sent as it is"),
        "creep": (0.0, "not in the paper"),
    },
)
