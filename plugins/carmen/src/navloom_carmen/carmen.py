"""Reads CARMEN logs line by line, within bounds: odometry, laser scans, and the parameters of the log.

Lines that are read (CARMEN's manual, logger format; words are separated by blanks, `#` begins a comment):

- `ODOM x y theta tv rv accel ipc_time host logger_time`
- `FLASER n r1 … rn x y theta odom_x odom_y odom_theta ipc_time host logger_time`, and `RLASER` of a laser to the rear
- `ROBOTLASER1 type start field resolution max accuracy mode n r1 … rn m i1 … im x y theta odom_x odom_y odom_theta
  tv rv front side axis ipc_time host logger_time`, and `ROBOTLASER2`
- `PARAM name value …`
- `NEFF n`, which a Rao-Blackwellised particle filter adds: poses of such a log are corrected
"""

from __future__ import annotations

import gzip
import io
import math
import os
import zlib
from array import array
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from navloom.inputs import LOG_MB, bytes_of, open_file, too_large
from navloom_recording import RecordingError
from numpy.typing import NDArray

__all__ = ["LASERS", "ODOM", "BeamPattern", "Survey", "scans", "survey"]

Floats = NDArray[np.float64]
ODOM = 0
"""Kind of an odometry event; the kind of a laser is its position in `LASERS`, counted from 1."""
LASERS = ("FLASER", "RLASER", "ROBOTLASER1", "ROBOTLASER2")
LONGEST = 1 << 20
"""Longest line, bytes: 100,000 readings."""
MOST = 1_000_000
"""Most lines of odometry and scans in a log: 14 hours at 20 Hz."""
FARTHEST = 1e7
"""Largest coordinate, m."""
LATEST = 8e9
"""Latest time, s since 1970."""
HALF_TURN = math.pi


class _Unfit(ValueError):
    """A line that does not match the format of its first word."""


@dataclass(frozen=True)
class BeamPattern:
    """Beams of a laser: the first bearing and the step, rad, in its own frame; its maximum range, m, or None."""

    first: float
    step: float
    range_max: float | None


@dataclass
class Survey:
    """Contents of a log without the readings.

    Attributes:
        events: (n, 10) in the order of the log: line, kind, six values, ipc_time and logger_time; m, rad, s. The six
            values are x, y, heading, tv, rv, 0 for odometry; x, y, heading of the laser, then of the robot, for a scan.
        params: Value by name.
        is_corrected: Whether a particle filter wrote it.
        counts: Number of lines by first word.
        skipped: Number of unreadable lines by reason.
    """

    events: Floats
    params: dict[str, str] = field(default_factory=dict)
    is_corrected: bool = False
    counts: Counter[str] = field(default_factory=Counter)
    skipped: Counter[str] = field(default_factory=Counter)


def survey(path: Path) -> Survey:
    """Read a log once.

    Raises:
        RecordingError: It cannot be read, exceeds a bound, or is not a CARMEN log.
    """
    rows, found = array("d"), Survey(np.empty((0, 10)))
    for number, words in _lines(path):
        name = words[0]
        if name == "PARAM" and len(words) > 2:
            found.params[words[1]] = words[2]
        elif name == "NEFF":
            found.is_corrected = True
        try:
            if name == "ODOM":
                rows.extend((number, ODOM, *_odometry(words)))
            elif name in LASERS:
                rows.extend((number, LASERS.index(name) + 1, *_poses(words)))
        except _Unfit as error:
            found.skipped[f"{name}: {error}"] += 1
        found.counts[name if name.isalnum() and len(name) < 20 else "other"] += 1
        if len(rows) > 10 * MOST:
            raise RecordingError(f"{path}: more than {MOST} lines of odometry and scans; cut the log into parts")
    found.events = np.frombuffer(rows, dtype=np.float64).reshape(-1, 10)
    if not len(found.events):
        why = next(iter(found.skipped), f"expected lines of ODOM and {', '.join(LASERS)}")
        raise RecordingError(f"{path}: not a log of CARMEN that can be used: {why}")
    return found


