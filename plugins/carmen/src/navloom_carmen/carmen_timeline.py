"""Odometry and stamps of a CARMEN log: recovers raw odometry from corrected poses, and makes times monotonic."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from navloom.geometry.angles import wrap
from navloom.geometry.frames import compose, inverse
from navloom_recording import RecordingError, too_coarse
from numpy.typing import NDArray

from navloom_carmen.carmen import ODOM

__all__ = ["Timeline", "corrected_odometry", "leap_of", "raw_odometry", "stamps_of", "standing", "twists"]

Floats = NDArray[np.float64]
_KIND, _POSE, _ROBOT, _SPEED, _IPC, _LOGGER = 1, slice(2, 5), slice(5, 8), slice(5, 7), 8, 9
"""Columns of the events of a `Survey`."""
LATE = 2.0
"""Largest backward jump of a log's times, s; a log may contain the clocks of two computers."""
LACKING = 0.05
"""Share of scans without preceding odometry from which the odometry of a corrected log counts as missing."""
REPEATED = 0.02
"""Largest difference, m and rad, of odometry that repeats the pose of the scan before it."""
PAUSE = 600.0
"""Longest pause within one drive, s; that of the runs of a bag."""
SPAN = 0.2
"""Time over which a velocity is computed if the log gives none, s; stamps of a log scatter by less."""


@dataclass(frozen=True, eq=False)
class Timeline:
    """Odometry of a log.

    Attributes:
        stamps: (n,) ns, strictly increasing.
        poses: (n, 3) x, y, m, heading, rad.
        twists: (n, 2) forward speed, m/s, and turn rate, rad/s.
        left_out: Number of poses at the stamp of a later one.
    """

    stamps: NDArray[np.int64]
    poses: Floats
    twists: Floats
    left_out: int = 0


def stamps_of(events: Floats, is_corrected: bool, period: float | None) -> Floats:
    """Time of each event, s, non-decreasing; scans keep the log's times wherever these increase.

    Args:
        events: (n, 10) of a `Survey`.
        is_corrected: The log is corrected: odometry directly after a scan repeats its pose and has no time.
        period: Time between two scans of a laser, s, if the log's times are unusable; None to use the log's times.

    Raises:
        RecordingError: The log's times run backwards.
    """
    is_scan = events[:, _KIND] != ODOM
    if period is not None:
        return _counted(events[:, _KIND], period)
    is_timed = ~_corrections(events) if is_corrected else np.ones(len(events), dtype=np.bool_)
    columns = [events[:, place] for place in (_IPC, _LOGGER)]
    coarse = [_coarse(column, is_scan, is_timed) for column in columns]
    usable = (place for place in range(2) if _rises(columns[place][is_timed]) and not coarse[place])
    times = next((columns[place] for place in usable), None)
    if times is None:
        if coarse[0]:
            raise RecordingError(
                f"its times are no clock's: {coarse[0]}; number the scans instead, as with --period 0.2"
            )
        worst = _where_back(columns[0][is_timed])
        line = int(events[is_timed][worst, 0])
        raise RecordingError(
            f"its times are no clock's: line {line} has {columns[0][is_timed][worst]:g} s, expected times that rise; "
            "number the scans instead, as with --period 0.2"
        )
    scans = _strictly_rising(times[is_scan])
    before = np.concatenate([[-math.inf], scans])[np.cumsum(is_scan)]
    after = np.concatenate([scans, [math.inf]])[np.cumsum(is_scan)]
    odometry = np.clip(np.where(is_timed, times, before), before, after)
    found = np.where(is_scan, 0.0, np.where(np.isfinite(odometry), odometry, after))
    found[is_scan] = scans
    rising: Floats = np.maximum.accumulate(found)
    return rising


