"""Converts ROS messages to arrays in the base frame, live and from bags. Imports neither framework nor network."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

from navloom_ros.base.frames import heading_of, rotation
from navloom_ros.errors import BadName, Unusable
from navloom_ros.frames import SAME_HEADING, SAME_PLACE
from navloom_ros.message_types import Types

__all__ = [
    "Anchor",
    "Beams",
    "beams_of_laser",
    "beams_of_ranges",
    "check_child",
    "check_field",
    "check_level",
    "check_range",
    "is_set",
    "motion_of",
]

Floats = NDArray[np.float64]

TILTED = math.cos(math.radians(10.0))
"""Cosine of the largest tilt, 10°, of a planar laser and of a frame whose odometry counts as the base's."""
MOST_BEAMS = 100_000
"""Most beams of a scan; larger scans are refused."""
UNEVEN = 0.02
"""Largest error of the last beam's angle, as a share of the angle that a scan covers; drivers round."""
RESTARTED, RESTARTED_TURN = 0.3, 0.3
"""Largest jump of the pose, m and rad, when the publisher of the odometry changes; more counts as a restart."""
FASTER = 3.0
"""Largest speed of the odometry, in multiples of the robot's; a pose that moves faster counts as a restart."""
UNSTEADY, UNSTEADY_NS = 4, 2_000_000_000
"""Restarts and changes of publisher within 2 s, ns, after which the odometry is unusable."""
MOST_METRES = 100.0
"""Largest median of the different readings of a scan, m; more is another unit, as mm."""
FEW = 3
"""Most different readings of a scan that may be codes for no echo, as 65.533."""
BASE_FRAME = "correct child_frame_id where it is published, or set base_frame"
FARTHEST = 1e6
"""Largest coordinate of a pose, m; beyond, the rounding errors of a restart would move the robot's pose."""


class Beams(NamedTuple):
    """A scan in the base frame.

    Attributes:
        origins: (n, 2), m.
        bearings, half_angles: (n,), rad.
        time_offsets: (n,), s after the stamp.
        ranges: (n,), m; +inf for no echo.
        range_min, range_max: Of the sensor, m.
    """

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


def motion_of(message: Any) -> Motion:
    """Pose and velocity of a nav_msgs/msg/Odometry. Raises Unusable."""
    pose, twist = message.pose.pose, message.twist.twist
    turned = rotation(pose.orientation)
    values = (pose.position.x, pose.position.y, twist.linear.x, twist.linear.y, twist.angular.z)
    if turned is None or not all(map(math.isfinite, values)):
        raise Unusable(
            "odometry without a pose or velocity: a value is not finite, or the orientation is not a unit quaternion"
        )
    return Motion((values[0], values[1], heading_of(turned)), values[2:])


class Tree(Protocol):
    """The transforms of a robot or of a bag."""

    def find(self, target: str, frame: str) -> Floats | None:
        """The (4, 4) transform from `frame` to `target`; None if unknown."""


def check_child(child: str, base: str, frames: Tree, fix: str = BASE_FRAME) -> None:
    """Check that odometry is that of the base, or of a frame at its place, as base_footprint below base_link.

    Args:
        child: child_frame_id of the odometry; empty counts as the base.
        base: The base frame.
        frames: Transforms of /tf.
        fix: What the user can do.

    Raises:
        Unusable: The odometry is that of another frame.
    """
    if child.lstrip("/") in ("", base.lstrip("/")):
        return
    found = frames.find(base, child)
    if found is None:
        raise Unusable(f"odometry of the frame {child!r}, which /tf does not connect to {base!r}: {fix}")
    away, turn = math.hypot(found[0, 3], found[1, 3]), abs(heading_of(found))
    if away > SAME_PLACE or turn > SAME_HEADING or found[2, 2] < TILTED:
        tilt = math.acos(max(-1.0, min(1.0, found[2, 2])))
        turned = f"turned by {math.degrees(turn):.0f}° and tilted by {math.degrees(tilt):.0f}°"
        raise Unusable(f"odometry of the frame {child!r}, which is {away:.2f} m from {base!r}, {turned}: {fix}")


