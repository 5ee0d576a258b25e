"""Poses, velocities, and the messages of localizer, reference, controller and gate."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from navloom.messages.schema import Array, Heading, Message, Most, Name, Stamp, Unbounded, Words, message
from navloom.messages.stop_reasons import StopReason

__all__ = ["Bodies", "Command", "Contact", "GateStatus", "Odometry", "Point2D", "Pose2D", "PoseEstimate", "PoseTrack",
           "Reference", "Selection", "TrackingCommand", "Trajectory", "Truth", "Twist2D"]  # fmt: skip

Floats = NDArray[np.float64]
Instances = Annotated[tuple[Name, ...], Most(64)]
"""At most one "role instance" for each role."""


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
    """A position and a heading, in the frame that its holder names.

    Attributes:
        x, y: Position, m.
        heading: rad, counter-clockwise from the frame's x axis, in [-π, π).
    """

    x: float
    y: float
    heading: Heading


@message()
class Twist2D(Message):
    """A velocity, base frame.

    Attributes:
        vx: Forward, m/s.
        vy: To the left, m/s; 0 for a robot that is not holonomic.
        wz: Turn rate, rad/s, counter-clockwise.
    """

    vx: float
    vy: float
    wz: float


@message()
class Odometry(Message):
    """Dead reckoning of the platform.

    Attributes:
        stamp_ns: Run clock of the measurement.
        pose: Base in the odometry frame, which starts where the robot starts and drifts.
        twist: Measured velocity, base frame.
    """

    stamp_ns: Stamp
    pose: Pose2D
    twist: Twist2D


@message()
class Contact(Message):
    """State of a bumper; in simulation, whether the true footprint touches something.

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
        nearest: Name of that obstacle; empty for none.
        touching: The footprint touches it.
    """

    pose: Pose2D
    twist: Twist2D
    clearance: Unbounded
    nearest: Words
    touching: bool


@message()
class Bodies(Message):
    """What moves in the ground truth at one moment, for simulated platforms, metrics and viewers, never for a plugin.

    Attributes:
        stamp_ns: Run clock of the moment.
        names: Name of each body: of the actors that are there, then of the robots.
        poses: (n, 3) x, y, m, heading, rad, map frame.
        velocities: (n, 3) x, y, m/s, map frame, and turn rate, rad/s.
        parts: (p, 9) upright cylinders and boxes, map frame: number of its body; x, y of its centre, m; half its
            length, or its radius, m; half its width, m, or 0 for a cylinder; yaw, rad; lowest and highest z, m; 1 if
            light passes it.
        robots: How many of the bodies are robots: the last ones.
    """

    stamp_ns: Stamp
    names: Annotated[tuple[Name, ...], Most(4096)]
    poses: Annotated[Floats, Array("float64", ("n", 3))]
    velocities: Annotated[Floats, Array("float64", ("n", 3))]
    parts: Annotated[Floats, Array("float64", ("p", 9))]
    robots: int = 0


@message()
class PoseEstimate(Message):
    """A localizer's estimate of the robot's pose.

    Attributes:
        stamp_ns: Run clock of the pose.
        pose: Base in the map frame.
        twist: Velocity, base frame.
        covariance: (3, 3) of x, y, heading; m², m rad, rad².
        state: How sure the localizer is: "searching" while it doubts the pose, "lost" when that lasts.
        reason: Why it is not tracking, in one phrase; otherwise empty.
    """

    stamp_ns: Stamp
    pose: Pose2D
    twist: Twist2D
    covariance: Annotated[Floats, Array("float64", (3, 3))]
    state: Literal["tracking", "searching", "lost"] = "tracking"
    reason: Words = ""


@message()
class Hypotheses(Message):
    """The places where a robot may be that does not know where it is.

    Attributes:
        stamp_ns: Run clock of the poses.
        poses: (n, 3) x, y, m, heading, rad in [-π, π), of base in the map frame, the likeliest first; at most 64.
        weights: (n,) how likely each is, 0 to 1; their sum is at most 1.
    """

    stamp_ns: Stamp
    poses: Annotated[Floats, Array("float64", ("n", 3))]
    weights: Annotated[Floats, Array("float64", ("n",))]


@message()
class PoseTrack(Message):
    """Poses over time, for sensors whose data spans a movement. Not published: the mapper's node collects it.

    Attributes:
        stamps_ns: (n,) run clock, increasing.
        poses: (n, 3) x, y, m, heading, rad, of base in the map frame; headings wrapped to [-π, π).
    """

    stamps_ns: Annotated[NDArray[np.int64], Array("int64", ("n",))]
    poses: Annotated[Floats, Array("float64", ("n", 3))]


@message()
class Trajectory(Message):
    """The trajectory that the controller follows.

    The arc length increases along the way, forwards and backwards. Curvature times speed is the turn rate. At a cusp
    the sign of the speed changes between two samples of the same place and arc length: the end of one branch, and the
    beginning of the next.

    Attributes:
        path_id: Number of the plan that it was made from.
        samples: (n, 6) rows of arc length s, m; x, y, m; heading of base, rad; curvature, 1/m; speed, m/s, negative
            where the robot drives backwards; map frame. A holonomic robot may head in another direction than its way;
            its speed is that along the way, > 0.
    """

    path_id: int
    samples: Annotated[Floats, Array("float64", ("n", 6))]


@message(2)
class Reference(Message):
    """The reference point: the robot's pose projected onto the trajectory in each tick.

    Attributes:
        path_id: Number of the trajectory.
        progress: Arc length of the reference point, m.
        remaining: Arc length to the end, m.
        pose: Reference pose, map frame.
        speed: v_r, forward speed in the base frame of the reference, m/s: negative where it drives backwards, and 0
            only where a holonomic robot drives sideways.
        turn_rate: ω_r, rad/s; κ v_r unless the robot is holonomic.
        cross_track: Distance of the robot from the trajectory, m, positive to the left.
        target: Point of the trajectory one look-ahead distance farther along, at most at the next cusp, map frame.
        way: (k, 2) the trajectory from the reference point to the target, m, map frame, in steps of about 0.2 m.
        corridor: Half width of the strip along `way` that must be free, m.
        turn_to: The end has been reached: turn in place to this heading, rad; None while driving.
        lateral_speed: Speed of the reference to the left, base frame of the reference, m/s; 0 unless the robot is
            holonomic.
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
    lateral_speed: float = 0.0