def raw_odometry(events: Floats, times: Floats, is_corrected: bool) -> Timeline:
    """Raw wheel odometry.

    A particle filter that corrects a log continues from the pose of each scan with the steps of the odometry. So all
    these steps are in the log. Only the step that ends directly after a scan is a correction; it is left out.

    Args:
        events: (n, 10) of a `Survey`.
        times: (n,) of `stamps_of`, s.
        is_corrected: Whether a particle filter wrote the poses.

    Raises:
        RecordingError: The log has scans without odometry before them.
    """
    is_scan = events[:, _KIND] != ODOM
    is_odometry = ~is_scan
    is_correction = _corrections(events) & is_corrected
    if is_corrected and not (is_odometry & ~is_correction).any():
        raise RecordingError("it holds no odometry, only corrected poses: take these, with --poses corrected")
    if not is_odometry.any():
        return _timeline(times, events[:, _ROBOT], np.zeros((len(events), 2)))
    if not is_corrected:
        # The robot pose of a scan is odometry too, at the time of the scan.
        poses = np.where(is_scan[:, None], events[:, _ROBOT], events[:, _POSE])
        speeds = np.where(is_scan[:, None], 0.0, events[:, _SPEED])
        return _timeline(times, poses, _held(speeds, is_odometry))
    given = np.where(is_scan[:, None], events[:, _ROBOT], events[:, _POSE])
    steps = compose(inverse(given[:-1]), given[1:])
    # Of a robot that stood, as between the scans of two lasers, nothing is lost.
    has_moved = np.maximum(np.abs(steps[:, :2]).max(axis=1), np.abs(wrap(steps[:, 2]))) > REPEATED
    lacking = int((is_scan[1:] & (is_scan | is_correction)[:-1] & has_moved).sum())
    if lacking > LACKING * is_scan.sum():
        raise RecordingError(
            f"{lacking} of {is_scan.sum()} scans have no odometry before them: it cannot be recovered; take the "
            "corrected poses instead, with --poses corrected"
        )
    # Without odometry before a scan, the filter's step to it is all that is known of the motion.
    is_lone = is_scan & np.concatenate([[True], (is_scan | is_correction)[:-1]])
    steps[((is_scan & ~is_lone) | is_correction)[1:]] = 0.0
    poses = _chained(given[0], steps)
    kept = (is_odometry & ~is_correction) | is_lone
    speeds = np.where(is_scan[:, None], 0.0, events[:, _SPEED])
    return _timeline(times[kept], poses[kept], _held(speeds, is_odometry)[kept])


def corrected_odometry(events: Floats, times: Floats, laser_to_base: Floats) -> Timeline:
    """The corrected poses of the scans, in the form of odometry.

    Args:
        events: (n, 10) of a `Survey`, scans of one laser.
        times: (n,) of `stamps_of`, s.
        laser_to_base: (3,) mount of the laser: x, y, m, and yaw, rad.
    """
    poses = compose(events[:, _POSE], inverse(laser_to_base))
    return _timeline(times, poses, np.zeros((len(poses), 2)))


def leap_of(times: Floats, events: Floats) -> str:
    """What a user must know of the largest pause of a log's (n,) times, s; empty if it may be one drive."""
    if len(times) < 2 or np.diff(times).max() <= PAUSE:
        return ""
    place = int(np.argmax(np.diff(times)))
    leap, line = times[place + 1] - times[place], int(events[place + 1, 0])
    return f"its times leap by {leap:.0f} s at line {line}: if the clock was set there, or the robot moved, cut the log"


def standing(times: Floats) -> Timeline:
    """Odometry of a robot that stands still, at (n,) times, s, for logs whose motion only the scans tell."""
    return _timeline(times, np.zeros((len(times), 3)), np.zeros((len(times), 2)))


def twists(stamps: NDArray[np.int64], poses: Floats) -> Floats:
    """(n, 2) forward speed, m/s, and turn rate, rad/s, each over the time since a pose at least `SPAN` earlier."""
    times = (stamps - stamps[:1]) * 1e-9
    before = np.maximum(np.searchsorted(times, times - SPAN, side="right") - 1, 0)
    spans = times - times[before]
    steps = compose(inverse(poses[before]), poses)
    moved = np.column_stack([steps[:, 0], wrap(poses[:, 2] - poses[before, 2])])
    return np.where(spans[:, None] > 0.0, moved / np.maximum(spans, 1e-9)[:, None], 0.0)


def _strictly_rising(times: Floats) -> Floats:
    """The times, strictly increasing: one that does not increase is set 1 µs after its predecessor."""
    found = times.copy()
    for place in np.flatnonzero(np.diff(np.maximum.accumulate(times)) <= 0.0) + 1:
        found[place] = found[:place].max() + 1e-6
    rising: Floats = np.maximum.accumulate(found)
    return rising


