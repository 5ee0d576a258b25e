"""Common part of log importers: writes the messages of a platform that is not driven, and a config for replays."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
from navloom.config import ConfigError, Loaded
from navloom.config.schema import Config
from navloom.config.tables import RunTable
from navloom.engine.streams import OWN_PORTS
from navloom.entry_kinds import GROUP
from navloom.geometry.frames import compose, inverse
from navloom.inputs import heading_problem, warn_of_radians
from navloom.messages import Envelope, Message, Odometry, Pose2D, RangeScan, Sweep
from navloom.messages.codec import encode, schema_label
from navloom.parts import has_part, part
from navloom.plugins import Discovery, PluginError
from navloom.plugins.hooks import hookimpl
from navloom.plugins.one_file import available_points
from navloom.plugins.registry import Registry
from navloom.roles import InputError, Platform, PlatformInput, PlatformOutput
from numpy.typing import NDArray

from navloom_recording.recording_header import RecordingError, header_of
from navloom_recording.world_attachments import world_files
from navloom_recording.writer import RecordingWriter, WriteError

__all__ = [
    "INSTANCE", "OWN_PORTS", "PERIOD", "RANGE_SCAN", "SWEEP", "ImportedLog", "RecordedPlatform", "discovery",
    "imported_config", "late_note", "mount_option", "navloom_register", "placed_in_map", "scans_alone", "start_option",
    "too_coarse", "writing",
]  # fmt: skip

INSTANCE = "recorded"
"""Name of the platform of an imported log, and of its plugin."""
REALM = "imported"
PERIOD = RunTable().period
"""Period of the ticks assigned to messages, s."""
FASTEST, FASTEST_TURN = 5.0, math.pi
"""Speed, m/s, and turn rate, rad/s, that no robot indoors exceeds; odometry that does has restarted."""
SLACK, SLACK_TURN = 0.3, 0.9
"""Step, m and rad, that is allowed at once: importers put odometry whose stamps run back at a scan's stamp."""
FEW = 3
"""Most messages of a stream that do not tell whether their stamps are a clock's."""
RANGE_SCAN, SWEEP = "range_scan", "sweep"
"""Kinds of sensors of an imported log."""


class ImportedLog:
    """Writes the messages that a platform would have published, in the order of the log. Created by `writing`.

    Attributes:
        first_ns, last_ns: First and last stamp, ns; 0 before the first message.
    """

    def __init__(self, writer: RecordingWriter) -> None:
        self.first_ns = self.last_ns = 0
        self._writer = writer
        self._sequences: Counter[str] = Counter()
        self._origin_ns: int | None = None
        self._odometry: Odometry | None = None
        self._jumps = 0
        self._largest = (0.0, "")
        self._moves = self._has_scans = False

    @property
    def odometry_note(self) -> str:
        """What the user must know: the odometry stands still, or has steps that no robot drives; else empty."""
        if not self._moves and self._has_scans:
            return f"odometry: it stands still; if the robot moved, {scans_alone(self._writer.path)}"
        if not self._jumps:
            return ""
        steps = "1 step is" if self._jumps == 1 else f"{self._jumps} steps are"
        return f"odometry: {steps} beyond a robot's reach; the largest is {self._largest[1]}"

    def put(self, port: str, message: Message, stamp_ns: int, received_ns: int | None = None) -> None:
        """Write a message.

        Args:
            port: "odometry", or the name of a sensor.
            message: Message with the same stamp.
            stamp_ns: Stamp on the log's clock, ns, >= 0.
            received_ns: Time at which the log received it, ns; None if it is not known.
        """
        if isinstance(message, Odometry):
            self._judge_step(message)
        self._has_scans |= isinstance(message, RangeScan)
        # Ticks count from the first message, stamps stay those of the log.
        self._origin_ns = stamp_ns if self._origin_ns is None else self._origin_ns
        self.first_ns = min(self.first_ns or stamp_ns, stamp_ns)
        self.last_ns = max(self.last_ns, stamp_ns)
        self._sequences[port] += 1
        number = self._sequences[port]
        key = f"{self._writer.header.prefix}/platform/{INSTANCE}/{port}"
        tick = max(0, round((stamp_ns - self._origin_ns) * 1e-9 / PERIOD))
        data = encode(message, Envelope(key, number, tick, stamp_ns, stamp_ns, 0))
        received_ns = stamp_ns if received_ns is None else received_ns
        self._writer.add(key, schema_label(type(message)), data, received_ns, stamp_ns, number)

    def _judge_step(self, odometry: Odometry) -> None:
        before, self._odometry = self._odometry, odometry
        if before is None:
            return
        seconds = max(0, odometry.stamp_ns - before.stamp_ns) * 1e-9
        away = math.hypot(odometry.pose.x - before.pose.x, odometry.pose.y - before.pose.y)
        turn = abs(math.remainder(odometry.pose.heading - before.pose.heading, math.tau))
        self._moves |= away > 0.0 or turn > 0.0
        excess = max(away / (SLACK + FASTEST * seconds), turn / (SLACK_TURN + FASTEST_TURN * seconds))
        if excess > 1.0:
            self._jumps += 1
            at = (odometry.stamp_ns - self.first_ns) * 1e-9
            step = f"{away:.2f} m and {math.degrees(turn):.0f}° in {seconds:.2f} s, at {at:.1f} s"
            self._largest = max(self._largest, (excess, step))


