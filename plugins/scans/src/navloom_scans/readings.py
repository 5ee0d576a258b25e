"""Converts the framework's range scans to beams at the time of the odometry."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

import numpy as np
from navloom import Message, Odometry, RangeScan, Twist2D, read_only
from numpy.typing import NDArray

from navloom_scans.beams import beam_points
from navloom_scans.trail import OdometryTrail

__all__ = ["BeamLimits", "beams_of", "echoes_of", "ordered", "range_scans", "silent_of"]

Floats = NDArray[np.float64]

_SEEN_TO = 0.9
"""Share of the range to which a beam without an echo shows that there is no wall: echoes from the end are weak."""


class BeamLimits(Protocol):
    """Which beams are used.

    `limit_margin`: readings this near to `range_max` are none, m. `max_half_angle_deg`: wider beams are left out.
    `max_age`: scans this much older than the odometry are left out, s.
    """

    @property
    def limit_margin(self) -> float: ...
    @property
    def max_half_angle_deg(self) -> float: ...
    @property
    def max_age(self) -> float: ...


def beams_of(
    scans: Iterable[Message], odometry: Odometry, limits: BeamLimits, trail: OdometryTrail
) -> tuple[Floats, int]:
    """Beams of the range scans of one tick, and how many of them have an echo.

    Returns:
        (n, 4) end point, m, and direction, base frame at the odometry's time; first those with an echo, then those
        without one, which end where the sensor would still have seen a wall.
    """
    given = range_scans(scans)
    heard = echoes_of(given, odometry.stamp_ns, odometry.twist, limits, trail)
    rows = [*heard, *silent_of(given, odometry.stamp_ns, odometry.twist, limits, trail)]
    if not rows:
        return np.empty((0, 4)), 0
    return rows[0] if len(rows) == 1 else np.concatenate(rows), sum(len(points) for points in heard)


def range_scans(scans: Iterable[Message]) -> list[RangeScan]:
    """The range scans among the messages of sensors."""
    return [scan for scan in scans if isinstance(scan, RangeScan)]


def echoes_of(
    scans: Iterable[RangeScan],
    stamp_ns: int,
    twist: Twist2D,
    limits: BeamLimits,
    trail: OdometryTrail | None,
    order: float = 1.0,
) -> list[Floats]:
    """Beams with an echo of each scan: (n, 4) end point, m, and direction, base frame at a time, ns.

    Without a trail of odometry the velocity is taken as constant since the scan. The beams were measured in the order
    of their time offsets times `order`, see `ordered`.
    """
    return [_points(scan, stamp_ns, twist, limits, trail, scan.ranges, order) for scan in scans]


def silent_of(
    scans: Iterable[RangeScan], stamp_ns: int, twist: Twist2D, limits: BeamLimits, trail: OdometryTrail | None
) -> list[Floats]:
    """Beams without an echo, as those of `echoes_of`; they end where the sensor would still have seen a wall."""
    found = []
    for scan in scans:
        limit = scan.range_max - limits.limit_margin
        if len(scan.ranges) and scan.ranges.max() >= limit:
            ends = np.where(scan.ranges < limit, 0.0, _SEEN_TO * limit)
            found.append(_points(scan, stamp_ns, twist, limits, trail, ends))
    return found


def ordered(time_offsets: Floats, order: float) -> Floats:
    """Time offsets, (n,) s: 1 as given, 0 all at once, -1 the other way round; the middle keeps its time."""
    middle = 0.5 * (time_offsets.min() + time_offsets.max())
    found: Floats = middle + order * (time_offsets - middle)
    return found


def _points(
    scan: RangeScan,
    stamp_ns: int,
    twist: Twist2D,
    limits: BeamLimits,
    trail: OdometryTrail | None,
    ranges: Floats,
    order: float = 1.0,
) -> Floats:
    """(n, 4) end points and directions of the beams of one scan with a range within the limits."""
    late = (scan.stamp_ns - stamp_ns) / 1e9
    if abs(late) > limits.max_age:
        return np.empty((0, 4))
    within = np.array([scan.range_min, scan.range_max - limits.limit_margin, math.radians(limits.max_half_angle_deg)])
    velocity = np.array([twist.vx, twist.vy, twist.wz])
    if trail is not None:
        velocity = trail.velocity_since(scan.stamp_ns, velocity)
    rows, motion = np.empty((len(scan.ranges), 4)), np.append(velocity, late)
    offsets = scan.time_offsets if order == 1.0 else ordered(scan.time_offsets, order)
    # Computed ranges and offsets are writable, for which a kernel would compile while the robot drives.
    given = (scan.origins, scan.bearings, scan.half_angles, read_only(offsets), read_only(ranges))
    return rows[: beam_points(*given, within, motion, rows)]
