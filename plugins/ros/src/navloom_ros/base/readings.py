"""What ROS sensors say, as arrays in the base frame: no framework, no network."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navloom_ros.base.frames import heading_of, rotation

__all__ = ["Anchor", "Beams", "Unusable", "beams_of_laser", "beams_of_ranges", "is_set", "motion_of", "stamp_ns_of"]

Floats = NDArray[np.float64]

TILTED = math.cos(math.radians(10.0))
"""A laser whose axis is further from the vertical scans no plane."""
MOST_BEAMS = 100_000
"""Beams of the largest scan that is read."""
RESTARTED, RESTARTED_TURN = 0.3, 0.3
"""m and rad by which the odometry of a new publisher may differ before it counts as one that began again."""
FASTER = 3.0
"""How many times faster than the robot odometry may be before it counts as one that began again."""


UNSTEADY, UNSTEADY_NS = 4, 2_000_000_000
"""Odometry that begins again so often within 2 s is that of several publishers, or of none."""


class Unusable(ValueError):
    """A message whose values mean nothing."""


class Beams(NamedTuple):
    """A scan: (n, 2) origins, m, (n,) bearings and half angles, rad, offsets, s, ranges, m; base frame."""

    origins: Floats
    bearings: Floats
    half_angles: Floats
    time_offsets: Floats
    ranges: Floats
    range_min: float
    range_max: float


class Motion(NamedTuple):
    """Pose x, y, m, heading, rad, in the robot's odometry frame, and velocity in the base frame, m/s and rad/s."""

    pose: tuple[float, float, float]
    twist: tuple[float, float, float]


