"""Parameters of the dynamic window, and its presets: the paper's values, and the defaults, which are ours."""

from typing import Literal

from navloom import LEFT_OUT, Derivable, Params, Preset
from navloom_avoidance.echoes import EchoSettings
from pydantic import Field


class DwaParams(Params):
    """Fox, Burgard & Thrun 1997, and the critics of Nav2's DWB."""

    objective: Literal["critics", "1997"] = Field(
        "critics", description="Critics of Nav2's DWB, or the paper's objective."
    )
    arcs: int = Field(41, ge=3, le=201, description="Arcs on which the window is sampled.")
    speeds: int = Field(20, ge=2, le=100, description="Speeds on each arc.")
    window_time: float = Field(0.25, gt=0.0, le=5.0, description="Time in which the window can be reached, s.")
    max_speed: Derivable[float] = Field(
        LEFT_OUT, gt=0.0, le=20.0, description="Forward speed, m/s; at most the robot's own limit; left out: that."
    )
    max_turn_deg: Derivable[float] = Field(
        LEFT_OUT,
        gt=0.0,
        le=720.0,
        description="Turn rate, degrees per second; at most the robot's own limit; left out: that.",
    )
    turn_acceleration_deg: float = Field(
        180.0, gt=0.0, le=3600.0, description="Change of the turn rate, degrees per s^2: window, ramp and braking."
    )
    wheel_speed: float = Field(
        0.0, ge=0.0, le=20.0, description="Highest speed of a wheel's rim, m/s: |v| + half track |w|; 0 is no limit."
    )
    shape: Literal["polygon", "disc"] = Field(
        "polygon", description="Contact on arcs is that of the footprint, or of the disc that encloses it."
    )
    farthest: float = Field(4.0, gt=0.0, le=20.0, description="Obstacles farther along an arc do not count, m.")
    laser_margin: float = Field(0.05, ge=0.0, le=1.0, description="Margin between footprint and laser points, m.")
    sonar_margin: float = Field(0.12, ge=0.0, le=1.0, description="Margin between footprint and sonar cell centres, m.")
    reacts: bool = Field(True, description="Assume braking one tick later.")
    roll_check: bool = Field(True, description="Roll the chosen command forward with its ramps.")
    memory: float = Field(20.0, ge=0.0, le=3600.0, description="How long points out of a laser's sight count, s.")
    reach: float = Field(4.0, ge=0.5, le=20.0, description="Laser points farther away than this are dropped, m.")
    spacing: float = Field(0.03, ge=0.005, le=0.2, description="One remembered point is kept in a square of this, m.")
    agreement: float = Field(
        0.1, ge=0.0, le=1.0, description="Neighbouring readings of a laser this near to each other are averaged, m."
    )
    cone_cell: float = Field(0.1, gt=0.0, le=0.5, description="Side of a cell of the sonars' window, m.")
    cone_window: int = Field(41, ge=11, le=161, description="Cells along a side of the sonars' window.")
    cone_reach: float = Field(
        0.95, ge=0.0, le=10.0, description="Sonar arcs count up to here from the base, m; axes always."
    )
    blind_depth: float = Field(
        0.25, ge=0.0, le=1.0, description="An echo at range_min counts this far before it too, m."
    )
    cell: float = Field(0.1, ge=0.02, le=0.5, description="Side of a cell of the cost field, m.")
    field: int = Field(81, ge=21, le=301, description="Cells along a side of the cost field.")
    soft: float = Field(0.3, gt=0.0, le=3.0, description="Width beyond the inscribed disc over which costs fall, m.")
    soft_weight: float = Field(3.0, ge=0.0, le=20.0, description="Added to the cost per metre at that disc.")
    horizon: float = Field(2.0, gt=0.0, le=10.0, description="Critics look this far along an arc, s.")
    nose: float = Field(0.3, ge=0.0, le=2.0, description="The align critics score this far ahead of the base, m.")
    capture: float = Field(0.3, gt=0.0, le=5.0, description="Distance at which a target before the goal is passed, m.")
    goal_distance: float = Field(
        1.0, ge=0.0, le=100.0, description="Weight of the cost to the target around obstacles."
    )
    goal_align: float = Field(1.0, ge=0.0, le=100.0, description="The same at the nose, no unit.")
    path_distance: float = Field(0.1, ge=0.0, le=100.0, description="Weight of the distance from the targets' trail.")
    path_align: float = Field(0.1, ge=0.0, le=100.0, description="The same at the nose, no unit.")
    obstacle: float = Field(0.5, ge=0.0, le=100.0, description="Weight of the nearness of obstacles, m.")
    contact: float = Field(0.5, ge=0.0, le=100.0, description="Weight of a contact within the horizon, m.")
    turning: float = Field(0.02, ge=0.0, le=100.0, description="Weight of the turn rate, m per rad/s.")
    track: float = Field(10.0, ge=0.0, le=1000.0, description="Weight of a contact with a track, m.")
    track_margin: float = Field(0.1, ge=0.0, le=2.0, description="Margin between footprint and tracks, m.")
    sigmas: float = Field(
        1.0,
        ge=0.0,
        le=5.0,
        description="Standard deviations of a track's predicted place that widen `soft` for it, no unit.",
    )
    slow: float = Field(0.05, ge=0.0, le=1.0, description="Below this a turn counts as in place, m/s.")
    oscillation_distance: float = Field(
        0.1, ge=0.0, le=5.0, description="Distance after which a turn may be reversed, m."
    )
    oscillation_deg: float = Field(
        60.0, ge=0.0, le=360.0, description="Turn after which it may be reversed too, degrees."
    )
    rotate_within: float = Field(
        0.5, ge=0.0, le=5.0, description="Distance to the target below which to turn first, m."
    )
    rotate_deg: float = Field(60.0, gt=0.0, le=180.0, description="Heading error above which to do so, degrees.")
    alpha: float = Field(1.0, ge=0.0, le=100.0, description="1997: weight of the heading.")
    beta: float = Field(1.0, ge=0.0, le=100.0, description="1997: weight of the distance to the next obstacle.")
    gamma: float = Field(0.2, ge=0.0, le=100.0, description="1997: weight of the speed.")
    back_up: float = Field(0.4, ge=0.0, le=3.0, description="Distance to back up when blocked, m; 0: never.")
    back_speed: float = Field(0.15, gt=0.0, le=1.0, description="Speed of backing up, m/s.")
    back_ups: int = Field(4, ge=0, le=50, description="How often it backs up without progress.")
    blocked_patience: float = Field(1.5, gt=0.0, le=60.0, description="Time blocked before the robot backs up, s.")
    patience: float = Field(
        60.0, gt=0.0, le=3600.0, description="Time without progress before the robot counts as trapped, s."
    )
    progress_step: float = Field(0.1, gt=0.0, le=5.0, description="Approach to the target that counts as progress, m.")
    target_shift: float = Field(0.5, gt=0.0, le=5.0, description="Movement beyond which a target counts as new, m.")
    release_distance: float = Field(0.3, gt=0.0, le=5.0, description="Movement after which the trap is left, m.")
    release_deg: float = Field(45.0, gt=0.0, le=180.0, description="Turn after which the trap is left, degrees.")
    sectors: int = Field(72, ge=8, le=360, description="Directions of the costs in the diagnostics.")

    def echoes(self) -> EchoSettings:
        """What is remembered of the scans."""
        return EchoSettings(
            (self.laser_margin, self.sonar_margin), self.memory, self.reach, self.spacing, self.agreement,
            self.cone_cell, self.cone_window, self.cone_reach, self.blind_depth,
        )  # fmt: skip


