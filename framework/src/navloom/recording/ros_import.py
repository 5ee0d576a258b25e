"""Makes a recording of a ROS 1 or ROS 2 bag: what a platform would have published, and nothing else."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from navloom.config import Loaded
from navloom.config.schema import Config
from navloom.messages import Envelope, Message, MessageError, Odometry, Pose2D, Twist2D
from navloom.messages.codec import encode, schema_label
from navloom.recording.header import RecordingError, header_of
from navloom.recording.ros_bags import deserialized, messages, opened
from navloom.recording.ros_convert import (
    ConversionError,
    laser_scan,
    odometry,
    point_cloud,
    range_reading,
    stamp_of,
    yaw_of,
)
from navloom.recording.ros_frames import BASES, FrameTree, Mount, quaternion_matrix
from navloom.recording.writer import RecordingWriter, WriteError

__all__ = ["INSTANCE", "PERIOD", "Imported", "Topic", "import_bag"]

INSTANCE = "recorded"
"""Name of the platform of an imported log, and of its plugin."""
REALM = "imported"
PERIOD = 0.05
"""s of a tick that messages are counted by."""
RANGE_SCAN, SWEEP = "range_scan", "sweep"
_CONVERT = {
    "sensor_msgs/msg/LaserScan": (laser_scan, RANGE_SCAN),
    "sensor_msgs/msg/Range": (range_reading, RANGE_SCAN),
    "sensor_msgs/msg/PointCloud2": (point_cloud, SWEEP),
}
_ODOMETRY = "nav_msgs/msg/Odometry"
_TRANSFORMS = frozenset({"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"})
ODOM = "odom"
"""Frame that a transform to the robot is odometry from."""
_OWN = frozenset({"odometry", "contact", "truth"})


@dataclass
class Topic:
    """What became of a topic.

    Attributes:
        name, type: Of the topic.
        sensor: Port it became; empty where it was skipped.
        messages: Converted.
        skipped: By reason, how many were not; for a whole topic that was skipped its number of messages.
    """

    name: str
    type: str
    sensor: str = ""
    messages: int = 0
    skipped: Counter[str] = field(default_factory=Counter)

    def to_json(self) -> dict[str, Any]:
        """For `import --json`."""
        return {**vars(self), "skipped": dict(self.skipped)}


@dataclass
class Imported:
    """A bag that was imported: its topics in order of name, and the first and the last stamp, ns."""

    topics: list[Topic]
    first_ns: int = 0
    last_ns: int = 0


def import_bag(
    bag: Path,
    out: Path,
    names: Mapping[str, str] | None = None,
    mounts: Mapping[str, Mount] | None = None,
    odometry_topic: str | None = None,
) -> Imported:
    """Convert a bag. ROS stamps are kept.

    Args:
        bag: A `.bag` file, or the folder of a ROS 2 bag.
        out: Recording to write.
        names: Sensor name by topic, where it should not be the topic's own.
        mounts: By sensor name, where the bag has no transform for it.
        odometry_topic: Which of several to take; None for the one with most messages, else the transform from odom.

    Raises:
        RecordingError: No bag, no odometry, or nothing that a mapper or an avoider could use; or there is such a file.
        WriteError: The disk is full; nothing is left.
    """
    with opened(bag) as reader:
        work = _Work(reader, dict(names or {}), dict(mounts or {}), odometry_topic)
        header = header_of(work.loaded(bag), "imported", {})
        header = replace(header, clock="wall", origin=bag.name)
        writer = RecordingWriter(out, header, {})
        try:
            with writer:
                return work.write(writer)
        except BaseException as error:
            writer.discard()
            if isinstance(error, WriteError):
                raise WriteError(f"{out}: {error.why}; nothing of the import is kept", error.why) from None
            raise


class _Work:
    """One bag on its way to a recording."""

    def __init__(
        self, reader: Any, names: dict[str, str], mounts: dict[str, Mount], odometry_topic: str | None
    ) -> None:
        self.reader, self.mounts = reader, mounts
        self.frames = FrameTree()
        self.topics = {
            name: Topic(name, info.msgtype or "several types") for name, info in sorted(reader.topics.items())
        }
        unknown = [name for name in (*names, *filter(None, [odometry_topic])) if name not in self.topics]
        if unknown:
            raise RecordingError(f"the bag has no topic {unknown[0]!r}; it has {', '.join(self.topics) or 'none'}")
        self._choose_odometry(odometry_topic)
        for topic in self.topics.values():
            if topic.type in _CONVERT:
                topic.sensor = names.get(topic.name) or _name_of(topic.name)
        self._refuse_doubles()
        self._read_frames()
        self._sort_out()

    def loaded(self, bag: Path) -> Loaded:
        """A config with the sensors that were found, and every plugin by default."""
        name = re.sub(r"[^A-Za-z0-9_-]", "_", bag.stem) or "log"
        sensors = [
            {"name": topic.sensor, "kind": _CONVERT[topic.type][1]}
            for topic in self.topics.values()
            if topic.sensor and topic.type in _CONVERT
        ]
        config = Config.model_validate(
            {
                "run": {"period": PERIOD},
                "robot": {"realm": REALM, "name": name},
                "platform": {"plugin": INSTANCE},
                "mapper": {"plugin": "scan_grid"} if any(one["kind"] == RANGE_SCAN for one in sensors) else {},
                "sensor": sensors,
            }
        )
        return Loaded(config, bag.name, Path("."), {}, ())

    def _choose_odometry(self, wanted: str | None) -> None:
        counts = {name: info.msgcount for name, info in self.reader.topics.items() if info.msgtype == _ODOMETRY}
        if wanted is not None and wanted not in counts:
            raise RecordingError(f"topic {wanted!r} is no {_ODOMETRY}; there are {', '.join(counts) or 'none'}")
        filled = {name: count for name, count in counts.items() if count}
        if wanted is not None and wanted not in filled:
            raise RecordingError(f"topic {wanted!r} has no message; odometry is in {', '.join(filled) or 'no topic'}")
        self.odometry = wanted or max(filled, key=lambda name: (filled[name], name), default=None)

    def _refuse_doubles(self) -> None:
        taken: dict[str, str] = {}
        for topic in self.topics.values():
            if not topic.sensor:
                continue
            if topic.sensor in _OWN or not re.fullmatch(r"[a-z][A-Za-z0-9_]*", topic.sensor):
                raise RecordingError(f"{topic.name}: {topic.sensor!r} cannot name a sensor; use --map-topic TOPIC=name")
            if topic.sensor in taken:
                raise RecordingError(
                    f"{taken[topic.sensor]} and {topic.name} are both called {topic.sensor!r}; "
                    f"tell them apart with --map-topic {topic.name}=name"
                )
            taken[topic.sensor] = topic.name
        unknown = next((name for name in self.mounts if name not in taken), None)
        if unknown is not None:
            raise RecordingError(f"--mount {unknown}: the bag has no such sensor; it has {', '.join(taken) or 'none'}")

    def _read_frames(self) -> None:
        """Transforms, and the frame of each sensor and of the odometry, from the first message that has one."""
        self.frame_of: dict[str, str] = {}
        self.child = ""
        wanted = [c for c in self.reader.connections if c.msgtype in {_ODOMETRY, *_TRANSFORMS, *_CONVERT}]
        for connection, _, raw in messages(self.reader, wanted):
            if connection.msgtype in _TRANSFORMS:
                message = deserialized(self.reader, raw, connection)
                self.frames.add(message, connection.topic.endswith("tf_static"))
            elif connection.topic not in self.frame_of:
                message = deserialized(self.reader, raw, connection)
                self.frame_of[connection.topic] = message.header.frame_id
                if connection.topic == self.odometry:
                    self.child = message.child_frame_id

    def _sort_out(self) -> None:
        """Give each sensor its mount, and say of each topic that is left out why."""
        self.base = self.frames.base(self.child)
        self.mount_of: dict[str, Mount] = {}
        for topic in self.topics.values():
            count = self.reader.topics[topic.name].msgcount
            if topic.type in _CONVERT and topic.name in self.frame_of:
                frame = self.frame_of[topic.name].lstrip("/")
                mount = self.mounts.get(topic.sensor) or self._mount(frame)
                if mount is not None:
                    self.mount_of[topic.name] = mount
                    continue
                named = frame or "its unnamed frame"
                why = f"no transform from {named} to {self.base}: give --mount {topic.sensor}=X,Y,YAW_DEG"
                topic.skipped[why] = count
                topic.sensor = ""
            elif topic.type == _ODOMETRY and topic.name == self.odometry:
                topic.sensor = "odometry"
            elif topic.type in _TRANSFORMS:
                topic.sensor = "mounts"
            elif topic.type == _ODOMETRY and count:
                topic.skipped[f"{self.odometry} is taken; choose with --odom {topic.name}"] = count
            else:
                is_read = topic.type in _CONVERT or not count
                topic.skipped["empty" if is_read else "not a type that is read"] = count
                topic.sensor = ""
        if self.odometry is None and not any(self.frames.parent(name) == ODOM for name in (self.base, *BASES)):
            raise RecordingError(
                f"no odometry: neither a topic of {_ODOMETRY} nor a transform from odom to {self.base}"
            )
        if not self.mount_of:
            ranges = [topic for topic in self.topics.values() if topic.type in _CONVERT]
            reasons = "; ".join(f"{topic.name} ({topic.type}): {next(iter(topic.skipped))}" for topic in ranges)
            there = ", ".join(f"{topic.name} ({topic.type})" for topic in self.topics.values()) or "no topic at all"
            lacking = f"expected one of {', '.join(_CONVERT)}; the bag has {there}"
            raise RecordingError(f"no topic with ranges can be used: {reasons or lacking}")

    def _mount(self, frame: str) -> Mount | None:
        if frame == self.base:
            return Mount(np.eye(3), np.zeros(3))
        return self.frames.mount(frame, self.base)

    def write(self, writer: RecordingWriter) -> Imported:
        """Convert every message in the order of the bag."""
        self.writer, self.result = writer, Imported(list(self.topics.values()))
        self.sequences: Counter[str] = Counter()
        self.first: int | None = None
        self._before: tuple[int, Pose2D] | None = None
        wanted = [c for c in self.reader.connections if c.topic in self.mount_of or c.topic == self.odometry]
        if self.odometry is None:
            wanted += [c for c in self.reader.connections if c.msgtype in _TRANSFORMS]
        for connection, received_ns, raw in messages(self.reader, wanted):
            topic = self.topics[connection.topic]
            try:
                self._convert(topic, deserialized(self.reader, raw, connection), received_ns)
            except (ConversionError, MessageError) as error:
                topic.skipped[str(error)] += 1
        writer.close({"messages": writer.messages})
        return self.result

    def _convert(self, topic: Topic, message: Any, received_ns: int) -> None:
        if topic.type in _TRANSFORMS:
            for one in message.transforms:
                if one.header.frame_id.lstrip("/") == ODOM and one.child_frame_id.lstrip("/") in (self.base, *BASES):
                    self._put("odometry", self._from_transform(one), stamp_of(one.header), received_ns)
                    topic.messages += 1
            return
        if topic.type == _ODOMETRY:
            self._put("odometry", odometry(message), stamp_of(message.header), received_ns)
        else:
            convert, _ = _CONVERT[topic.type]
            self._put(topic.sensor, convert(message, self.mount_of[topic.name]), stamp_of(message.header), received_ns)
        topic.messages += 1

    def _from_transform(self, one: Any) -> Odometry:
        """Odometry from a pose alone: the velocity is that since the pose before."""
        turn, at, stamp_ns = one.transform.rotation, one.transform.translation, stamp_of(one.header)
        pose = Pose2D(float(at.x), float(at.y), yaw_of(quaternion_matrix(turn.x, turn.y, turn.z, turn.w)))
        twist = Twist2D(0.0, 0.0, 0.0)
        if self._before is not None and stamp_ns > self._before[0]:
            before, span = self._before[1], (stamp_ns - self._before[0]) * 1e-9
            dx, dy = pose.x - before.x, pose.y - before.y
            cos, sin = np.cos(before.heading), np.sin(before.heading)
            turned = (pose.heading - before.heading + np.pi) % (2.0 * np.pi) - np.pi
            twist = Twist2D(float(cos * dx + sin * dy) / span, float(cos * dy - sin * dx) / span, float(turned) / span)
        self._before = (stamp_ns, pose)
        return Odometry(stamp_ns, pose, twist)

    def _put(self, port: str, message: Message, stamp_ns: int, received_ns: int) -> None:
        if stamp_ns < 0:
            raise ConversionError("its stamp is before 1970")
        self.first = stamp_ns if self.first is None else self.first
        self.result.first_ns = min(self.result.first_ns or stamp_ns, stamp_ns)
        self.result.last_ns = max(self.result.last_ns, stamp_ns)
        self.sequences[port] += 1
        key = f"{self.writer.header.prefix}/platform/{INSTANCE}/{port}"
        tick = max(0, round((stamp_ns - self.first) * 1e-9 / PERIOD))
        at = Envelope(key, self.sequences[port], tick, stamp_ns, stamp_ns, 0)
        self.writer.add(key, schema_label(type(message)), encode(message, at), received_ns, stamp_ns, at.sequence)


def _name_of(topic: str) -> str:
    """A sensor's name from its topic's."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", topic.strip("/"))
    name = name[:1].lower() + name[1:]
    return name if re.match(r"[a-z]", name) else f"sensor_{name}"
