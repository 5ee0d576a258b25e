"""Maps, plans, requests for them, and planning failures."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from navloom.messages.motion import Point2D, Pose2D
from navloom.messages.schema import Array, Message, Most, Name, NotNegative, Positive, Stamp, Words, message

__all__ = ["ClearRequest", "Count", "MapUpdate", "OccupancyGrid", "Path", "PlanFailure", "PlanRequest"]

Floats = NDArray[np.float64]


@message()
class OccupancyGrid(Message):
    """A raster map.

    Attributes:
        cells: (rows, cols) int8: 0 free to 100 occupied, -1 unknown; row 0 has the lowest y, column 0 the lowest x.
        resolution: Edge of a cell, m.
        origin: Lower left corner of cell (0, 0) in the map frame; its heading rotates the raster.
    """

    cells: Annotated[NDArray[np.int8], Array("int8", ("rows", "cols"), at_least=-1, at_most=100)]
    resolution: Positive
    origin: Pose2D


@message()
class Count(Message):
    """One named number of a diagnosis.

    Attributes:
        name: What is counted.
        value: How many.
    """

    name: Name
    value: int


@message()
class MapUpdate(Message):
    """A mapper's complete map.

    Attributes:
        stamp_ns: Run clock of the newest data in it.
        grid: Raster map, map frame.
        segments: (n, 4) x1, y1, x2, y2 of the obstacles' outlines, m, map frame; a point has two equal ends. A mapper
            without outlines leaves it empty, (0, 4): planners then read the grid.
        counts: Number of input points by outcome (used, or why not); the numbers sum to all input points. It may be
            empty.
    """

    stamp_ns: Stamp
    grid: OccupancyGrid
    segments: Annotated[Floats, Array("float64", ("n", 4))]
    counts: Annotated[tuple[Count, ...], Most(64)]


@message()
class ClearRequest(Message):
    """Asks the mapper to clear what it can observe again.

    Attributes:
        request_id: Increases with each request.
    """

    request_id: int


@message(2)
class PlanRequest(Message):
    """Asks the planner for a path.

    Attributes:
        request_id: Increases with each request; the answer carries it. Live, a request without an answer is repeated
            with the same number.
        start, goal: Poses of base in the map frame.
        any_heading: No heading was asked for at the goal; `goal.heading` is then 0 and says nothing.
    """

    request_id: int
    start: Pose2D
    goal: Pose2D
    any_heading: bool = False


@message(1, now=PlanRequest)
class PlanRequest1(Message):
    """`PlanRequest` until it told whether the goal has a heading; for its fields see there."""

    request_id: int
    start: Pose2D
    goal: Pose2D

    def upgraded(self) -> PlanRequest:
        """The present version."""
        return PlanRequest(*self.read_fields())


@message(2)
class Path(Message):
    """A planner's answer.

    A path with headings is drivable as it is: the framework neither prunes nor rounds it. The robot drives backwards
    along a segment that points away from the heading at its ends; where the direction changes, at a cusp, it stops. A
    differential or Ackermann robot has to head along each segment, forwards or backwards, within 45°. A holonomic robot
    may have any heading. Between two points the heading turns the shorter way.

    Attributes:
        request_id: Number of the request that it answers.
        points: (n, 2) from start to goal, m, map frame.
        length: Length as planned, before any pruning, m.
        traversable: 0 where the robot's centre may be, 100 where it may not; the framework prunes and smooths within
            it. None: only the points themselves are known to be free, and corners are rounded by a few centimetres.
        headings: (n,) heading of base at each point, rad, map frame; None: base heads along the path.
    """

    request_id: int
    points: Annotated[Floats, Array("float64", ("n", 2), may_be_empty=False)]
    length: NotNegative
    # With the path: the framework prunes and rounds the paths of all planners alike, but only the planner knows which
    # cells it counted as free.
    traversable: OccupancyGrid | None
    headings: Annotated[Floats, Array("float64", ("n",))] | None = None


@message(1, now=Path)
class Path1(Message):
    """`Path` until it could have headings; for its fields see there."""

    request_id: int
    points: Annotated[Floats, Array("float64", ("n", 2), may_be_empty=False)]
    length: NotNegative
    traversable: OccupancyGrid | None

    def upgraded(self) -> Path:
        """The present version."""
        return Path(*self.read_fields())


@message()
class PlanFailure(Message):
    """Why there is no path.

    Attributes:
        request_id: Number of the request that it answers.
        kind: What is wrong.
        place: Place of the failure, map frame: the occupied start or goal, the point outside, or where the search came
            nearest.
        detail: Explanation in one sentence.
    """

    request_id: int
    kind: Literal["start_occupied", "goal_occupied", "outside_map", "no_path"]
    place: Point2D
    detail: Words
