"""Parameters of the avoider. What follows from the robot (speeds, ramps, lag, footprint) is not one of them."""

from navloom import Params, Preset
from pydantic import Field


class OrcaParams(Params):
    """van den Berg et al. 2011, with the effective centre of Snape et al. 2010."""

    horizon: float = Field(2.5, gt=0.0, le=20.0, description="Time for which tracks are kept clear of, s.")
    share: float = Field(
        1.0, ge=0.5, le=1.0, description="Share of the change of velocity that the robot takes, no unit; 1: all of it."
    )
    keep_right_deg: float = Field(
        0.0,
        ge=0.0,
        le=120.0,
        description="Most that the robot turns aside, to the right, where tracks hold it up, deg.",
    )
    standing_by_echoes: bool = Field(
        False, description="Whether a track that stands counts by its echoes, as a wall does, not as a disc."
    )
    reach: float = Field(8.0, gt=0.0, le=50.0, description="Tracks farther away than this do not count, m.")
    track_margin: float = Field(0.1, ge=0.0, le=2.0, description="Margin between robot and tracks, m.")
    sigmas: float = Field(
        1.0, ge=0.0, le=5.0, description="Standard deviations of a track's place that count as margin, no unit."
    )
    centre: float = Field(
        0.5, ge=0.1, le=2.0, description="Distance of the effective centre ahead of the axle, per inscribed radius."
    )
    window: float = Field(0.4, gt=0.0, le=5.0, description="Time in which a velocity must be reachable, s.")
    reverse: float = Field(0.35, ge=0.0, le=5.0, description="Highest speed backwards, m/s.")
    laser_margin: float = Field(0.05, ge=0.0, le=1.0, description="Margin between footprint and laser points, m.")
    sonar_margin: float = Field(0.12, ge=0.0, le=1.0, description="Margin between footprint and sonar cell centres, m.")
    memory: float = Field(5.0, ge=0.0, le=3600.0, description="How long points out of a laser's sight count, s.")
    blocked_patience: float = Field(
        3.0, gt=0.0, le=60.0, description="Time stopped before the robot counts as trapped, s."
    )
    patience: float = Field(
        20.0, gt=0.0, le=3600.0, description="Time without progress before it counts as trapped, s."
    )
    sectors: int = Field(72, ge=8, le=360, description="Directions of the violations in the diagnostics.")


ROBUST = Preset("our choice: the robot takes all of the change, since people need not see it")
RECIPROCAL = Preset(
    "van den Berg et al. 2011",
    {
        "share": (0.5, "eq. (5): each takes half of u"),
        "sigmas": (0.0, "section 2: positions are known exactly"),
        "keep_right_deg": (75.0, "Zhou et al. 2017, right-hand heuristic; the angle is ours"),
        "standing_by_echoes": (
            True,
            "ours: a robot that has arrived leaves a gap that its disc closes",
        ),
    },
)
