"""CARMEN logs with corrected poses as drives: odometry, scans, reference poses, maps of their scans, made faults."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from navloom import Context, LocalizerInput, MapperInput, OccupancyGrid, Odometry, Pose2D, RangeScan, RobotSpec, Twist2D
from navloom.geometry.angles import wrap
from navloom.geometry.frames import compose, inverse
from navloom.messages import PoseEstimate, PoseTrack
from navloom.plugins import Discovery
from navloom.runs.localization import STILL_SPEED, STILL_TURN, Localization, corrections
from navloom_carmen.carmen_import import import_carmen
from navloom_recording import Recording, RecordingError
from numpy.typing import NDArray

__all__ = ["FAULTS", "LogDrive", "drive", "faulty", "map_of", "read"]

Floats = NDArray[np.float64]
PERIOD = 0.1
PERIOD_OF_SCANS = 2.0
"""Time between two scans of a log without times, s: they are about 1 m apart."""
ROBOT = RobotSpec(
    np.array([[-0.25, -0.25], [0.25, -0.25], [0.25, 0.25], [-0.25, 0.25]]), 0.6, 0.1, 0.2, 1.0, 1.0, 1.0, 1.0
)
"""The robots of the logs are not described; localizers use none of this."""
FAULTS = ("turn", "spin", "drag", "gap")


@dataclass(frozen=True, eq=False)
class LogDrive:
    """A log, or a part of one. Poses are (n, 3) x, y, m, heading, rad.

    Attributes:
        stamps_ns, odometry: Stamps, (n,) ns, and raw odometry.
        truth: (n, 3) reference poses at the same times, map frame, see `_truth`.
        scans: In order of their stamps.
        track: The log's corrected poses of the scans.
    """

    stamps_ns: NDArray[np.int64]
    odometry: Floats
    truth: Floats
    scans: Sequence[RangeScan]
    track: PoseTrack

    def between(self, first_ns: int, last_ns: int) -> LogDrive:
        """The part between two stamps, which are included."""
        kept = (self.stamps_ns >= first_ns) & (self.stamps_ns <= last_ns)
        scans = [scan for scan in self.scans if first_ns <= scan.stamp_ns <= last_ns]
        return self.of(kept, scans)

    def of(self, kept: NDArray[np.bool_], scans: Sequence[RangeScan]) -> LogDrive:
        """The kept odometry, and these scans."""
        return replace(
            self, stamps_ns=self.stamps_ns[kept], odometry=self.odometry[kept], truth=self.truth[kept], scans=scans
        )


def read(log: Path) -> LogDrive:
    """Read a CARMEN log whose poses a particle filter corrected.

    In a log without raw odometry or without times, the corrected poses with a made drift are the odometry, with ten
    poses from each scan to the next, and the scans are `PERIOD_OF_SCANS` apart.
    """
    with tempfile.TemporaryDirectory() as folder:
        raw, corrected = Path(folder, "raw.mcap"), Path(folder, "corrected.mcap")
        try:
            import_carmen(log, raw, "odometry")
            period = None
        except RecordingError:
            period = PERIOD_OF_SCANS
        import_carmen(log, corrected, "corrected", period)
        stamps_ns, poses, scans = _messages(corrected)
        track = PoseTrack(stamps_ns, poses)
        if period is None:
            stamps_ns, poses, scans = _messages(raw)
            return LogDrive(stamps_ns, poses, _truth(stamps_ns, poses, track), scans, track)
    between_ns = np.arange(stamps_ns[0], stamps_ns[-1] + 1, round(PERIOD_OF_SCANS * 1e8))
    columns = (*poses[:, :2].T, np.unwrap(poses[:, 2]))
    x, y, heading = (np.interp(between_ns, stamps_ns, values) for values in columns)
    truth = np.column_stack([x, y, wrap(heading)])
    return LogDrive(between_ns, _drifting(truth), truth, scans, track)


def _messages(recording: Path) -> tuple[NDArray[np.int64], Floats, list[RangeScan]]:
    """Stamps, ns, and poses of the odometry of a recording, and its scans."""
    messages = [one.message for one in Recording(recording).messages(["platform/*/*"])]
    driven = [message for message in messages if isinstance(message, Odometry)]
    poses = np.array([(message.pose.x, message.pose.y, message.pose.heading) for message in driven])
    stamps_ns = np.array([message.stamp_ns for message in driven], dtype=np.int64)
    return stamps_ns, poses, [message for message in messages if isinstance(message, RangeScan)]


def _drifting(poses: Floats) -> Floats:
    """(n, 3) poses as odometry that measures 3 % too far and turns by 1 degree a metre."""
    steps = _steps(poses)
    steps[:, 2] += math.radians(1.0) * np.hypot(steps[:, 0], steps[:, 1])
    steps[:, :2] *= 1.03
    return _chained(poses[0], steps)


def _truth(stamps_ns: NDArray[np.int64], odometry: Floats, track: PoseTrack) -> Floats:
    """(n, 3) corrected poses at the stamps of odometry.

    Scans are seconds apart, so between two corrected poses the robot follows odometry, whose error is spread linearly.
    """
    last = np.clip(np.searchsorted(track.stamps_ns, stamps_ns, side="right") - 1, 0, len(track.stamps_ns) - 2)
    at = np.clip(np.searchsorted(stamps_ns, track.stamps_ns, side="right") - 1, 0, None)
    driven = compose(inverse(odometry[at[last]]), odometry)
    missing = compose(inverse(compose(inverse(odometry[at[:-1]]), odometry[at[1:]])), _steps(track.poses))
    spans = np.diff(track.stamps_ns)[last]
    share = np.clip((stamps_ns - track.stamps_ns[last]) / spans, 0.0, 1.0)
    return compose(track.poses[last], compose(driven, share[:, None] * missing[last]))


def _steps(poses: Floats) -> Floats:
    """(n - 1, 3) motion from each pose to the next, in the frame of the first."""
    return compose(inverse(poses[:-1]), poses[1:])


def map_of(log: LogDrive, scans: Sequence[RangeScan], cell: float = 0.05) -> OccupancyGrid:
    """A map of some of a log's scans at its corrected poses."""
    mapper_class: Any = Discovery().role("mapper", "scan_grid")
    context = Context("main", PERIOD, ROBOT, _streams(), Pose2D(*log.truth[0].tolist()))
    mapper = mapper_class(mapper_class.Params(cell=cell, max_range=30.0, publish_rate_hz=1000.0), context)
    update = None
    for scan in scans:
        update = mapper.update(MapperInput(scan.stamp_ns, (), (scan,), log.track)) or update
    assert update is not None
    grid: OccupancyGrid = update.grid
    return grid


