"""Parameters of MPPI. What follows from the robot (speeds, accelerations, lag, footprint) is not one of them."""

from navloom import LEFT_OUT, Derivable, Params, Preset
from pydantic import Field


class MppiParams(Params):
    """Williams et al. 2017, and the critics of Nav2's MPPI controller."""

    samples: int = Field(2000, ge=2, le=10000, description="Roll-outs in each tick; an odd number is rounded up.")
    steps: int = Field(56, ge=8, le=200, description="Steps of a roll-out.")
    step: float = Field(0.05, ge=0.01, le=0.5, description="Duration of a step, s.")
    hold: int = Field(7, ge=1, le=50, description="Steps between two noise values; 1 is white noise.")
    temperature: float = Field(0.3, gt=0.0, le=100.0, description="Lambda of the weights, unit of the costs.")
    gamma: float = Field(0.015, ge=0.0, le=10.0, description="Weight of the control cost.")
    noise_speed: float = Field(
        0.25, gt=0.0, le=2.0, description="Standard deviation of the speed, as a share of the highest, no unit."
    )
    noise_turn: float = Field(
        0.25, gt=0.0, le=2.0, description="Standard deviation of the turn rate, as a share of the highest, no unit."
    )
    reverse: float = Field(0.35, ge=0.0, le=5.0, description="Highest speed backwards, m/s.")
    turning_radius: Derivable[float] = Field(
        LEFT_OUT, ge=0.0, le=100.0, description="Smallest radius, m; 0: it turns in place; left out: the robot's."
    )
    constraint: float = Field(4.0, ge=0.0, le=1000.0, description="Weight of commands beyond the limits.")
    collision: float = Field(1000.0, ge=0.0, le=1e6, description="Weight of a collision.")
    obstacle: float = Field(4.0, ge=0.0, le=1000.0, description="Weight of the nearness of obstacles.")
    goal: float = Field(
        28.0, ge=0.0, le=1000.0, description="Weight of the distance from the goal near it, per longest way, no unit."
    )
    goal_angle: float = Field(
        3.0, ge=0.0, le=1000.0, description="Weight of the deviation from the goal's heading, 1/rad."
    )
    path_align: float = Field(1.0, ge=0.0, le=1000.0, description="Weight of the distance from the path, 1/m.")
    path_follow: float = Field(
        28.0, ge=0.0, le=1000.0, description="Weight of the way left, per longest way of a roll-out, no unit."
    )
    path_angle: float = Field(2.0, ge=0.0, le=1000.0, description="Weight of looking away from the path, 1/rad.")
    prefer_forward: float = Field(
        40.0, ge=0.0, le=1000.0, description="Weight of the speed backwards, per highest speed, no unit."
    )
    twirling: float = Field(0.6, ge=0.0, le=1000.0, description="Weight of the turn rate, per highest, no unit.")
    goal_within: Derivable[float] = Field(
        LEFT_OUT,
        ge=0.0,
        le=20.0,
        description="Distance from the goal at which its critic replaces those of the path, m; left out: the stopping "
        "distance, or twice the distance of the farthest corner.",
    )
    turn_beyond_deg: float = Field(
        60.0,
        gt=0.0,
        le=180.0,
        description="Bearing of the path ahead beyond which the path angle critic acts, degrees.",
    )
    soft: float = Field(0.3, gt=0.0, le=3.0, description="Width beyond the margin over which obstacles cost, m.")
    soft_weight: float = Field(
        3.0, ge=0.0, le=20.0, description="Added to the cost per metre of the way left at an obstacle."
    )
    laser_margin: float = Field(0.05, ge=0.0, le=1.0, description="Margin between footprint and laser points, m.")
    sonar_margin: float = Field(0.12, ge=0.0, le=1.0, description="Margin between footprint and sonar cell centres, m.")
    track_margin: float = Field(0.05, ge=0.0, le=2.0, description="Margin between footprint and tracks, m.")
    sigmas: float = Field(
        1.0,
        ge=0.0,
        le=5.0,
        description="Standard deviations of a track's predicted place that widen `soft` for it, no unit.",
    )
    track_clearance: float = Field(
        0.3, gt=0.0, le=3.0, description="Gap beyond the margin below which the nearness of tracks counts most, m."
    )
    headway: float = Field(0.7, ge=0.0, le=5.0, description="Time for which a track's speed widens `soft` for it, s.")
    body: float = Field(
        10.0, ge=0.0, le=1000.0, description="Weight of the nearness of tracks, as a multiple of `obstacle`, no unit."
    )
    memory: float = Field(20.0, ge=0.0, le=3600.0, description="How long points out of a laser's sight count, s.")
    blocked_patience: float = Field(
        1.5, gt=0.0, le=60.0, description="Time stopped before the robot counts as trapped, s."
    )
    patience: float = Field(
        20.0, gt=0.0, le=3600.0, description="Time without progress before it counts as trapped, s."
    )
    sectors: int = Field(72, ge=8, le=360, description="Directions of the costs in the diagnostics.")


ROBUST = Preset("our choice: the critics of Nav2's MPPI controller, the true footprint, motors' lag and dead time")