def stamp_ns_of(stamp: Any) -> int:
    """A ROS time as ns."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def motion_of(message: Any) -> Motion:
    """What nav_msgs/msg/Odometry says. Raises Unusable."""
    pose, twist = message.pose.pose, message.twist.twist
    turned = rotation(pose.orientation)
    values = (pose.position.x, pose.position.y, twist.linear.x, twist.linear.y, twist.angular.z)
    if turned is None or not all(map(math.isfinite, values)):
        raise Unusable("odometry without a pose or velocity: a value is not finite, or the orientation is none")
    return Motion((values[0], values[1], heading_of(turned)), values[2:])


def beams_of_laser(scan: Any, mount: Floats, is_far_below: bool) -> Beams:
    """Beams of sensor_msgs/msg/LaserScan that say something: an echo, or that there is none within reach (+inf).

    Args:
        scan: The message.
        mount: (4, 4) from the laser's frame to base; the laser may hang upside down.
        is_far_below: A range below range_min, as 0, says that nothing is within reach; else it says nothing.

    Raises:
        Unusable: Values that mean nothing, or a laser that is tilted.
    """
    ranges = np.asarray(scan.ranges, dtype=np.float64)
    limits = (scan.range_min, scan.range_max, scan.angle_min, scan.angle_increment, scan.time_increment)
    if not all(map(math.isfinite, limits)) or not 0.0 <= scan.range_min <= scan.range_max:
        raise Unusable("a laser scan with limits that are not finite, or range_min above range_max")
    if len(ranges) > MOST_BEAMS or abs(scan.angle_increment) * len(ranges) > 2.0 * math.tau or scan.time_increment < 0:
        raise Unusable(f"a laser scan of {len(ranges)} beams, {scan.angle_increment:g} rad apart")
    if abs(mount[2, 2]) < TILTED:
        tilt = math.degrees(math.acos(min(1.0, abs(mount[2, 2]))))
        raise Unusable(f"a laser that is tilted by {tilt:.0f}°: expected at most 10°")
    if is_far_below:
        ranges = np.where(ranges < scan.range_min, np.inf, ranges)
    ranges = np.where(ranges == -np.inf, scan.range_min, ranges)  # REP 117: something nearer than it can measure
    says = ranges >= scan.range_min  # not NaN
    ranges = np.where(ranges > scan.range_max, np.inf, ranges)[says]
    angles: Floats = scan.angle_min + scan.angle_increment * np.flatnonzero(says)
    along: Floats = mount[:2, :2] @ np.vstack([np.cos(angles), np.sin(angles)])
    count = len(ranges)
    return Beams(
        np.tile(mount[:2, 3], (count, 1)),
        np.arctan2(along[1], along[0]),
        np.zeros(count),
        np.asarray(np.flatnonzero(says) * float(scan.time_increment), dtype=np.float64),
        ranges,
        float(scan.range_min),
        float(scan.range_max),
    )


def beams_of_ranges(readings: Sequence[Any], mounts: Sequence[Floats]) -> Beams:
    """One beam for each sensor_msgs/msg/Range, along the x axis of its frame. Raises Unusable."""
    for one in readings:
        limits = (one.min_range, one.max_range, one.field_of_view)
        if not all(map(math.isfinite, limits)) or not 0.0 <= one.min_range <= one.max_range or one.field_of_view < 0.0:
            raise Unusable("a range with limits that are not finite, or min_range above max_range")
        if math.isnan(one.range):
            raise Unusable("a range that is no number")
    least, most = min(one.min_range for one in readings), max(one.max_range for one in readings)
    ranges = [math.inf if one.range > one.max_range else max(one.range, one.min_range) for one in readings]
    return Beams(
        np.array([mount[:2, 3] for mount in mounts]),
        np.array([heading_of(mount) for mount in mounts]),
        np.array([0.5 * one.field_of_view for one in readings]),
        np.zeros(len(readings)),
        np.array(ranges, dtype=np.float64),
        float(least),
        float(most),
    )


def is_set(message: Any, path: str) -> bool:
    """Whether a field of a message, as `data` or `header.frame_id`, is true, not zero or not empty. Raises Unusable."""
    for name in path.split("."):
        if not hasattr(message, name):
            raise Unusable(f"the contact message has no field {path!r}")
        message = getattr(message, name)
    return bool(len(message)) if hasattr(message, "__len__") else bool(message)


@dataclass
class Anchor:
    """Keeps odometry in one frame where the robot's own begins again: it is taken to stand where it stood.

    Args:
        is_from_first: The frame begins where the first pose was; else it is the robot's own.
        speed, turn: What the robot can do, m/s and rad/s.
    """

    is_from_first: bool
    speed: float
    turn: float
    restarts: int = 0
    _restarted_ns: deque[int] = field(default_factory=lambda: deque(maxlen=UNSTEADY))
    _origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    _raw: tuple[float, float, float] | None = None
    _by: bytes = b""
    _at_ns: int = 0

    def place(self, raw: tuple[float, float, float], by: bytes, at_ns: int) -> tuple[float, float, float]:
        """A pose of the robot's odometry in the frame that is kept, m and rad.

        Args:
            raw: As the robot says.
            by: Who says so.
            at_ns: When, on this host's monotonic clock.
        """
        if self._raw is None:
            self._origin = _then(_inverse(raw), (0.0, 0.0, 0.0)) if self.is_from_first else (0.0, 0.0, 0.0)
        elif self._has_restarted(raw, by, at_ns):
            self.restarts += 1
            self._restarted_ns.append(at_ns)
            self._origin = _then(_then(self._origin, self._raw), _inverse(raw))
        self._raw, self._by, self._at_ns = raw, by, at_ns
        return _then(self._origin, raw)

    def is_unsteady(self, now_ns: int) -> bool:
        """It began again and again: nobody can tell where the robot is."""
        return len(self._restarted_ns) == UNSTEADY and now_ns - self._restarted_ns[0] < UNSTEADY_NS

    def check(self, twist: tuple[float, float, float]) -> None:
        """Refuse a velocity that the robot cannot have. Raises Unusable."""
        speed = math.hypot(twist[0], twist[1])
        if speed > FASTER * self.speed + RESTARTED or abs(twist[2]) > FASTER * self.turn + RESTARTED_TURN:
            raise Unusable(f"odometry of {speed:.3g} m/s and {twist[2]:.3g} rad/s, which the robot cannot drive")

    def _has_restarted(self, raw: tuple[float, float, float], by: bytes, at_ns: int) -> bool:
        assert self._raw is not None
        way = math.hypot(raw[0] - self._raw[0], raw[1] - self._raw[1])
        turn = abs(math.remainder(raw[2] - self._raw[2], math.tau))
        spent = 0.0 if by != self._by else max(0.0, (at_ns - self._at_ns) * 1e-9) * FASTER
        return way > RESTARTED + self.speed * spent or turn > RESTARTED_TURN + self.turn * spent


def _then(pose: tuple[float, float, float], step: tuple[float, float, float]) -> tuple[float, float, float]:
    """A pose that is given in another one, in the frame of that."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    x, y = pose[0] + cos * step[0] - sin * step[1], pose[1] + sin * step[0] + cos * step[1]
    return x, y, math.remainder(pose[2] + step[2], math.tau)


def _inverse(pose: tuple[float, float, float]) -> tuple[float, float, float]:
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return -cos * pose[0] - sin * pose[1], sin * pose[0] - cos * pose[1], -pose[2]