def _timeline(times: Floats, poses: Floats, speeds: Floats) -> Timeline:
    """Timeline with one pose a stamp: the last one of several at the same time."""
    stamps = np.round(times * 1e9).astype(np.int64)
    is_last = np.append(stamps[1:] > stamps[:-1], True)
    stamps, poses = stamps[is_last], np.column_stack([poses[is_last, :2], wrap(poses[is_last, 2])])
    found = speeds[is_last] if np.any(speeds) else twists(stamps, poses)
    return Timeline(stamps, poses, found, int((~is_last).sum()))


def _chained(start: Floats, steps: Floats) -> Floats:
    """(n + 1, 3) poses: the start, then the pose after each of n steps."""
    headings = start[2] + np.concatenate([[0.0], np.cumsum(wrap(steps[:, 2]))])
    cosine, sine = np.cos(headings[:-1]), np.sin(headings[:-1])
    x = start[0] + np.concatenate([[0.0], np.cumsum(cosine * steps[:, 0] - sine * steps[:, 1])])
    y = start[1] + np.concatenate([[0.0], np.cumsum(sine * steps[:, 0] + cosine * steps[:, 1])])
    return np.column_stack([x, y, headings])


def _held(values: Floats, is_given: NDArray[np.bool_]) -> Floats:
    """Each given row; other rows repeat the last given row before them."""
    last = np.maximum.accumulate(np.where(is_given, np.arange(len(values)), 0))
    held: Floats = values[last]
    return held


def _corrections(events: Floats) -> NDArray[np.bool_]:
    """(n,) Whether an event is odometry that repeats the corrected pose of the scan directly before it.

    Odometry after the scans with which a log begins is one only if it repeats the pose: it may be a step of the wheels.
    """
    is_scan = events[:, _KIND] != ODOM
    found: NDArray[np.bool_] = np.concatenate([[False], is_scan[:-1]]) & ~is_scan
    first = int(np.argmin(is_scan))
    if found[first] and is_scan[:first].all():
        step = compose(inverse(events[first - 1, _ROBOT]), events[first, _POSE])
        found[first] = bool(max(abs(step[0]), abs(step[1]), abs(wrap(step[2]))) <= REPEATED)
    return found


def _coarse(times: Floats, is_scan: NDArray[np.bool_], is_timed: NDArray[np.bool_]) -> str:
    """Why the times of the scans or of the odometry are those of no clock; empty if they can be."""
    streams = (("scans", is_scan), ("odometry", ~is_scan & is_timed))
    return "; ".join(f"{name}: {why}" for name, is_one in streams if (why := too_coarse(times[is_one])))


def _counted(kinds: Floats, period: float) -> Floats:
    """Times, s, of (n,) kinds of events: scans of the first laser at multiples of the period, the others between them.

    Events before the first of these scans, and after the last, follow each other as on average between them.
    """
    is_scan = kinds != ODOM
    places = np.flatnonzero(kinds == kinds[np.argmax(is_scan)]) if is_scan.any() else np.arange(len(kinds))
    numbers = np.arange(len(kinds), dtype=np.float64)
    found: Floats = np.interp(numbers, places, np.arange(1.0, len(places) + 1.0))
    step = (len(places) - 1) / (places[-1] - places[0]) if len(places) > 1 else 0.5
    found += step * (np.maximum(numbers - places[-1], 0.0) - np.maximum(places[0] - numbers, 0.0))
    return period * (found - min(0.0, float(found[0])))


def _rises(times: Floats) -> bool:
    """Whether these are the times of a clock: they never jump far back and increase overall."""
    if not len(times) or not np.isfinite(times).all():
        return False
    return len(times) == 1 or bool(times[_where_back(times)] > _peak(times) - LATE and times.max() > times[0])


def _peak(times: Floats) -> float:
    """The highest time before the largest backward jump."""
    worst = _where_back(times)
    return float(times[: worst + 1].max())


def _where_back(times: Floats) -> int:
    """Index of the largest backward jump; an invalid time counts as zero."""
    known = np.nan_to_num(times, nan=0.0)
    return int(np.argmax(np.maximum.accumulate(known) - known)) if len(known) else 0