@contextmanager
def writing(out: Path, loaded: Loaded, origin: str) -> Iterator[ImportedLog]:
    """Write a recording of another system's log; the file is removed if the import fails.

    Args:
        out: Recording to write.
        loaded: Config from `imported_config`.
        origin: Name of the log.

    Raises:
        RecordingError: The file exists already.
        WriteError: The disk is full.
    """
    header = replace(header_of(loaded, "imported", {}), clock="wall", origin=origin)
    writer = RecordingWriter(out, header, world_files(loaded))
    try:
        with writer:
            yield ImportedLog(writer)
            writer.close({"messages": writer.messages})
    # Also for Ctrl-C: half an import looks like a whole one.
    except BaseException as error:
        writer.discard()
        if isinstance(error, WriteError):
            raise WriteError(f"{out}: {error.why}; nothing of the import is kept", error.why) from None
        raise


def imported_config(log: str, sensors: Mapping[str, str]) -> Loaded:
    """A config with a log's sensors and the default plugins.

    Args:
        log: Name of the log's file.
        sensors: Kind of each sensor, by name.

    Raises:
        RecordingError: A sensor name is not valid.
    """
    for name in sensors:
        if name in OWN_PORTS or not re.fullmatch(r"[a-z][A-Za-z0-9_]*", name):
            raise RecordingError(f"{name!r} cannot name a sensor: expected letters, digits and _, a small letter first")
    robot = re.sub(r"[^A-Za-z0-9_-]", "_", log.partition(".")[0]) or "log"
    tree = {
        "run": {"period": PERIOD},
        "robot": {"realm": REALM, "name": robot},
        "platform": {"plugin": INSTANCE},
        "mapper": {"plugin": "scan_grid"} if RANGE_SCAN in sensors.values() else {},
        "sensor": [{"name": name, "kind": kind} for name, kind in sensors.items()],
    }
    return Loaded(Config.model_validate(tree), log, Path("."), {}, ())


def placed_in_map(
    loaded: Loaded, map_ref: str | None, start: tuple[float, float, float] | None, first: Pose2D
) -> Loaded:
    """An imported log's config with a map and the pose of the odometry frame in it.

    Args:
        loaded: Its config.
        map_ref: A world's reference, or the .yaml of a map_server; None for no map.
        start: x, y, m, heading, rad, of the robot in the map when the log begins; None if the odometry frame is the
            map frame.
        first: The first odometry pose of the log.

    Raises:
        ConfigError: The map cannot be read.
    """
    tree: dict[str, Any] = loaded.config.model_dump(mode="json", exclude_unset=True)
    if map_ref is not None:
        try:
            Discovery().world(map_ref, loaded.base_of("map.ref"))
        except (PluginError, ValueError) as error:
            raise ConfigError(f"--map {map_ref}: {error}") from None
        tree["map"] = {"ref": map_ref}
    if start is not None:
        x, y, heading = compose(np.array(start), inverse(np.array([first.x, first.y, first.heading]))).tolist()
        place = {"x": x, "y": y, "heading_deg": math.remainder(math.degrees(heading), 360.0)}
        tree["navigation"] = {**tree.get("navigation", {}), "start": place}
    return replace(loaded, config=Config.model_validate(tree))


