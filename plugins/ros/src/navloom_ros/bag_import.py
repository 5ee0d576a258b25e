"""Converts a ROS 1 or ROS 2 bag to a recording: the streams that a platform publishes, and nothing else.

`navloom ros import` calls it. The bag is read twice: first for transforms, frames and stamps, then for its messages.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
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
    scans_alone,
    too_coarse,
    writing,
)

from navloom_ros.bag_clock import REMEDY, Clock
from navloom_ros.bag_conversion import laser_scan, odometry, point_cloud, range_reading
from navloom_ros.bag_files import BagFiles
from navloom_ros.bag_outcome import Imported, Topic, reasons_of
from navloom_ros.bag_streams import BagStreams, Stream, last_part
from navloom_ros.bags import deserialized, messages, opened
from navloom_ros.base.readings import check_child
from navloom_ros.errors import Unusable
from navloom_ros.frames import BASES, Mount, heading_of
from navloom_ros.times import ns_of

__all__ = ["Choice", "import_bag"]

_CONVERT = {
    "sensor_msgs/msg/LaserScan": (laser_scan, RANGE_SCAN),
    "sensor_msgs/msg/Range": (range_reading, RANGE_SCAN),
    "sensor_msgs/msg/PointCloud2": (point_cloud, SWEEP),
}
_ODOMETRY = "nav_msgs/msg/Odometry"
_TRANSFORMS = frozenset({"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"})
_COMMANDS = frozenset({"geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"})
_COMMAND = "a command: replays compare with the velocities that were driven, those of the odometry"
NO_ODOMETRY = "none"
"""In place of a topic: each scan gets odometry that stands still."""
_FIX = "take another topic with --odom TOPIC, or name the robot's frame with --base-frame FRAME"


class NoOdometry(RecordingError):
    """The bag has no odometry of the robot."""


@dataclass(frozen=True)
class Choice:
    """What to take of a bag that can be read in several ways.

    Attributes:
        namespace: Robot whose topics to take, as /r1; empty for all.
        base_frame: The robot's frame; empty for the usual one.
        by_receipt: Take the times of receipt as stamps.
        run: Which run of a log whose clock jumps, from 1; None for the one with the most odometry.
    """

    namespace: str = ""
    base_frame: str = ""
    by_receipt: bool = False
    run: int | None = None


def import_bag(
    bag: Path,
    out: Path,
    names: Mapping[str, str] | None = None,
    mounts: Mapping[str, Mount] | None = None,
    odometry_topic: str | None = None,
    map_ref: str | None = None,
    start: tuple[float, float, float] | None = None,
    choice: Choice | None = None,
) -> Imported:
    """Convert a bag.

    Args:
        bag: A `.bag` file, the folder of a ROS 2 bag, or a data file of one.
        out: Recording to write.
        names: Sensor names by topic, to replace those made from the topic's name.
        mounts: Mounts by sensor name; they replace the bag's transforms.
        odometry_topic: Topic to use, or NO_ODOMETRY; None for the one with the most messages that fits, or else the
            transform from odom.
        map_ref: Map for replays, a world's reference or a map's .yaml; None for none.
        start: x, y, m, heading, rad, of the robot in the map when the bag begins; None if its odometry is in the map.
        choice: What to take if there are several ways; None for the usual ones.

    Raises:
        RecordingError: No bag, no odometry, no ranges that can be used, or `out` exists.
        WriteError: The disk is full; no partial file remains.
    """
    with opened(bag, frozenset({_ODOMETRY, *_TRANSFORMS, *_CONVERT})) as (reader, files):
        try:
            work = _Work(reader, files, dict(names or {}), dict(mounts or {}), odometry_topic, choice or Choice())
        except NoOdometry as error:
            raise RecordingError(
                f"{error}; or import the scans alone, with --odom none, and {scans_alone(out)}"
            ) from None
        loaded = imported_config(bag.name, work.sensors())
        if map_ref is not None or start is not None:
            loaded = placed_in_map(loaded, map_ref, start, work.first_pose())
        with writing(out, loaded, bag.name) as written:
            return work.write(written)


class _Work:
    """The import of one bag. The constructor selects the topics and mounts; `write` converts the messages."""

    def __init__(
        self,
        reader: Any,
        files: BagFiles,
        names: dict[str, str],
        mounts: dict[str, Mount],
        odometry_topic: str | None,
        choice: Choice,
    ) -> None:
        self.reader, self.mounts, self.choice = reader, mounts, choice
        self.notes = files.notes
        self.stands = odometry_topic == NO_ODOMETRY
        odometry_topic = None if self.stands else odometry_topic
        self.topics = {
            name: Topic(name, info.msgtype or "several types") for name, info in sorted(reader.topics.items())
        }
        self.counts = {name: info.msgcount for name, info in reader.topics.items()}
        for name, (kind, count) in files.left_out.items():
            self.topics.setdefault(name, Topic(name, kind))
            self.counts.setdefault(name, count)
        unknown = [name for name in (*names, *filter(None, [odometry_topic])) if name not in self.topics]
        if unknown:
            raise RecordingError(f"the bag has no topic {unknown[0]!r}; it has {', '.join(self.topics) or 'none'}")
        self._before: tuple[int, Pose2D] | None = None
        for topic in self._of(_CONVERT):
            topic.sensor = names.get(topic.name) or _name_of(topic.name)
        self._refuse_doubles()
        wanted = [c for c in reader.connections if c.msgtype in {_ODOMETRY, *_TRANSFORMS, *_CONVERT}]
        wanted = [connection for connection in wanted if self._is_asked(connection.topic)]
        self.streams = BagStreams(reader, wanted, _ODOMETRY, _TRANSFORMS)
        self.frames = self.streams.frames
        self._count()
        self._choose_odometry(odometry_topic)
        self._sort_out()

    def sensors(self) -> dict[str, str]:
        """Kind of each sensor by its name."""
        return {topic.sensor: _CONVERT[topic.type][1] for topic in self._of(_CONVERT) if topic.sensor}

    def first_pose(self) -> Pose2D:
        """The first pose of the odometry. Raises RecordingError if it has no message."""
        if self.stands:
            return Pose2D(0.0, 0.0, 0.0)
        for topic, _, message, _ in self._taken(with_scans=False):
            # The first message is converted twice: here, and again when the bag is written.
            self._before = None
            topic.skipped.clear()
            pose: Pose2D = message.pose
            return pose
        raise RecordingError(f"no odometry: {self.odometry or 'the transform from odom'} has no message")

    def _count(self) -> None:
        """Count the messages that are there, and note where the bag's own count differs."""
        for topic in self._of({_ODOMETRY, *_CONVERT}):
            there = len(self.streams.of[topic.name].stamps) if topic.name in self.streams.of else 0
            counted = self.counts[topic.name]
            if there != counted:
                self.notes.append(f"{topic.name}: the bag counts {counted} messages, and has {there}")
                self.counts[topic.name] = there

    def _of(self, types: Any) -> list[Topic]:
        return [topic for topic in self.topics.values() if topic.type in types and self._is_asked(topic.name)]

    def _is_asked(self, topic: str) -> bool:
        """Whether a topic is of the robot; transforms of all robots are often in the same two topics."""
        start = "/" + self.choice.namespace.strip("/")
        return start == "/" or topic.startswith(f"{start}/") or topic in ("/tf", "/tf_static")

    def _choose_odometry(self, wanted: str | None) -> None:
        of = self.streams.of
        counts = {topic.name: self.counts[topic.name] for topic in self._of({_ODOMETRY})}
        if wanted is not None and wanted not in counts:
            raise RecordingError(f"topic {wanted!r} is not a {_ODOMETRY}; there are {', '.join(counts) or 'none'}")
        # By name among equals, so that the choice does not depend on the order in the bag.
        filled = sorted((name for name in counts if name in of), key=lambda name: (-counts[name], name))
        if wanted is not None and wanted not in filled:
            raise RecordingError(f"topic {wanted!r} has no message; odometry is in {', '.join(filled) or 'no topic'}")
        likely = [wanted] if wanted is not None else filled
        self.base = self.choice.base_frame or self.frames.base(of[likely[0]].child if likely else "")
        reasons = {name: self._misfit(of[name].child) for name in likely}
        self.odometry = next((name for name in likely if not reasons[name]), None)
        self.pair = ("", "")
        if self.stands:
            self.odometry = ""
        if self.odometry is not None:
            return
        pairs = [pair for pair in self.streams.moved if pair[1] == self.base or last_part(pair[1]) in BASES]
        if wanted is not None or not pairs:
            reason = "; ".join(f"{name}: {why}" for name, why in reasons.items())
            lacking = f"neither a topic of {_ODOMETRY} nor a transform from odom to {self.base}"
            raise NoOdometry(f"no odometry: {reason or lacking}")
        self.pair = max(pairs, key=lambda pair: (pair[1] == self.base, len(self.streams.moved[pair].stamps), pair))

    def _misfit(self, child: str) -> str:
        """Why the odometry of a frame is not the robot's; empty if it is."""
        try:
            check_child(child, self.base, self.frames, _FIX)
        except Unusable as error:
            return str(error)
        return ""

    def _refuse_doubles(self) -> None:
        taken: dict[str, str] = {}
        for topic in self._of(_CONVERT):
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

    def _sort_out(self) -> None:
        """Judge the mount and the stamps of each sensor, and note why a topic is skipped.

        Raises:
            RecordingError: No sensor that can be used, or odometry without a clock.
        """
        self._set_clock()
        for topic in self.topics.values():
            count, stream = self.counts[topic.name], self.streams.of.get(topic.name)
            if not self._is_asked(topic.name):
                topic.skip(f"not in {self.choice.namespace}", count)
            elif not count:
                topic.skip("empty", 0)
            elif topic.type in _CONVERT and stream is not None:
                why = self._unmounted(topic, stream.frame) or self.clock.misfit(stream)
                if why:
                    topic.skip(why, count)
            elif topic.type in _TRANSFORMS:
                topic.sensor, topic.messages = "mounts", count
            elif topic.name == self.odometry:
                topic.sensor = "odometry"
            elif topic.type == _ODOMETRY:
                topic.skip(f"{self.odometry or 'none'} is taken; choose with --odom {topic.name}", count)
            else:
                topic.skip(_COMMAND if topic.type in _COMMANDS else "not a type that is read", count)
        if not self.sensors():
            reasons = reasons_of(self._of(_CONVERT))
            there = ", ".join(f"{topic.name} ({topic.type})" for topic in self.topics.values()) or "no topic at all"
            lacking = f"expected one of {', '.join(_CONVERT)}; the bag has {there}"
            raise RecordingError(f"no topic with ranges can be used: {reasons or lacking}")

    def _set_clock(self) -> None:
        """Judge the stamps of the odometry. Raises RecordingError with those of all streams if they are of no clock."""
        by_transform = self.odometry is None
        name = self.odometry or f"the transform from {self.pair[0]} to {self.pair[1]}"
        if self.stands:
            there = [topic.name for topic in self._of(_CONVERT) if topic.name in self.streams.of]
            name = max(there, key=lambda name: self.counts[name], default="")
            self.streams.of.setdefault(name, Stream())
        moves = self.streams.moved[self.pair] if by_transform else self.streams.of[name]
        self.clock = Clock(name, moves, by_transform, self.choice.by_receipt, self.choice.run)
        if self.clock.fault:
            streams = {
                topic.name: self.streams.of[topic.name] for topic in self._of(_CONVERT) if topic.name in self.streams.of
            }
            others = "".join(
                f"; {name}: {too_coarse(one.times(False)[0]) or 'its stamps differ'}" for name, one in streams.items()
            )
            raise RecordingError(f"no odometry with a clock: {name}: {self.clock.fault}{others}: {REMEDY}")

    def _unmounted(self, topic: Topic, frame: str) -> str:
        """Why a sensor has no fixed mount; empty if it has."""
        try:
            self._mount(topic, frame)
        except Unusable as error:
            return str(error)
        return ""

    def _mount(self, topic: Topic, frame: str) -> Mount:
        """Mount of the sensor whose message has a frame; topics may carry several sensors. Raises Unusable."""
        if topic.sensor in self.mounts:
            return self.mounts[topic.sensor]
        found = self.frames.mount(frame, self.base)
        give = f"give --mount {topic.sensor}=X,Y,YAW_DEG"
        if found is None:
            named = frame.lstrip("/") or "its unnamed frame"
            raise Unusable(f"no transform from {named} to {self.base}: {give}")
        doubt = self.frames.doubt(frame, self.base)
        if doubt:
            raise Unusable(f"{doubt}, or {give}")
        return found

    def write(self, log: ImportedLog) -> Imported:
        """Convert all messages in the order of the bag."""
        still, last_ns = Pose2D(0.0, 0.0, 0.0), -1
        for topic, port, message, received_ns in self._taken(with_scans=True):
            if self.stands and message.stamp_ns > last_ns:
                last_ns = message.stamp_ns
                log.put("odometry", Odometry(last_ns, still, Twist2D(0.0, 0.0, 0.0)), last_ns, received_ns)
            log.put(port, message, message.stamp_ns, received_ns)
            if topic.sensor == "mounts":
                topic.sensor, topic.messages = "odometry", 0
            topic.messages += 1
        self._refuse_nothing()
        notes = [*self.notes, *self.clock.notes(), *filter(None, [log.odometry_note])]
        return Imported(list(self.topics.values()), log.first_ns, log.last_ns, notes)

    def _refuse_nothing(self) -> None:
        """Refuse an import without odometry or without a scan, and list topics of which nothing could be used."""
        for topic in self.topics.values():
            if topic.sensor and not topic.messages:
                topic.sensor = ""
        if not self.stands and not any(topic.sensor == "odometry" for topic in self.topics.values()):
            raise RecordingError(f"no odometry can be used: {reasons_of(self._of({_ODOMETRY, *_TRANSFORMS}))}")
        if not self.sensors():
            raise RecordingError(f"no topic with ranges can be used: {reasons_of(self._of(_CONVERT))}")

    def _taken(self, with_scans: bool) -> Iterator[tuple[Topic, str, Any, int]]:
        """Topic, port, converted message and time of receipt, ns, of all that is of the chosen run."""
        taken = {topic.name for topic in self._of(_CONVERT) if topic.sensor} if with_scans else set()
        if self.odometry is not None:
            taken |= {self.odometry} & self.topics.keys()
        else:
            taken |= {topic.name for topic in self._of(_TRANSFORMS)}
        of = {name: self.streams.of[name] for name in taken if name in self.streams.of}
        runs = {name: iter(self.clock.runs(stream).tolist()) for name, stream in of.items()}
        moves = iter(self.clock.runs(self.streams.moved[self.pair]).tolist() if self.odometry is None else ())
        wanted = [connection for connection in self.reader.connections if connection.topic in taken]
        for connection, received_ns, raw in messages(self.reader, wanted):
            topic = self.topics[connection.topic]
            found = deserialized(self.reader, raw, connection)
            parts = [found] if topic.name in runs else [one for one in found.transforms if _pair(one) == self.pair]
            for part in parts:
                run = next(runs.get(topic.name, moves))
                if run != self.clock.run:
                    topic.skipped["of another run" if run else "a stray stamp"] += 1
                    continue
                try:
                    yield topic, *self._converted(topic, part, received_ns), received_ns
                except (Unusable, MessageError) as error:
                    topic.skipped[str(error)] += 1

    def _converted(self, topic: Topic, message: Any, received_ns: int) -> tuple[str, Any]:
        """Port and navloom message of a ROS message, or of a transform."""
        stamp_ns = received_ns if self.clock.by_receipt else ns_of(message.header.stamp)
        if stamp_ns < 0:
            raise Unusable("its stamp is before 1970")
        if topic.type in _TRANSFORMS:
            return "odometry", self._from_transform(message, stamp_ns)
        if topic.type == _ODOMETRY:
            return "odometry", replace(odometry(message), stamp_ns=stamp_ns)
        convert, _ = _CONVERT[topic.type]
        found: Any = convert(message, self._mount(topic, message.header.frame_id))
        return topic.sensor, replace(found, stamp_ns=stamp_ns)

    def _from_transform(self, one: Any, stamp_ns: int) -> Odometry:
        """Odometry from a transform; the velocity is that since the previous one."""
        at, heading = one.transform.translation, heading_of(one.transform.rotation)
        if heading is None:
            raise Unusable("a transform whose rotation is not a unit quaternion")
        pose = Pose2D(float(at.x), float(at.y), heading)
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


def _pair(transform: Any) -> tuple[str, str]:
    return transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/")


def _name_of(topic: str) -> str:
    """Sensor name from a topic's name."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", topic.strip("/"))
    name = name[:1].lower() + name[1:]
    return name if re.match(r"[a-z]", name) else f"sensor_{name}"
