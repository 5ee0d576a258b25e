"""Converts a CARMEN log to a recording: laser scans and odometry, as a platform would have published them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from navloom.geometry.angles import wrap
from navloom.geometry.frames import compose, inverse
from navloom.messages import Odometry, Pose2D, RangeScan, Twist2D
from navloom_recording import (
    RANGE_SCAN,
    ImportedLog,
    RecordingError,
    imported_config,
    placed_in_map,
    scans_alone,
    writing,
)
from numpy.typing import NDArray

from navloom_carmen.carmen import LASERS, ODOM, BeamPattern, Survey, scans, survey
from navloom_carmen.carmen_timeline import Timeline, corrected_odometry, leap_of, raw_odometry, stamps_of, standing

__all__ = ["CarmenLog", "import_carmen"]

Floats = NDArray[np.float64]
Poses = Literal["odometry", "corrected", "none"]
SENSORS = {"FLASER": "laser", "ROBOTLASER1": "laser", "RLASER": "rear_laser", "ROBOTLASER2": "rear_laser"}
"""Name of the sensor by the first word of its lines."""
OFFSETS = {"laser": "robot_frontlaser_offset", "rear_laser": "robot_rearlaser_offset"}
LIMITS = {"laser": "robot_front_laser_max", "rear_laser": "robot_rear_laser_max"}
RANGE_MIN = 0.02
"""Smallest valid reading, m; drivers write 0 for no measurement."""
RANGE_MAX = 80.0
"""Default limit from which readings count as no echo, m; a SICK LMS writes 81.83 or 81.91 for none."""
STEADY = 0.02
"""Largest scatter of the laser's pose on the robot over a log for it to be the mount, m and rad."""


@dataclass
class CarmenLog:
    """Result of an import.

    Attributes:
        is_corrected: Whether its poses come from a particle filter.
        odometry: Number of odometry messages.
        scans: Number of scans by sensor.
        mounts: x, y, m, yaw, rad, by sensor.
        skipped: Number of lines left out, by reason.
        first_ns, last_ns: First and last stamp, ns.
        note: What else a user must know; empty for nothing.
    """

    is_corrected: bool
    odometry: int = 0
    scans: Counter[str] = field(default_factory=Counter)
    mounts: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    skipped: Counter[str] = field(default_factory=Counter)
    first_ns: int = 0
    last_ns: int = 0
    note: str = ""

    def to_json(self) -> dict[str, Any]:
        """The result as `import --json` prints it."""
        return {
            "seconds": (self.last_ns - self.first_ns) * 1e-9,
            "corrected": self.is_corrected,
            "odometry": self.odometry,
            "scans": dict(self.scans),
            "mounts": {name: [x, y, math.degrees(yaw)] for name, (x, y, yaw) in self.mounts.items()},
            "skipped": dict(self.skipped),
            "note": self.note,
        }


def import_carmen(
    log: Path,
    out: Path,
    poses: Poses = "odometry",
    period: float | None = None,
    range_max: float | None = None,
    mounts: Mapping[str, tuple[float, float, float]] | None = None,
    map_ref: str | None = None,
    start: tuple[float, float, float] | None = None,
) -> CarmenLog:
    """Convert a log.

    Args:
        log: Text file, or text in gzip.
        out: Recording to write.
        poses: "odometry" is the wheel odometry, recovered if the log is corrected; "corrected" is the log's poses,
            "none" is a robot that stands still.
        period: Time between two scans, s, if the log's times are unusable.
        range_max: Readings from this limit on are no echo, m; None for the log's own limit or `RANGE_MAX`.
        mounts: x, y, m, yaw, rad, by sensor, where the log is wrong.
        map_ref, start: See `placed_in_map`.

    Raises:
        RecordingError: Not a log, beyond a bound, or without scans, odometry or times; or `out` exists.
        ConfigError: The map cannot be read.
        WriteError: The disk is full; no file is left.
    """
    found = survey(log)
    named = _named(found)
    wrong = [name for name in mounts or () if name not in named.values()]
    if wrong:
        raise RecordingError(f"--mount {wrong[0]}: the log has no such sensor; it has {', '.join(named.values())}")
    result = CarmenLog(found.is_corrected)
    result.mounts = {name: (mounts or {}).get(name) or _mount(found, word, name) for word, name in named.items()}
    try:
        is_scan = found.events[:, 1] != ODOM
        if poses != "odometry":
            found.events = found.events[is_scan]
        times = stamps_of(found.events, found.is_corrected, period)
        if poses == "corrected":
            word = next(word for word, name in named.items() if name == "laser")
            is_front = found.events[:, 1] == LASERS.index(word) + 1
            way = corrected_odometry(found.events[is_front], times[is_front], np.array(result.mounts["laser"]))
        elif poses == "none":
            way = standing(times)
        else:
            way = _raw_odometry(found, times, out)
    except RecordingError as error:
        raise RecordingError(f"{log}: {error}") from None
    result.skipped.update(found.skipped)
    loaded = imported_config(log.name, dict.fromkeys(named.values(), RANGE_SCAN))
    if map_ref is not None or start is not None:
        loaded = placed_in_map(loaded, map_ref, start, Pose2D(*way.poses[0].tolist()))
    with writing(out, loaded, log.name) as written:
        _write(written, log, found, times, way, named, range_max, result)
        if not result.scans:
            raise RecordingError(f"{log}: no scan can be used: {next(iter(result.skipped), 'it holds none')}")
    if way.left_out:
        result.skipped["odometry: at the time of a later line"] = way.left_out
    result.first_ns, result.last_ns = written.first_ns, written.last_ns
    result.note = "; ".join(filter(None, [leap_of(times, found.events), written.odometry_note]))
    return result