def drive(
    log: LogDrive,
    name: str,
    known: OccupancyGrid | None,
    params: dict[str, Any] | None = None,
    sigma: tuple[float, float] | None = None,
    odometry: Floats | None = None,
) -> tuple[Localization, list[PoseEstimate]]:
    """What a localizer says on a log, open loop.

    Args:
        log: The log; its first odometry is where the localizer begins.
        name: Plugin of the localizer, also with a preset.
        known: The map; None for a localizer that needs none.
        params: Parameters that differ from the defaults.
        sigma: See `Context.start_sigma`.
        odometry: (n, 3) odometry with made faults instead of the log's.
    """
    own = log.odometry if odometry is None else odometry
    localizer_class = Discovery().role("localizer", name)
    start = Pose2D(*log.truth[0].tolist())
    context = Context("main", PERIOD, ROBOT, _streams(), start, map=known, start_sigma=sigma)
    localizer: Any = localizer_class(localizer_class.Params(**(params or {})), context)
    # A localizer begins where odometry is zero.
    driven = compose(inverse(own[0]), own)
    said, done = [], 0
    for number, (stamp_ns, pose) in enumerate(zip(log.stamps_ns.tolist(), driven, strict=True)):
        scans = []
        while done < len(log.scans) and log.scans[done].stamp_ns <= stamp_ns:
            scans.append(log.scans[done])
            done += 1
        twist = _twist(log.stamps_ns, driven, number)
        given = Odometry(stamp_ns, Pose2D(*pose.tolist()), twist)
        said.append(localizer.localize(LocalizerInput(given, tuple(scans), None, ("laser",) * len(scans))))
    return _beside(log, said, driven), said