@message(1, now=Reference)
class Reference1(Message):
    """`Reference` until robots could drive sideways; for its fields see there."""

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

    def upgraded(self) -> Reference:
        """The present version."""
        return Reference(*self.read_fields())


@message()
class Command(Message):
    """A commanded velocity, as published by avoiders, recoveries, operators and the gate.

    Attributes:
        twist: The velocity, base frame.
    """

    twist: Twist2D


@message()
class TrackingCommand(Message):
    """A controller's answer. The robot drives by the twist; the errors are for people and studies.

    Attributes:
        twist: Requested velocity, base frame.
        e1, e2: How far the reference is ahead and to the left of the robot, m, base frame: eq. (4) of Hoang et al.
            2013.
        e3: Heading of the reference less that of the robot, rad in [-π, π).
    """

    twist: Twist2D
    e1: float
    e2: float
    e3: Heading


@message(2)
class GateStatus(Message):
    """Status of the gate: which source drives, or why none does.

    `reason` is `why` as one text, such as `no_trajectory` or `stale: controller main`; `--json` prints it too. In
    version 1 it was the field itself.

    Attributes:
        source: Role whose command passed, or "none".
        instance: Name of its instance; empty for none.
        stopped: The gate commands zero.
        latched: The stop stays until `resume`.
        why: Why it is stopped, or brakes to a stop (`source` is none, and `stopped` still false); None while a source
            drives.
        pending: "role instance" of swaps that wait for the instance to warm up, sorted by role.
        share: Share of the command that the collision monitor lets pass; 1 for all of it.
        limit: Why the collision monitor slows or stops the robot: an `obstacle`, or `unseen` space; empty for no
            reason; `overridden` if an operator lets it enter unseen space.
        place: Place of the obstacle or unseen space in the base frame, m.
        distance: Distance from the footprint to it, m.
    """

    source: Literal["none", "controller", "avoider", "recovery", "operator"]
    instance: Name
    stopped: bool
    latched: bool
    why: StopReason | None
    pending: Instances
    share: float = 1.0
    limit: Literal["", "obstacle", "unseen", "overridden"] = ""
    place: Point2D | None = None
    distance: float | None = None

    @property
    def reason(self) -> str:
        """`why` as one text: `operator`, `no_trajectory`, `stale: controller main`, …; empty while a source drives."""
        return "" if self.why is None else self.why.text

    @property
    def interrupts(self) -> bool:
        """Whether the robot is stopped for a reason that interrupts a drive."""
        return self.stopped and self.why is not None and not self.why.stop.is_at_rest


@message(1, now=GateStatus)
class GateStatus1(Message):
    """`GateStatus` until its reason became a `StopReason`; for its fields see there."""

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

    def upgraded(self) -> GateStatus:
        """The present version."""
        source, instance, stopped, latched, reason, *others = self.read_fields()
        return GateStatus(source, instance, stopped, latched, StopReason.parse(reason), *others)


@message()
class Selection(Message):
    """Which instance of each role is active.

    Attributes:
        epoch: Increases with each swap; commands of an older epoch are refused.
        from_tick: First tick in which it applies.
        instances: "role instance" of each active instance, sorted by role.
    """

    epoch: int
    from_tick: int
    instances: Instances

    @property
    def chosen(self) -> dict[str, str]:
        """Active instance, by role."""
        return dict(entry.split(" ", 1) for entry in self.instances)
