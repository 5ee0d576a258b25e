"""What a drive shows of one laser: how late it is, how its mount is turned, or why that cannot be said."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from navloom_scan_localizer.sweep import ORDERS
from navloom_scans.readings import ordered
from numpy.typing import NDArray

from navloom_calibration.laser_track import Beams, Track, Way, laser_track, velocities_of
from navloom_calibration.mount_yaw import Yaw, find_yaw
from navloom_calibration.offset import FARTHEST, Interval, Offset, find_offset

__all__ = ["EARLIEST", "Measured", "measure"]

Floats = NDArray[np.float64]

EARLIEST = 0.2
"""Largest offset of early scans that a config takes, s."""
_LEAST_TIME, _LEAST_SCANS = 5.0, 20
"""Shortest drive, s, and least scans, that are looked at."""
_LEAST_TURN = math.radians(60.0)
"""Least turn, rad: a robot that drives straight sways by some degrees."""
_WIDEST, _WIDEST_YAW = 0.05, math.radians(5.0)
"""Widest half of an interval that is worth a line in a config, s and rad."""
_CLEARLY = 0.75
"""Width of the interval with another order of the beams, as a share, from which that order is taken."""
_LEAST_AGREEMENT = 0.5
"""Least correlation of the turn rates; other robots' odometry reaches less, bad odometry more."""


@dataclass(frozen=True)
class Measured:
    """What a drive shows of one laser.

    Attributes:
        offset: Its offset; None if it is not observable.
        why_no_offset: Why; empty if it is.
        yaw: The yaw of its mount; None if that is not observable.
        why_no_yaw: Why; empty if it is.
        sweep, period: Median of the duration of a sweep, and of the time between two scans, s.
        seconds: Length of the drive, s.
        track: Its motion.
        order: The order of its beams, see `navloom_scan_localizer.sweep.ORDERS`.
    """

    offset: Offset | None
    why_no_offset: str
    yaw: Yaw | None
    why_no_yaw: str
    sweep: float
    period: float
    seconds: float
    track: Track
    order: float

    @property
    def meaning(self) -> str:
        """What the offset is probably the time of, and whether the times of the beams are right; empty if not known."""
        if self.offset is None:
            return ""
        words = self._stamp_words(self.offset.offset)
        if self.order == 1.0:
            return words
        seem = "measured at once" if self.order == 0.0 else "in the other order: the driver reverses ranges, not times"
        return f"{words}; its beams seem to be {seem}"

    def _stamp_words(self, found: Interval) -> str:
        if found.low <= 0.0 <= found.high:
            return "its stamps are those of the measurement"
        if self.sweep > 0.005 and found.low <= -self.sweep <= found.high:
            return f"that is the duration of its sweep, {self.sweep:.3f} s: the driver stamps the end of a sweep"
        if self.sweep == 0.0 and found.low <= -0.5 * self.period <= found.high:
            return (
                f"that is half of the {self.period:.3f} s between two scans: its beams have no times of their own, and "
                "the stamp may be that of the end of the sweep"
            )
        if found.value > EARLIEST:
            return f"odometry is stamped late: correct that, since time_offset is at most {EARLIEST:g} s"
        return "its scans are stamped late" if found.value < 0.0 else "its scans are stamped early, or odometry late"