def _streams() -> Any:
    made: dict[str, np.random.Generator] = {}
    return lambda name: made.setdefault(name, np.random.default_rng(0))


def _twist(stamps_ns: NDArray[np.int64], poses: Floats, number: int, span_ns: int = 200_000_000) -> Twist2D:
    """Velocity of odometry over the last 0.2 s, as the importer computes it."""
    before = max(0, int(np.searchsorted(stamps_ns, stamps_ns[number] - span_ns, side="right")) - 1)
    passed = (stamps_ns[number] - stamps_ns[before]) * 1e-9
    if passed <= 0.0:
        return Twist2D(0.0, 0.0, 0.0)
    step = compose(inverse(poses[before]), poses[number]) / passed
    return Twist2D(float(step[0]), 0.0, float(step[2]))


def _beside(log: LogDrive, said: Sequence[PoseEstimate], odometry: Floats) -> Localization:
    stamps = np.array([one.stamp_ns for one in said], dtype=np.int64)
    poses = np.array([(one.pose.x, one.pose.y, one.pose.heading) for one in said])
    steps, passed = np.diff(odometry, axis=0, prepend=odometry[:1]), np.diff(stamps, prepend=stamps[:1]) * 1e-9
    is_moving = (np.hypot(*steps[:, :2].T) > STILL_SPEED * passed) | (np.abs(wrap(steps[:, 2])) > STILL_TURN * passed)
    return Localization(
        time=(stamps - stamps[0]) * 1e-9,
        truth=log.truth,
        estimate=poses,
        covariance=np.array([one.covariance[[0, 0, 1, 2], [0, 1, 1, 2]] for one in said]),
        is_tracking=np.array([one.state == "tracking" for one in said]),
        is_moving=is_moving,
        correction=corrections(poses, odometry),
    )


def faulty(log: LogDrive, fault: str, at_ns: int, amount: float) -> tuple[LogDrive, Floats]:
    """The log and its odometry with a fault that begins at a stamp.

    Args:
        fault: "turn": the heading steps by `amount`, degrees. "spin": the wheels turn for 2 s at `amount`, m/s, while
            the robot does not. "drag": the robot moves by `amount`, m, and the wheels do not. "gap": no message for
            `amount`, s.
    """
    stamps, steps = log.stamps_ns, _steps(log.odometry)
    first = int(np.searchsorted(stamps, at_ns))
    if fault == "gap":
        end_ns = at_ns + round(amount * 1e9)
        is_kept = (stamps < at_ns) | (stamps > end_ns)
        scans = [scan for scan in log.scans if not at_ns <= scan.stamp_ns <= end_ns]
        return log.of(is_kept, scans), log.odometry[is_kept]
    if fault == "turn":
        steps[first, 2] += math.radians(amount)
    elif fault == "spin":
        last = int(np.searchsorted(stamps, at_ns + 2_000_000_000))
        steps[first:last, 0] += amount * np.diff(stamps)[first:last] * 1e-9
    elif fault == "drag":
        way = np.cumsum(np.hypot(steps[first:, 0], steps[first:, 1]))
        steps[first : first + int(np.searchsorted(way, amount)) + 1] = 0.0
    else:
        raise ValueError(f"fault {fault!r}: expected one of {', '.join(FAULTS)}")
    return log, _chained(log.odometry[0], steps)


def _chained(start: Floats, steps: Floats) -> Floats:
    """(n + 1, 3) poses: the start, then the pose after each of n steps."""
    poses = [start]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return np.array(poses)