def beams_of_laser(scan: Any, mount: Floats, is_far_below: bool) -> Beams:
    """Beams of a sensor_msgs/msg/LaserScan that are measurements: an echo, or +inf for none within reach.

    Args:
        scan: The message.
        mount: (4, 4) from the laser's frame to base; the laser may hang upside down.
        is_far_below: A range below range_min, as 0, means no echo; otherwise such a beam is left out.

    Raises:
        Unusable: Invalid values, or a laser that is tilted.
    """
    with np.errstate(invalid="ignore"):  # a signalling NaN is no more than a NaN
        ranges = np.asarray(scan.ranges, dtype=np.float64)
    angles_and_time = (scan.angle_min, scan.angle_increment, scan.time_increment)
    if not all(map(math.isfinite, angles_and_time)):
        raise Unusable("a laser scan with angles or times that are not finite")
    _check_limits("a laser scan", scan.range_min, scan.range_max)
    _check_unit(ranges)
    span = abs(scan.angle_increment) * len(ranges)
    has_angles = span <= 2.0 * math.tau and (span > 0.0 or len(ranges) < 2)
    if len(ranges) > MOST_BEAMS or not has_angles:
        in_degrees = "; are the angles in degrees?" if span > 2.0 * math.tau else ""
        raise Unusable(f"a laser scan of {len(ranges)} beams, {scan.angle_increment:g} rad apart{in_degrees}")
    if scan.time_increment < 0.0:
        raise Unusable(f"a laser scan with a time_increment of {scan.time_increment:g} s: expected 0 or more")
    _check_last_angle(scan, len(ranges))
    if abs(mount[2, 2]) < TILTED:
        tilt = math.degrees(math.acos(min(1.0, abs(mount[2, 2]))))
        raise Unusable(f"a laser that is tilted by {tilt:.0f}°: expected at most 10°")
    ranges = np.where(ranges == -np.inf, scan.range_min, ranges)  # REP 117: an object closer than range_min
    if is_far_below:
        ranges = np.where(ranges < scan.range_min, np.inf, ranges)
    says = ranges >= scan.range_min  # false for NaN
    ranges = np.where(ranges >= scan.range_max, np.inf, ranges)[says]
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


def _check_limits(what: str, least: float, most: float, may_be_equal: bool = False) -> None:
    """Check the limits of a sensor, m; a sensor of fixed distance has equal ones. Raises Unusable."""
    # With 0 as the highest, which drivers leave unset, every reading would count as no echo.
    is_ordered = 0.0 <= least < most or (may_be_equal and 0.0 < least == most)
    if not (is_ordered and math.isfinite(most)):
        raise Unusable(f"{what} with the limits {least:g} to {most:g} m: expected 0 <= lowest < highest, both finite")


def _check_unit(ranges: Floats) -> None:
    """Check that the readings of a scan are in m. Raises Unusable."""
    different = np.unique(ranges[np.isfinite(ranges) & (ranges > 0.0)])
    if len(different) > FEW and float(np.median(different)) > MOST_METRES:
        raise Unusable(f"a laser scan with readings above {MOST_METRES:g} m: expected m; are they in mm?")


def _check_last_angle(scan: Any, count: int) -> None:
    """Check that the last beam is at angle_max, which is 0 where a driver leaves it unset. Raises Unusable."""
    if not count or not scan.angle_max:
        return
    covered = scan.angle_increment * (count - 1)
    off = abs(math.remainder(covered - (scan.angle_max - scan.angle_min), math.tau))  # some drivers wrap angle_max
    if off > max(2.0 * abs(scan.angle_increment), UNEVEN * abs(covered)):
        raise Unusable(
            f"a laser scan of {count} beams, {scan.angle_increment:.4f} rad apart, which do not fit its angles "
            f"{scan.angle_min:.3f} to {scan.angle_max:.3f} rad"
        )


def check_range(reading: Any) -> None:
    """Check that a sensor_msgs/msg/Range is a measurement. Raises Unusable."""
    _check_limits("a range", reading.min_range, reading.max_range, may_be_equal=True)
    if not 0.0 <= reading.field_of_view < math.inf:
        raise Unusable(f"a range with a field of view of {reading.field_of_view:g} rad")
    if math.isnan(reading.range):
        raise Unusable("a range that is NaN")
    if reading.max_range > MOST_METRES:
        raise Unusable(f"a range with readings up to {reading.max_range:g} m: expected m; are they in mm?")


def check_level(mount: Floats) -> None:
    """Check that the beam of a range sensor, along the x axis of its frame, is parallel to the floor. Raises Unusable.

    Args:
        mount: (4, 4) from the sensor's frame to base.
    """
    if math.hypot(mount[0, 0], mount[1, 0]) < TILTED:
        raise Unusable("a range whose beam is tilted by more than 10°")


def beams_of_ranges(readings: Sequence[Any], mounts: Sequence[Floats], is_far_below: bool = False) -> Beams:
    """One beam for each sensor_msgs/msg/Range that `check_range` accepts, along the x axis of its frame.

    Args:
        readings, mounts: The messages, and (4, 4) from the frame of each to base.
        is_far_below: A range below min_range, as 0, means no echo. Otherwise it becomes min_range, as -inf always does
            (REP 117): something may be that close.
    """
    least, most = min(reading.min_range for reading in readings), max(reading.max_range for reading in readings)
    if any(reading.min_range == reading.max_range for reading in readings):
        # A sensor of fixed distance says only that something is there, with -inf: its echo must stay below the limit.
        most = math.nextafter(most, math.inf)
    ranges = [_range_of(reading, is_far_below) for reading in readings]
    return Beams(
        np.array([mount[:2, 3] for mount in mounts]),
        np.array([heading_of(mount) for mount in mounts]),
        np.array([0.5 * reading.field_of_view for reading in readings]),
        np.zeros(len(readings)),
        np.array(ranges, dtype=np.float64),
        float(least),
        float(most),
    )


