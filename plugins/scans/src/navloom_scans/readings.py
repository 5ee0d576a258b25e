"""Converts the framework's range scans to beams at the time of the odometry."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

import numpy as np
from navloom import Message, Odometry, RangeScan, read_only
from numpy.typing import NDArray

from navloom_scans.beams import beam_points

__all__ = ["BeamLimits", "beams_of"]

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


def beams_of(scans: Iterable[Message], odometry: Odometry, limits: BeamLimits) -> tuple[Floats, int]:
    """Beams of the range scans of one tick, and how many of them have an echo.

    Returns:
        (n, 4) end point, m, and direction, base frame at the odometry's time; first those with an echo, then those
        without one, which end where the sensor would still have seen a wall.
    """
    heard, silent = [], []
    for scan in scans:
        if isinstance(scan, RangeScan):
            heard.append(_points(scan, odometry, limits, scan.ranges))
            limit = scan.range_max - limits.limit_margin
            if len(scan.ranges) and scan.ranges.max() >= limit:
                ends = np.where(scan.ranges < limit, 0.0, _SEEN_TO * limit)
                silent.append(_points(scan, odometry, limits, ends))
    rows = heard + silent
    if not rows:
        return np.empty((0, 4)), 0
    return rows[0] if len(rows) == 1 else np.concatenate(rows), sum(len(points) for points in heard)


def _points(scan: RangeScan, odometry: Odometry, limits: BeamLimits, ranges: Floats) -> Floats:
    """(n, 4) end points and directions of the beams of one scan with a range within the limits."""
    late = (scan.stamp_ns - odometry.stamp_ns) / 1e9
    # The velocity is taken as constant in between, which holds for a moment only.
    if abs(late) > limits.max_age:
        return np.empty((0, 4))
    within = np.array([scan.range_min, scan.range_max - limits.limit_margin, math.radians(limits.max_half_angle_deg)])
    twist, rows = odometry.twist, np.empty((len(scan.ranges), 4))
    motion = np.array([twist.vx, twist.vy, twist.wz, late])
    # Computed ranges are writable, for which a kernel would compile while the robot drives.
    given = (scan.origins, scan.bearings, scan.half_angles, scan.time_offsets, read_only(ranges))
    return rows[: beam_points(*given, within, motion, rows)]
