"""Converts a ROS 1 or ROS 2 bag to a recording: the streams that a platform publishes, and nothing else.

`navloom ros import` calls it. The bag is read twice: first for transforms and frames, then for its messages.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from navloom import MessageError, Odometry, Pose2D, Twist2D
from navloom_recording import (
    OWN_PORTS,
    RANGE_SCAN,
    SWEEP,
    ImportedLog,
    RecordingError,
    imported_config,
    placed_in_map,
    writing,
)

from navloom_ros.bag_conversion import (
    ConversionError,
    laser_scan,
    odometry,
    point_cloud,
    range_reading,
    yaw_of,
)
from navloom_ros.bags import check_definitions, deserialized, messages, opened
from navloom_ros.frames import BASES, FrameTree, Mount, quaternion_matrix
from navloom_ros.times import ns_of

__all__ = ["Imported", "Topic", "import_bag"]

_CONVERT = {
    "sensor_msgs/msg/LaserScan": (laser_scan, RANGE_SCAN),
    "sensor_msgs/msg/Range": (range_reading, RANGE_SCAN),
    "sensor_msgs/msg/PointCloud2": (point_cloud, SWEEP),
}
_ODOMETRY = "nav_msgs/msg/Odometry"
_TRANSFORMS = frozenset({"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"})
ODOM = "odom"
"""Odometry frame; its transform to the robot is used as odometry if no topic has any."""


@dataclass
class Topic:
    """A topic of the bag and the outcome of its import.

    Attributes:
        name, type: The ROS name and type.
        sensor: Port in the recording; empty if the topic was skipped.
        messages: Number of converted messages.
        skipped: Number of skipped messages by reason; if the whole topic was skipped, all its messages.
    """

    name: str
    type: str
    sensor: str = ""
    messages: int = 0
    skipped: Counter[str] = field(default_factory=Counter)

    def to_json(self) -> dict[str, Any]:
        """An entry of `navloom ros import --json`."""
        return {**vars(self), "skipped": dict(self.skipped)}


@dataclass
class Imported:
    """Outcome of an import: the topics in order of name, and the first and the last stamp, ns."""

    topics: list[Topic]
    first_ns: int = 0
    last_ns: int = 0


def import_bag(
    bag: Path,
    out: Path,
    names: Mapping[str, str] | None = None,
    mounts: Mapping[str, Mount] | None = None,
    odometry_topic: str | None = None,
    map_ref: str | None = None,
    start: tuple[float, float, float] | None = None,
) -> Imported:
    """Convert a bag. ROS stamps are kept.

    Args:
        bag: A `.bag` file, or the folder of a ROS 2 bag.
        out: Recording to write.
        names: Sensor names by topic, to replace those made from the topic's name.
        mounts: Mounts by sensor name; they replace the bag's transforms.
        odometry_topic: Topic to use; None for the one with the most messages, or else the transform from odom.
        map_ref: Map for replays, a world's reference or a map's .yaml; None for none.
        start: x, y, m, heading, rad, of the robot in the map when the bag begins; None if its odometry is in the map.

    Raises:
        RecordingError: No bag, no odometry, no ranges that can be used, or `out` exists.
        WriteError: The disk is full; no partial file remains.
    """
    with opened(bag) as reader:
        work = _Work(reader, dict(names or {}), dict(mounts or {}), odometry_topic)
        loaded = imported_config(bag.name, work.sensors())
        if map_ref is not None or start is not None:
            loaded = placed_in_map(loaded, map_ref, start, work.first_pose())
        with writing(out, loaded, bag.name) as written:
            return work.write(written)


class _Work:
    """The import of one bag. The constructor selects the topics and mounts; `write` converts the messages."""

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
        self._before: tuple[int, Pose2D] | None = None
        self._choose_odometry(odometry_topic)
        for topic in self.topics.values():
            if topic.type in _CONVERT:
                topic.sensor = names.get(topic.name) or _name_of(topic.name)
        self._refuse_doubles()
        self._read_frames()
        self._sort_out()

    def sensors(self) -> dict[str, str]:
        """Kind of each sensor by its name."""
        taken = [topic for topic in self.topics.values() if topic.sensor and topic.type in _CONVERT]
        return {topic.sensor: _CONVERT[topic.type][1] for topic in taken}

    def first_pose(self) -> Pose2D:
        """The first pose of the odometry. Raises RecordingError if it has no message."""
        is_topic = self.odometry is not None
        wanted = [
            c for c in self.reader.connections if (c.topic == self.odometry if is_topic else c.msgtype in _TRANSFORMS)
        ]
        for connection, _, raw in messages(self.reader, wanted):
            for _, found in self._converted(self.topics[connection.topic], deserialized(self.reader, raw, connection)):
                # The first message is converted twice: here, and again when the bag is written.
                self._before = None
                pose: Pose2D = found.pose
                return pose
        raise RecordingError(f"no odometry: {self.odometry or 'the transform from odom'} has no message")

    def _choose_odometry(self, wanted: str | None) -> None:
        counts = {name: info.msgcount for name, info in self.reader.topics.items() if info.msgtype == _ODOMETRY}
        if wanted is not None and wanted not in counts:
            raise RecordingError(f"topic {wanted!r} is not a {_ODOMETRY}; there are {', '.join(counts) or 'none'}")
        filled = {name: count for name, count in counts.items() if count}
        if wanted is not None and wanted not in filled:
            raise RecordingError(f"topic {wanted!r} has no message; odometry is in {', '.join(filled) or 'no topic'}")
        # By name among equals, so that the choice does not depend on the order in the bag.
        self.odometry = wanted or max(filled, key=lambda name: (filled[name], name), default=None)

    def _refuse_doubles(self) -> None:
        taken: dict[str, str] = {}
        for topic in self.topics.values():
            if not topic.sensor:
                continue
            if topic.sensor in OWN_PORTS or not re.fullmatch(r"[a-z][A-Za-z0-9_]*", topic.sensor):
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
        """Read all transforms, and the frame of each sensor and of the odometry from its first message."""
        self.frame_of: dict[str, str] = {}
        self.child = ""
        wanted = [c for c in self.reader.connections if c.msgtype in {_ODOMETRY, *_TRANSFORMS, *_CONVERT}]
        check_definitions(self.reader, {c.msgtype for c in wanted})
        for connection, _, raw in messages(self.reader, wanted):
            if connection.msgtype in _TRANSFORMS:
                message = deserialized(self.reader, raw, connection)
                self.frames.add(message, connection.topic.endswith("tf_static"))
            # Frames of sensors do not change, and decoding all scans twice would take as long as the import.
            elif connection.topic not in self.frame_of:
                message = deserialized(self.reader, raw, connection)
                self.frame_of[connection.topic] = message.header.frame_id
                if connection.topic == self.odometry:
                    self.child = message.child_frame_id

    def _sort_out(self) -> None:
        """Find the mount of each sensor, and note why a topic is skipped.

        Raises:
            RecordingError: No odometry, or no sensor that can be used.
        """
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

    def write(self, log: ImportedLog) -> Imported:
        """Convert all messages in the order of the bag."""
        wanted = [c for c in self.reader.connections if c.topic in self.mount_of or c.topic == self.odometry]
        if self.odometry is None:
            wanted += [c for c in self.reader.connections if c.msgtype in _TRANSFORMS]
        for connection, received_ns, raw in messages(self.reader, wanted):
            topic = self.topics[connection.topic]
            try:
                for port, message in self._converted(topic, deserialized(self.reader, raw, connection)):
                    if message.stamp_ns < 0:
                        raise ConversionError("its stamp is before 1970")
                    log.put(port, message, message.stamp_ns, received_ns)
                    topic.messages += 1
            except (ConversionError, MessageError) as error:
                topic.skipped[str(error)] += 1
        return Imported(list(self.topics.values()), log.first_ns, log.last_ns)

    def _converted(self, topic: Topic, message: Any) -> Iterator[tuple[str, Any]]:
        """Ports and navloom messages that one ROS message converts to."""
        if topic.type in _TRANSFORMS:
            for transform in message.transforms:
                if transform.header.frame_id.lstrip("/") == ODOM and transform.child_frame_id.lstrip("/") in (
                    self.base,
                    *BASES,
                ):
                    yield "odometry", self._from_transform(transform)
        elif topic.type == _ODOMETRY:
            yield "odometry", odometry(message)
        else:
            convert, _ = _CONVERT[topic.type]
            yield topic.sensor, convert(message, self.mount_of[topic.name])

    def _from_transform(self, one: Any) -> Odometry:
        """Odometry from a transform; the velocity is that since the previous one."""
        turn, at, stamp_ns = one.transform.rotation, one.transform.translation, ns_of(one.header.stamp)
        pose = Pose2D(float(at.x), float(at.y), yaw_of(quaternion_matrix(turn.x, turn.y, turn.z, turn.w)))
        twist = Twist2D(0.0, 0.0, 0.0)
        # Transforms are often repeated with the same stamp.
        if self._before is not None and stamp_ns > self._before[0]:
            before, span = self._before[1], (stamp_ns - self._before[0]) * 1e-9
            dx, dy = pose.x - before.x, pose.y - before.y
            cos, sin = np.cos(before.heading), np.sin(before.heading)
            turned = (pose.heading - before.heading + np.pi) % (2.0 * np.pi) - np.pi
            twist = Twist2D(float(cos * dx + sin * dy) / span, float(cos * dy - sin * dx) / span, float(turned) / span)
        self._before = (stamp_ns, pose)
        return Odometry(stamp_ns, pose, twist)


def _name_of(topic: str) -> str:
    """Sensor name from a topic's name."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", topic.strip("/"))
    name = name[:1].lower() + name[1:]
    return name if re.match(r"[a-z]", name) else f"sensor_{name}"
