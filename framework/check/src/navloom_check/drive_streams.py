"""The framework's own streams in a drive, for plugins that read them as extra inputs.

`framework_message` gives what fits the drive: the trajectory leads to the target, the map is that of the scene.
`nothing_of` gives messages of other plugins' classes, which say that there is nothing, as tracks without a person.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from navloom.messages import (
    Command,
    Contact,
    GateStatus,
    MapUpdate,
    Message,
    OccupancyGrid,
    Odometry,
    Path,
    Point2D,
    Pose2D,
    PoseEstimate,
    Reference,
    TrackingCommand,
    Trajectory,
    Twist2D,
)
from navloom.messages.behaviour import AvoiderStatus, HandOver
from navloom.messages.goals import Drive, Feedback
from navloom.messages.kinds import Kind
from navloom.messages.motion import Selection
from numpy.typing import NDArray

__all__ = ["Moment", "framework_message", "nothing_of", "straight_way"]

Floats = NDArray[np.float64]
M = TypeVar("M", bound=Message)

SPEED = 0.4
"""Speed of the reference on a straight way, m/s."""
LOOK_AHEAD = 1.0
"""Distance from the reference point to its target, m."""
NO_COVARIANCE = np.zeros((3, 3))


@dataclass(frozen=True, eq=False)
class Moment:
    """A moment of a drive.

    Attributes:
        stamp_ns: Run clock.
        pose: x, y, m, heading, rad, map frame.
        twist: Speed, m/s, and turn rate, rad/s.
        samples: (n, 6) samples of the trajectory, as `Trajectory` has them.
        grid: Makes the map, map frame.
        desired: What the controller commands: speed, m/s, and turn rate, rad/s.
        corridor: Half width of the strip along the way that must be free, m.
    """

    stamp_ns: int
    pose: tuple[float, float, float]
    twist: tuple[float, float]
    samples: Floats
    grid: Callable[[], OccupancyGrid]
    desired: tuple[float, float] = (0.0, 0.0)
    corridor: float = 0.4

    @property
    def at(self) -> Pose2D:
        """The pose as a message."""
        return Pose2D(*self.pose)

    @property
    def moving(self) -> Twist2D:
        """The velocity as a message."""
        return Twist2D(self.twist[0], 0.0, self.twist[1])

    @property
    def wanted(self) -> Twist2D:
        """The controller's command as a message."""
        return Twist2D(self.desired[0], 0.0, self.desired[1])


def straight_way(start: tuple[float, float], end: tuple[float, float]) -> Floats:
    """(n, 6) samples of a trajectory along a straight line, m, map frame."""
    length = max(math.hypot(end[0] - start[0], end[1] - start[1]), 0.02)
    heading = math.atan2(end[1] - start[1], end[0] - start[0])
    s = np.linspace(0.0, length, round(length / 0.02) + 1)
    x, y = start[0] + s * math.cos(heading), start[1] + s * math.sin(heading)
    same = np.ones_like(s)
    return np.column_stack((s, x, y, heading * same, 0.0 * same, SPEED * same))


def framework_message(kind: type[M], now: Moment) -> M | None:
    """The message of a stream of the framework at a moment of a drive; None for other classes."""
    made: M | None = _MAKERS[kind](now) if kind in _MAKERS else None  # type: ignore[assignment]  # each makes its key
    return made


def _reference(now: Moment) -> Reference:
    # Here, as in `builders`.
    from navloom.navigation.trajectory_projection import project, way_ahead

    length = float(now.samples[-1, 0])
    # The robot is not followed from tick to tick here, so the search begins near the robot.
    near = float(now.samples[np.hypot(*(now.samples[:, 1:3] - now.pose[:2]).T).argmin(), 0])
    on = project(now.samples, *now.pose, near, LOOK_AHEAD)
    return Reference(
        1, on.progress, length - on.progress, Pose2D(on.x, on.y, on.heading), on.speed, on.turn_rate, on.cross_track,
        Point2D(on.target_x, on.target_y), way_ahead(now.samples, on.progress, LOOK_AHEAD), now.corridor,
    )  # fmt: skip


def _feedback(now: Moment) -> Feedback:
    on = _reference(now)
    return Feedback(1, "driving", on.remaining, on.remaining / on.speed, on.cross_track, 0)


def _start(now: Moment) -> Pose2D:
    return Pose2D(*now.samples[0, 1:4].tolist())


_MAKERS: dict[type[Message], Callable[[Moment], Message]] = {
    Odometry: lambda now: Odometry(now.stamp_ns, now.at, now.moving),
    PoseEstimate: lambda now: PoseEstimate(now.stamp_ns, now.at, now.moving, NO_COVARIANCE),
    Contact: lambda now: Contact(False),
    OccupancyGrid: lambda now: now.grid(),
    MapUpdate: lambda now: MapUpdate(now.stamp_ns, now.grid(), np.empty((0, 4)), ()),
    Path: lambda now: Path(1, now.samples[:, 1:3], float(now.samples[-1, 0]), None),
    Trajectory: lambda now: Trajectory(1, now.samples),
    Reference: _reference,
    TrackingCommand: lambda now: TrackingCommand(now.wanted, 0.0, 0.0, 0.0),
    Command: lambda now: Command(now.wanted),
    AvoiderStatus: lambda now: AvoiderStatus("clear"),
    HandOver: lambda now: HandOver(True, math.inf),
    GateStatus: lambda now: GateStatus("avoider", "main", False, False, None, ()),
    Selection: lambda now: Selection(1, 0, ("avoider main", "controller main")),
    Drive: lambda now: Drive(1, 1, None, False),
    Feedback: _feedback,
}
"""Makes the message of each stream of the framework that every drive has."""


def nothing_of(cls: type[M], stamp_ns: int) -> M | None:
    """The message of a class that says that there is nothing: empty arrays and tuples, no text, 0, False.

    None where the class has a field for which nothing has no value: a measured number, or a choice.
    """
    values = [_nothing(kind, stamp_ns) for kind in cls.kinds.values()]
    return None if any(value is _NO_VALUE for value in values) else cls(*values)


_NO_VALUE = object()


def _nothing(kind: Kind, stamp_ns: int) -> Any:
    if kind.optional:
        return None
    if kind.array is not None:
        shape = [size if isinstance(size, int) else 0 for size in kind.array.shape]
        has_none = 0 in shape and kind.array.may_be_empty
        return np.empty(shape, kind.array.dtype) if has_none else _NO_VALUE
    if kind.form == "message":
        assert kind.message is not None
        inner = nothing_of(kind.message, stamp_ns)
        return _NO_VALUE if inner is None else inner
    if kind.form == "int":
        return stamp_ns if kind.rule == "stamp" else 0
    return {"tuple": (), "str": "", "bool": False}.get(kind.form, _NO_VALUE) if not kind.choices else _NO_VALUE
