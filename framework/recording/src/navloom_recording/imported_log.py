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
from navloom.messages import Envelope, Message, Pose2D, RangeScan, Sweep
from navloom.messages.codec import encode, schema_label
from navloom.plugins import Discovery, PluginError
from navloom.plugins.hooks import hookimpl
from navloom.plugins.one_file import available_points
from navloom.plugins.registry import Registry
from navloom.roles import InputError, Platform, PlatformInput, PlatformOutput

from navloom_recording.recording_header import RecordingError, header_of
from navloom_recording.world_attachments import world_files
from navloom_recording.writer import RecordingWriter, WriteError

__all__ = [
    "INSTANCE", "OWN_PORTS", "PERIOD", "RANGE_SCAN", "SWEEP", "ImportedLog", "RecordedPlatform", "discovery",
    "imported_config", "mount_option", "navloom_register", "placed_in_map", "start_option", "writing",
]  # fmt: skip

INSTANCE = "recorded"
"""Name of the platform of an imported log, and of its plugin."""
REALM = "imported"
PERIOD = RunTable().period
"""Period of the ticks assigned to messages, s."""
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

    def put(self, port: str, message: Message, stamp_ns: int, received_ns: int | None = None) -> None:
        """Write a message.

        Args:
            port: "odometry", or the name of a sensor.
            message: Message with the same stamp.
            stamp_ns: Stamp on the log's clock, ns, >= 0.
            received_ns: Time at which the log received it, ns; None if it is not known.
        """
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
        place = {"x": x, "y": y, "heading_deg": float(np.degrees(heading))}
        tree["navigation"] = {**tree.get("navigation", {}), "start": place}
    return replace(loaded, config=Config.model_validate(tree))


def start_option(text: str) -> tuple[float, float, float]:
    """x, y, m, and heading, rad, from `--start X,Y,HEADING_DEG`. Raises ConfigError."""
    try:
        x, y, heading_deg = (float(part) for part in text.split(","))
    except ValueError:
        x = y = heading_deg = math.nan
    if not all(map(math.isfinite, (x, y, heading_deg))):
        raise ConfigError(f"--start {text}: expected X,Y,HEADING_DEG in m and degrees, as in --start 1.5,0,90")
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
