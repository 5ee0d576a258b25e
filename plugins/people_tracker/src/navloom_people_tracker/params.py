"""Parameters of the people tracker."""

from __future__ import annotations

from navloom import Params
from pydantic import Field

__all__ = ["PeopleTrackerParams"]


class PeopleTrackerParams(Params):
    """Parameters of the node `people_tracker`."""

    reach: float = Field(12.0, gt=0.0, le=100.0, description="Echoes up to this distance are looked at, m.")
    range_sigma: float = Field(0.02, ge=0.0, le=0.2, description="Standard deviation of a laser's range, m.")
    acceleration: float = Field(1.2, gt=0.0, le=20.0, description="Standard deviation of a body's acceleration, m/s².")
    widest: float = Field(1.4, gt=0.0, le=5.0, description="Largest width of a body that moves, m.")
    widest_still: float = Field(0.9, gt=0.0, le=5.0, description="Largest width of a body that may stand, m.")
    least_radius: float = Field(0.3, ge=0.0, le=2.0, description="Least radius that is published, m: of a person.")
    longest_unseen: float = Field(3.0, gt=0.0, le=60.0, description="Time for which a hidden body is predicted, s.")
    still_after: float = Field(
        1.0, ge=0.0, le=60.0, description="Age from which a body that stands where the map has nothing is published, s."
    )
    map_margin: float = Field(
        0.12, ge=0.0, le=0.5, description="An echo this near to a mapped wall is the wall's, m; plus 3σ of the pose."
    )
    occupied_from: int = Field(50, ge=1, le=100, description="Occupancy from which a cell of the map is a wall, %.")