def _range_of(reading: Any, is_far_below: bool) -> float:
    """The reading of a sensor_msgs/msg/Range, m; +inf for no echo."""
    if reading.range == -math.inf:
        return float(reading.min_range)
    is_nothing = reading.range >= reading.max_range or (is_far_below and reading.range < reading.min_range)
    return math.inf if is_nothing else max(reading.range, reading.min_range)


def check_field(types: Types, kind: str, path: str) -> None:
    """Check that a message type has a field that `is_set` can judge. Raises BadName.

    Args:
        types: Of the robot's distribution.
        kind: The type, as `std_msgs/msg/Bool`.
        path: The field, as `data` or `status.pressed`.
    """
    inner, node = kind, Nodetype.NAME
    for name in path.split("."):
        fields = dict(types.fields(inner)) if inner else {}
        if name not in fields:
            known = f"expected one of {', '.join(fields)}" if fields else "it is no message"
            raise BadName(f"contact_field: {inner or path} has no field {name!r}: {known}")
        node, rest = fields[name]
        inner = rest if node == Nodetype.NAME else ""
    if inner or node == Nodetype.ARRAY:
        what = f"a {inner}" if inner else "an array of fixed length"
        raise BadName(f"contact_field: {path} of {kind} is {what}: expected a bool, a number, a text or a list")


def is_set(message: Any, path: str) -> bool:
    """Whether a field of a message, as `data` or `header.frame_id`, is true, not zero or not empty."""
    for name in path.split("."):
        message = getattr(message, name)
    return bool(len(message)) if hasattr(message, "__len__") else bool(message)


@dataclass
class Anchor:
    """Keeps the odometry continuous when the robot's own restarts from zero.

    A restart is a jump larger than the robot can drive. The robot is assumed not to have moved meanwhile.

    Args:
        is_from_first: The origin is the first pose; otherwise it is that of the robot's odometry frame.
        speed, turn: Limits of the robot, m/s and rad/s.
    """

    is_from_first: bool
    speed: float
    turn: float
    _changed_ns: deque[int] = field(default_factory=lambda: deque(maxlen=UNSTEADY))
    _origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    _raw: tuple[float, float, float] | None = None
    _by: bytes = b""
    _at_ns: int = 0

    def place(self, raw: tuple[float, float, float], by: bytes, at_ns: int) -> tuple[float, float, float]:
        """A pose of the robot's odometry in the continuous frame, m and rad.

        Args:
            raw: Pose as the robot published it.
            by: Gid of the publisher.
            at_ns: When it was measured, on this host's monotonic clock.
        """
        if self._raw is None:
            self._origin = _then(_inverse(raw), (0.0, 0.0, 0.0)) if self.is_from_first else (0.0, 0.0, 0.0)
        else:
            has_restarted = self._has_restarted(raw, by, at_ns)
            if has_restarted or by != self._by:
                self._changed_ns.append(at_ns)
            if has_restarted:
                # The new odometry continues where the old one ended.
                self._origin = _then(_then(self._origin, self._raw), _inverse(raw))
        self._raw, self._by, self._at_ns = raw, by, at_ns
        return _then(self._origin, raw)

    def is_unsteady(self, now_ns: int) -> bool:
        """The odometry restarts, or changes its publisher, too often to know the pose."""
        return len(self._changed_ns) == UNSTEADY and now_ns - self._changed_ns[0] < UNSTEADY_NS

    def check(self, motion: Motion) -> None:
        """Check that the robot can be at a pose, and can drive a velocity. Raises Unusable."""
        (x, y, _), twist = motion
        if max(abs(x), abs(y)) > FARTHEST:
            raise Unusable(f"odometry at {x:.3g}, {y:.3g} m: expected at most {FARTHEST:.0e} m")
        speed = math.hypot(twist[0], twist[1])
        if speed > FASTER * self.speed + RESTARTED or abs(twist[2]) > FASTER * self.turn + RESTARTED_TURN:
            raise Unusable(f"odometry of {speed:.3g} m/s and {twist[2]:.3g} rad/s, which the robot cannot drive")

    def _has_restarted(self, raw: tuple[float, float, float], by: bytes, at_ns: int) -> bool:
        assert self._raw is not None
        way = math.hypot(raw[0] - self._raw[0], raw[1] - self._raw[1])
        turn = abs(math.remainder(raw[2] - self._raw[2], math.tau))
        # A new publisher may have begun at any time, so that no motion is granted to it.
        spent = 0.0 if by != self._by else max(0.0, (at_ns - self._at_ns) * 1e-9) * FASTER
        return way > RESTARTED + self.speed * spent or turn > RESTARTED_TURN + self.turn * spent


def _then(pose: tuple[float, float, float], step: tuple[float, float, float]) -> tuple[float, float, float]:
    """Composition of two planar poses: `step`, given in the frame of `pose`, in the frame that `pose` is in."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    x, y = pose[0] + cos * step[0] - sin * step[1], pose[1] + sin * step[0] + cos * step[1]
    return x, y, math.remainder(pose[2] + step[2], math.tau)


def _inverse(pose: tuple[float, float, float]) -> tuple[float, float, float]:
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return -cos * pose[0] - sin * pose[1], sin * pose[0] - cos * pose[1], -pose[2]