def scans(path: Path) -> Iterator[tuple[int, Floats, BeamPattern]]:
    """Line, ranges, (n,) m, and beams of each scan for which `survey` has an event, in the same order."""
    for number, words in _lines(path):
        if words[0] in LASERS:
            try:
                _poses(words)
                yield number, *_readings(words)
            except _Unfit:
                continue


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Number and words of each line that has any; gzip is unpacked within the bound."""
    limit = bytes_of(LOG_MB, RecordingError)
    left = limit
    try:
        with open_file(path, RecordingError) as file:
            packed = file.read(2) == b"\x1f\x8b"
            file.seek(0)
            if not packed and (size := os.fstat(file.fileno()).st_size) > limit:
                raise RecordingError(too_large(f"{path}: {size / 1e6:.6g} MB", limit))
            source = io.BufferedReader(gzip.GzipFile(fileobj=file)) if packed else file
            number = 0
            while line := source.readline(LONGEST + 1):
                number, left = number + 1, left - len(line)
                if left < 0:
                    raise RecordingError(too_large(f"{path}: unpacks to more than {limit / 1e6:g} MB", limit))
                if len(line) > LONGEST:
                    raise RecordingError(f"{path}: line {number}: more than {LONGEST} bytes: not a log of CARMEN")
                words = line.decode("ascii", "replace").split()
                if words and not words[0].startswith("#"):
                    yield number, words
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise RecordingError(f"{path}: damaged gzip ({error}); copy the file again") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from None


def _odometry(words: Sequence[str]) -> tuple[float, ...]:
    if len(words) < 10:
        raise _Unfit(f"{len(words)} words, expected 10")
    return (*_numbers(words[1:6], FARTHEST), 0.0, *_times(words[7], words[9]))


def _poses(words: Sequence[str]) -> tuple[float, ...]:
    """Poses of laser and robot, and the times, of a scan with all its readings."""
    _, after = _places(words)
    return (*_numbers(words[after : after + 6], FARTHEST), *_times(words[-3], words[-1]))


def _places(words: Sequence[str]) -> tuple[int, int]:
    """Index of the first reading of a scan, and of the first word after its readings and remissions."""
    is_new = words[0].startswith("ROBOT")
    first = 9 if is_new else 2
    after = first + _count(words, first - 1)
    if is_new:
        after += 1 + _count(words, after)
    tail = 14 if is_new else 9
    if len(words) < after + tail:
        raise _Unfit(f"{len(words)} words, expected {after + tail}")
    if len(words) > after + tail:
        raise _Unfit(f"{len(words)} words, expected {after + tail}: another number of readings than it says")
    return first, after


def _readings(words: Sequence[str]) -> tuple[Floats, BeamPattern]:
    first, _ = _places(words)
    count = _count(words, first - 1)
    try:
        ranges = np.array([float(word) for word in words[first : first + count]])
    except ValueError:
        ranges = np.full(count, np.nan)
    if not words[0].startswith("ROBOT"):
        return ranges, _sick(count)
    start, span, step, range_max = _numbers(words[2:6], 1e4)
    step = step or span / max(count - 1, 1)
    return ranges, BeamPattern(start, step, range_max if range_max > 0.0 else None)


def _sick(count: int) -> BeamPattern:
    """Beams of the older lines, which lack them: a SICK laser with a view of 180°, 100° with 400 or 401 beams."""
    half = math.radians(50.0) if count in (400, 401) else HALF_TURN / 2.0
    steps = count if count % 10 == 0 else max(count - 1, 1)
    return BeamPattern(-half, 2.0 * half / max(steps, 1), None)


def _count(words: Sequence[str], place: int) -> int:
    word = words[place] if place < len(words) else ""
    if not (word.isascii() and word.isdigit() and len(word) < 7):
        raise _Unfit("no number of readings")
    return int(word)


def _times(ipc: str, logger: str) -> tuple[float, float]:
    """Both times, s; NaN for an invalid one."""
    found = []
    for word in (ipc, logger):
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        found.append(value if 0.0 <= value < LATEST else math.nan)
    return found[0], found[1]


def _numbers(words: Sequence[str], most: float) -> list[float]:
    try:
        found = [float(word) for word in words]
    except ValueError:
        raise _Unfit("a word where a number is expected") from None
    if not all(abs(value) <= most for value in found):
        raise _Unfit(f"a number that is not within ±{most:g}")
    return found
