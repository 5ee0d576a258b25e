"""Reads the odometry and the lasers of a recording into arrays."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from navloom.messages import Odometry, RangeScan
from navloom_recording import Recording, RecordingError
from numpy.typing import NDArray

from navloom_calibration.laser_track import Beams, Way

__all__ = ["Drive", "Laser", "opened", "read_drive"]

_WIDEST = math.radians(1.0)
"""Widest half angle of a laser's beam, rad; a sonar's is ten times as wide."""
_LEAST_BEAMS = 20
"""Least beams of a scan whose fit shows a motion."""


class Laser(NamedTuple):
    """The scans of one laser.

    Attributes:
        name: Of the sensor.
        scans: By rising stamps, which count from the beginning of the drive.
        mount: (2,) place on the base, m.
    """

    name: str
    scans: list[Beams]
    mount: NDArray[np.float64]


class Drive(NamedTuple):
    """A recorded drive. Its stamps count from its first odometry, s."""

    way: Way
    lasers: list[Laser]


@contextmanager
def opened(file: Path, say: Callable[[str], None]) -> Iterator[Recording]:
    """A recording, or a CARMEN log or ROS bag as one, which is imported into a temporary folder.

    Raises:
        RecordingError: It is none of these.
    """
    if not file.exists():
        raise RecordingError(f"{file}: there is no such file")
    words = ["ros", "import"] if file.is_dir() or file.suffix in (".bag", ".db3") else ["import"]
    if file.suffix == ".mcap" and not file.is_dir():
        with Recording(file) as recording:
            yield recording
        return
    say("importing the log")
    with TemporaryDirectory() as folder:
        out = Path(folder) / "log.mcap"
        done = subprocess.run(
            [sys.executable, "-m", "navloom", *words, str(file), "--out", str(out)], capture_output=True, text=True
        )
        if done.returncode or not out.exists():
            why = done.stderr.strip().rpartition("\n")[2].partition(": ")[2] or f"{file}: cannot be imported"
            raise RecordingError(f"{why}; its options are those of `navloom {' '.join(words)}`: import it first")
        with Recording(out) as recording:
            yield recording


def read_drive(
    recording: Recording, sensor: str | None = None, since_ns: int | None = None, until_ns: int | None = None
) -> Drive:
    """The odometry and the lasers of a recording.

    Args:
        recording: The recording.
        sensor: The only laser to read; None for all.
        since_ns, until_ns: See `Recording.messages`.

    Raises:
        RecordingError: It has no odometry that moves, or no laser.
    """
    odometry: list[tuple[float, ...]] = []
    scans: dict[str, list[RangeScan]] = {}
    zero_ns: int | None = None
    for recorded in recording.messages(["platform/*/*"], since_ns, until_ns):
        message, port = recorded.message, recorded.key.rsplit("/", 1)[1]
        if isinstance(message, Odometry):
            zero_ns = message.stamp_ns if zero_ns is None else zero_ns
            pose = message.pose
            odometry.append(((message.stamp_ns - zero_ns) * 1e-9, pose.x, pose.y, pose.heading))
        elif isinstance(message, RangeScan) and _is_laser(message):
            scans.setdefault(port, []).append(message)
    way = _way(recording.path, odometry)
    if sensor is not None and sensor not in scans:
        raise RecordingError(f"--sensor {sensor}: the lasers of {recording.path} are {', '.join(scans) or 'none'}")
    if not scans:
        raise RecordingError(f"{recording.path}: it holds no scans of a laser: expected a sensor with narrow beams")
    assert zero_ns is not None
    return Drive(way, [_laser(name, scans[name], zero_ns) for name in sorted(scans) if sensor in (None, name)])


def _is_laser(scan: RangeScan) -> bool:
    return len(scan.ranges) >= _LEAST_BEAMS and float(scan.half_angles.max()) <= _WIDEST


def _way(path: Path, rows: list[tuple[float, ...]]) -> Way:
    """Odometry with rising stamps; those that repeat or fall are left out."""
    if len(rows) < 2:
        raise RecordingError(f"{path}: it holds no odometry: scans alone do not show how late they are")
    table = np.array(rows)
    newest = np.maximum.accumulate(np.concatenate(([-math.inf], table[:-1, 0])))
    table = table[table[:, 0] > newest]
    table[:, 3] = np.unwrap(table[:, 3])
    if not np.ptp(table[:, 1:], axis=0).any():
        raise RecordingError(f"{path}: its odometry stands still: drive a turn")
    return Way(table[:, 0], table[:, 1:])


def _laser(name: str, scans: list[RangeScan], zero_ns: int) -> Laser:
    beams: list[Beams] = []
    for scan in scans:
        stamp = (scan.stamp_ns - zero_ns) * 1e-9
        if not beams or stamp > beams[-1].stamp:
            limits = (scan.range_min, scan.range_max)
            beams.append(
                Beams(stamp, scan.origins, scan.bearings, scan.half_angles, scan.time_offsets, scan.ranges, *limits)
            )
    return Laser(name, beams, np.array(scans[0].origins[0]))