def too_coarse(stamps: NDArray[Any], share: float = 0.3) -> str:
    """Why the stamps of a stream, (n,), are those of no clock; empty if they can be.

    A clock moves between messages. Unset stamps are equal, and so are many rounded ones; up to three sensors of one
    topic may measure at the same time.

    Args:
        stamps: In any unit, in the order of the log.
        share: Least share of stamps that differ from the one before.
    """
    changes = int((np.diff(stamps) != 0).sum())
    if len(stamps) <= FEW or changes > share * (len(stamps) - 1):
        return ""
    seen = f"have {changes + 1} different stamps" if changes else f"all have the stamp {stamps[0]:g}"
    return f"its {len(stamps)} messages {seen}"


def late_note(recording: Path) -> str:
    """Which lasers of a recording are late, see navloom-calibration; empty without it."""
    if not has_part("navloom_calibration"):
        return ""
    found: str = part("navloom_calibration.late_note").late_note(recording)
    return found


def scans_alone(recording: Path) -> str:
    """What to do with a recording whose odometry stands still: the robot is followed by its scans."""
    return f"follow its scans with `navloom replay {recording} --localizer scan_odometry`"


def start_option(text: str) -> tuple[float, float, float]:
    """x, y, m, and heading, rad, from `--start X,Y,HEADING_DEG`. Raises ConfigError."""
    try:
        x, y, heading_deg = (float(part) for part in text.split(","))
    except ValueError:
        x = y = heading_deg = math.nan
    if not all(map(math.isfinite, (x, y, heading_deg))):
        raise ConfigError(f"--start {text}: expected X,Y,HEADING_DEG in m and degrees, as in --start 1.5,0,90")
    if problem := heading_problem(heading_deg):
        raise ConfigError(f"--start {text}: its heading: {problem}")
    warn_of_radians(heading_deg)
    return x, y, math.radians(heading_deg)


def mount_option(text: str) -> tuple[str, tuple[float, float, float, float]]:
    """A sensor's name and its x, y, m, yaw, rad, and z, m, from `--mount NAME=X,Y,YAW_DEG[,Z]`. Raises ConfigError."""
    name, _, place = text.partition("=")
    try:
        x, y, yaw_deg, *rest = (float(part) for part in place.split(","))
        (z,) = rest or [0.0]
        if not name or not all(map(math.isfinite, (x, y, yaw_deg, z))):
            raise ValueError
    except ValueError:
        raise ConfigError(
            f"--mount {text}: expected NAME=X,Y,YAW_DEG in m and degrees, and ,Z if it matters, "
            "as in --mount scan=0.1,0,0"
        ) from None
    if problem := heading_problem(yaw_deg):
        raise ConfigError(f"--mount {text}: its yaw: {problem}")
    warn_of_radians(yaw_deg)
    return name, (x, y, math.radians(yaw_deg), z)


class RecordedPlatform(Platform):
    """Placeholder for the robot of a log."""

    name = INSTANCE
    sensor_kinds = {RANGE_SCAN: RangeScan, SWEEP: Sweep}

    def advance(self, given: PlatformInput) -> PlatformOutput:
        """Raise InputError: a log cannot be driven."""
        raise InputError("the platform of an imported log cannot drive: replay it instead")


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Register the platform."""
    registry.add(RecordedPlatform)


def discovery() -> Discovery:
    """The installed plugins and this platform. It is not installed itself, as it would be offered for real robots."""
    own = EntryPoint(f"platform.{INSTANCE}", "navloom_recording.imported_log", GROUP)
    return Discovery((), [*available_points(), own])