def measure(
    scans: list[Beams], way: Way, mount: Floats, progress: Callable[[float, float], None] = lambda done, total: None
) -> Measured:
    """Measure one laser.

    Args:
        scans: By rising stamps.
        way: Odometry.
        mount: (2,) place of the laser, m, base frame.
        progress: Called with the scans that are done, of all passes, and their number.
    """
    scans = [scan for scan in scans if way.stamps[0] <= scan.stamp <= way.stamps[-1]]
    stamps = np.array([scan.stamp for scan in scans])
    seconds = float(stamps[-1] - stamps[0]) if len(stamps) else 0.0
    if seconds < _LEAST_TIME or len(scans) < _LEAST_SCANS:
        why = f"{len(scans)} scans in {seconds:.1f} s beside odometry are too few: expected a drive of a minute"
        empty = Track(stamps, np.zeros((len(stamps), 3)), np.zeros(len(stamps), dtype=np.int64))
        return Measured(None, why, None, why, 0.0, 0.0, seconds, empty, 1.0)
    sweep = float(np.median([np.ptp(scan.time_offsets) if len(scan.time_offsets) else 0.0 for scan in scans]))
    period = float(np.median(np.diff(stamps)))
    track, found, order = _followed(scans, way, sweep, period, progress)
    why = _why_no_offset(found)
    yaw = find_yaw(track, way, mount, 0.0 if found is None or why else found.offset.value)
    narrow = yaw is not None and yaw.yaw.half <= _WIDEST_YAW
    why_no_yaw = "" if narrow else "not observable: drive straight for some metres between walls"
    return Measured(
        None if why else found, why, yaw if narrow else None, why_no_yaw, sweep, period, seconds, track, order
    )  # fmt: skip


def _followed(
    scans: list[Beams], way: Way, sweep: float, period: float, progress: Callable[[float, float], None]
) -> tuple[Track, Offset | None, float]:
    """The motion of a laser, its offset against the odometry, and the order of its beams, one of `ORDERS`.

    A sweep is undone first by the odometry, of the time as stamped and then of that measured, in each order, and at
    last by the motion that the scans themselves show: no noise of the odometry must come into them.
    """
    stamps, still = np.array([scan.stamp for scan in scans]), np.zeros((len(scans), 3))
    wheels = Track(way.stamps, way.poses, np.zeros(len(way.stamps), dtype=np.int64))
    count, total = len(scans), len(scans) * (2.0 + len(ORDERS) if sweep else 2.0)
    velocities = velocities_of(wheels, stamps, sweep) if sweep else still
    track = laser_track(scans, way, velocities, 0.0, _after(progress, 0, total))
    found, order = find_offset(track, way), 1.0
    shift = _shift(found)
    if sweep:
        velocities, tried = velocities_of(wheels, stamps + shift, sweep), []
        for number, one in enumerate(ORDERS, 1):
            follow = _after(progress, number * count, total)
            tried.append(laser_track(_in_order(scans, one), way, velocities, shift, follow))
        halves = [math.inf if (given := find_offset(one, way)) is None else given.offset.half for one in tried]
        best = int(np.argmin(halves))
        best = best if halves[best] < _CLEARLY * halves[0] else 0
        order, track = ORDERS[best], tried[best]
        velocities, shift = velocities_of(track, stamps, sweep), _shift(find_offset(track, way))
    elif abs(shift) < 0.5 * period:
        return track, found, order
    track = laser_track(_in_order(scans, order), way, velocities, shift, _after(progress, round(total) - count, total))
    return track, find_offset(track, way), order


def _shift(found: Offset | None) -> float:
    """The offset, s, if it is observable; else 0."""
    return 0.0 if found is None or _why_no_offset(found) else found.offset.value


def _in_order(scans: list[Beams], order: float) -> list[Beams]:
    """Scans with the times of their beams in one of `ORDERS`."""
    if order == 1.0:
        return scans
    return [scan._replace(time_offsets=ordered(scan.time_offsets, order)) for scan in scans]


def _after(progress: Callable[[float, float], None], before: int, total: float) -> Callable[[int], None]:
    """Progress of one pass as that of all."""
    return lambda done: progress(before + done, total)


def _why_no_offset(found: Offset | None) -> str:
    if found is None or found.turn < _LEAST_TURN:
        return "not observable: drive a turn"
    if found.agreement < _LEAST_AGREEMENT:
        return f"scans and odometry do not turn alike (correlation {found.agreement:.2f}): is it the same robot?"
    if abs(found.offset.value) > FARTHEST - 0.05:
        return f"it is beyond {FARTHEST:g} s: stamps of another clock, or of their receipt"
    if found.offset.half > _WIDEST:
        return f"not observable within ±{1e3 * found.offset.half:.0f} ms: drive more turns, with stops between them"
    return ""