ROBUST = Preset("our choice: the critics of Nav2's DWB, the true footprint, braking with the motors' lag")

PRINTED = Preset(
    "Fox, Burgard & Thrun 1997",
    {
        "objective": ("1997", "G = sigma(alpha heading + beta dist + gamma velocity)"),
        "window_time": (0.25, "a cycle of 0.25 s"),
        "max_speed": (0.95, "95 cm/s"),
        "max_turn_deg": (90.0, "90 deg/s"),
        "turn_acceleration_deg": (60.0, "60 deg/s^2"),
        "shape": ("disc", "the robot is a disc"),
        "farthest": (4.0, "the distance of no obstacle is not printed; decided: 4 m"),
        "reacts": (False, "not in the paper: braking starts at once"),
        "roll_check": (False, "not in the paper: the command is sent as it is"),
        "memory": (0.0, "not in the paper: the obstacles of the newest readings"),
        "agreement": (0.0, "not in the paper"),
        "alpha": (2.0, "alpha = 2.0, as the literature quotes it"),
        "beta": (0.2, "beta = 0.2, as the literature quotes it"),
        "gamma": (0.2, "gamma = 0.2, as the literature quotes it"),
        "cone_window": (81, "the paper uses every reading; decided: the range of the sonars, 4 m"),
        "cone_reach": (4.0, "the paper uses every reading; decided: the range of the sonars, 4 m"),
        "back_up": (0.0, "not in the paper: it never backs up"),
    },
)