def _raw_odometry(found: Survey, times: Floats, out: Path) -> Timeline:
    try:
        return raw_odometry(found.events, times, found.is_corrected)
    except RecordingError as error:
        raise RecordingError(f"{error}, or the scans alone, with --poses none, and {scans_alone(out)}") from None


def _named(found: Survey) -> dict[str, str]:
    """Name of each sensor by the first word of its lines. A laser that is logged in two formats is used once."""
    kinds = {int(kind) for kind in np.unique(found.events[:, 1])} - {ODOM}
    words = [LASERS[kind - 1] for kind in sorted(kinds)]
    named: dict[str, str] = {}
    for word in words:
        if SENSORS[word] in named.values():
            found.skipped[f"{word}: the same laser as {next(w for w, n in named.items() if n == SENSORS[word])}"] = (
                found.counts[word]
            )
        else:
            named[word] = SENSORS[word]
    if not named:
        raise RecordingError(f"no scans: expected lines of {', '.join(LASERS)}; there are {', '.join(found.counts)}")
    if "laser" not in named.values():
        named = dict.fromkeys(named, "laser")
    return named


def _mount(found: Survey, word: str, name: str) -> tuple[float, float, float]:
    """Mount of a laser: from the two poses of its scans if they agree over the log, else from the log's parameters."""
    rows = found.events[found.events[:, 1] == LASERS.index(word) + 1]
    places = compose(inverse(rows[:, 5:8]), rows[:, 2:5])
    off = np.abs(places - places[0])
    off[:, 2] = np.abs(wrap(off[:, 2]))
    if off.max() < STEADY and np.abs(places[0]).max() > 1e-6:
        x, y, yaw = places[0].tolist()
        return x, y, yaw
    try:
        offset = float(found.params.get(OFFSETS[name], 0.0))
    except ValueError:
        offset = 0.0
    return (offset if abs(offset) < 10.0 else 0.0), 0.0, (math.pi if name == "rear_laser" else 0.0)


def _limit(found: Survey, name: str, given: float | None, beams: BeamPattern) -> float:
    if given is not None or beams.range_max is not None:
        return given or beams.range_max or RANGE_MAX
    try:
        limit = float(found.params.get(LIMITS[name], RANGE_MAX))
    except ValueError:
        return RANGE_MAX
    return limit if RANGE_MIN < limit < 1e4 else RANGE_MAX


def _write(
    written: ImportedLog,
    log: Path,
    found: Survey,
    times: Floats,
    way: Timeline,
    named: Mapping[str, str],
    range_max: float | None,
    result: CarmenLog,
) -> None:
    """Write odometry and scans in the order of their stamps, odometry first at equal stamps."""
    time_of = dict(zip(found.events[:, 0].astype(int).tolist(), times.tolist(), strict=True))
    word_of = dict(zip(found.events[:, 0].astype(int).tolist(), found.events[:, 1].astype(int).tolist(), strict=True))
    done, last_ns = 0, dict[str, int]()

    def odometry_until(stamp_ns: float) -> None:
        nonlocal done
        while done < len(way.stamps) and way.stamps[done] <= stamp_ns:
            (x, y, heading), (v, w) = way.poses[done].tolist(), way.twists[done].tolist()
            at = int(way.stamps[done])
            written.put("odometry", Odometry(at, Pose2D(x, y, heading), Twist2D(v, 0.0, w)), at)
            done += 1

    for line, ranges, beams in scans(log):
        word = LASERS[word_of[line] - 1]
        if word not in named:
            continue
        name, stamp_ns = named[word], round(time_of[line] * 1e9)
        if stamp_ns <= last_ns.get(name, -1):
            result.skipped[f"{word}: at the time of the scan before it"] += 1
            continue
        scan = _scan(stamp_ns, ranges, beams, result.mounts[name], _limit(found, name, range_max, beams))
        if scan is None:
            result.skipped[f"{word}: no reading is a measurement"] += 1
            continue
        odometry_until(stamp_ns)
        written.put(name, scan, stamp_ns)
        last_ns[name] = stamp_ns
        result.scans[name] += 1
    odometry_until(math.inf)
    result.odometry = done


def _scan(
    stamp_ns: int, ranges: Floats, beams: BeamPattern, mount: tuple[float, float, float], range_max: float
) -> RangeScan | None:
    """A scan in the base frame. Readings at or beyond the limit are no echo; those below `RANGE_MIN` are left out."""
    is_kept = ranges >= RANGE_MIN
    count = int(is_kept.sum())
    if not count:
        return None
    bearings: Floats = beams.first + beams.step * np.arange(len(ranges), dtype=np.float64)[is_kept] + mount[2]
    echoes = np.where(ranges[is_kept] >= range_max, np.inf, ranges[is_kept])
    zeros = np.zeros(count)
    origins = np.tile(np.array(mount[:2]), (count, 1))
    return RangeScan(stamp_ns, origins, wrap(bearings), zeros, zeros, echoes, RANGE_MIN, range_max)
