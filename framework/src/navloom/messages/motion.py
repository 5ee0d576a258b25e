"""Poses and velocities, and the messages of platform, localizer, reference, controller and gate."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from navloom.messages.schema import Array, Heading, Message, Most, Name, Stamp, Unbounded, Words, message

__all__ = ["Command", "Contact", "GateStatus", "Odometry", "Point2D", "Pose2D", "PoseEstimate", "PoseTrack",
           "Reference", "Selection", "TrackingCommand", "Trajectory", "Truth", "Twist2D"]  # fmt: skip

Floats = NDArray[np.float64]
Instances = Annotated[tuple[Name, ...], Most(64)]
"""One "role instance" of each role at most."""


@message()
class Point2D(Message):
    """A point.

    Attributes:
        x, y: m, map frame.
    """

    x: float
    y: float


@message()
class Pose2D(Message):
    """Position x, y, m, and heading, rad, counter-clockwise in [-π, π), in the frame that its field states."""

    x: float
    y: float
    heading: Heading


@message()
class Twist2D(Message):
    """Velocity in the base frame: vx forward and vy left, m/s; wz counter-clockwise, rad/s."""

    vx: float
    vy: float
    wz: float


@message()
class Odometry(Message):
    """Dead reckoning of the platform.

    Attributes:
        stamp_ns: Run clock at which it holds.
        pose: Base in the odometry frame, which starts where the robot starts and drifts.
        twist: Measured velocity, base frame.
    """

    stamp_ns: Stamp
    pose: Pose2D
    twist: Twist2D


@message()
class Contact(Message):
    """A bumper; in simulation the true footprint.

    Attributes:
        touching: The robot touches something.
    """

    touching: bool


@message()
class Truth(Message):
    """Ground truth of a simulator: for metrics and viewers, never for a plugin.

    Attributes:
        pose: Base in the map frame.
        twist: True velocity, base frame.
        clearance: Gap between footprint and nearest obstacle, m; 0 in contact, infinite in an empty world.
        nearest: Name of that obstacle, empty if there is none.
        touching: The footprint touches it.
    """

    pose: Pose2D
    twist: Twist2D
    clearance: Unbounded
    nearest: Words
    touching: bool


@message()
class PoseEstimate(Message):
    """Where the robot is.

    Attributes:
        stamp_ns: Run clock at which it holds.
        pose: Base in the map frame.
        twist: Velocity, base frame.
        covariance: (3, 3) of x, y, heading; m², m rad, rad².
        state: How sure the localizer is: "searching" while it doubts the pose, "lost" when that lasts.
        reason: Why it is not tracking, as one phrase; else empty.
    """

    stamp_ns: Stamp
    pose: Pose2D
    twist: Twist2D
    covariance: Annotated[Floats, Array("float64", (3, 3))]
    state: Literal["tracking", "searching", "lost"] = "tracking"
    reason: Words = ""


@message()
class PoseTrack(Message):
    """Poses over time, for sensors whose data spans a movement.

    Attributes:
        stamps_ns: (n,) run clock, rising.
        poses: (n, 3) x, y, m, heading, rad, of base in the map frame; headings wrapped to [-π, π).
    """

    stamps_ns: Annotated[NDArray[np.int64], Array("int64", ("n",))]
    poses: Annotated[Floats, Array("float64", ("n", 3))]


@message()
class Trajectory(Message):
    """What the controller follows.

    Attributes:
        path_id: Number of the plan it was made from.
        samples: (n, 6) rows of arc length s, m; x, y, m; heading, rad; curvature, 1/m; speed, m/s; map frame.
    """

    path_id: int
    samples: Annotated[Floats, Array("float64", ("n", 6))]


@message()
class Reference(Message):
    """The robot's projection onto the trajectory, updated each tick.

    Attributes:
        path_id: Number of the trajectory.
        progress: Arc length of the projection, m.
        remaining: Arc length to the end, m.
        pose: Reference pose, map frame.
        speed: v_r, m/s, > 0.
        turn_rate: ω_r = κ v_r, rad/s.
        cross_track: Signed distance of the robot to the left of the trajectory, m.
        target: Point of the trajectory one look-ahead distance further on, map frame.
        way: (k, 2) the trajectory from the reference point to the target, m, map frame, in steps of about 0.2 m.
        corridor: Half width of the strip along `way` that must be free, m.
        turn_to: The end has been reached: turn in place to this heading, rad; None while driving.
    """

    path_id: int
    progress: float
    remaining: float
    pose: Pose2D
    speed: float
    turn_rate: float
    cross_track: float
    target: Point2D
    way: Annotated[Floats, Array("float64", ("k", 2))]
    corridor: float
    turn_to: float | None = None


@message()
class Command(Message):
    """A velocity command of an avoider, a recovery, an operator or the gate.

    Attributes:
        twist: The velocity, base frame.
    """

    twist: Twist2D


@message()
class TrackingCommand(Message):
    """A controller's answer.

    Attributes:
        twist: Velocity asked for, base frame.
        e1, e2: Longitudinal and lateral error, m, in the base frame: eq. (4).
        e3: Heading error, rad in [-π, π).
    """

    twist: Twist2D
    e1: float
    e2: float
    e3: Heading


@message()
class GateStatus(Message):
    """Who drives, or why the robot is stopped.

    Attributes:
        source: Role whose command went through, or "none".
        instance: Its instance name, empty for none.
        stopped: Zero is commanded.
        latched: The stop lasts until `resume`.
        reason: Empty while driving; else what stopped the robot (`operator`, `no_trajectory`, `stale: …`, …).
        pending: "role instance" of swaps that wait for the instance to warm up, in order of role.
        share: Share of the command that the collision monitor lets through; 1 if it does not slow the robot.
        limit: Why the monitor slows or stops the robot: an `obstacle`, or `unseen` space; empty for nothing;
            `overridden` while an operator lets it enter unseen space.
        place: Place of the obstacle or unseen space, base frame, m.
        distance: From the footprint to that place, m.
    """

    source: Literal["none", "controller", "avoider", "recovery", "operator"]
    instance: Name
    stopped: bool
    latched: bool
    reason: Words
    pending: Instances
    share: float = 1.0
    limit: Literal["", "obstacle", "unseen", "overridden"] = ""
    place: Point2D | None = None
    distance: float | None = None


@message()
class Selection(Message):
    """Which instance of each role is active.

    Attributes:
        epoch: Rises with each swap; commands of an older epoch are refused.
        from_tick: First tick in which it holds.
        instances: "role instance" in order of role.
    """

    epoch: int
    from_tick: int
    instances: Instances

    @property
    def chosen(self) -> dict[str, str]:
        """Active instance, by role."""
        return dict(entry.split(" ", 1) for entry in self.instances)
