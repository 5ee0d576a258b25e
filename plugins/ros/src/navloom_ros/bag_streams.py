"""Reads a bag once, for `bag_import`: all transforms, and the frames, stamps and times of receipt of its streams."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom_ros.bags import check_definitions, deserialized, messages
from navloom_ros.frames import BASES, FrameTree
from navloom_ros.times import SECOND, ns_of

__all__ = ["BagStreams", "Stream", "last_part"]

ODOM = "odom"
"""Odometry frame, perhaps with a prefix; its transform to the robot is used as odometry if no topic has any."""


@dataclass(eq=False)
class Stream:
    """The messages of one topic, or the transforms of one frame, without their contents.

    Attributes:
        frame, child: Frame of the first message's header, and the child frame if it is odometry.
        stamps, received: Stamp and time of receipt of each message, ns, in the order of the bag.
    """

    frame: str = ""
    child: str = ""
    stamps: Any = field(default_factory=lambda: array("q"))
    received: Any = field(default_factory=lambda: array("q"))

    def times(self, by_receipt: bool) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(n,) Stamps and (n,) times of receipt, ns; `by_receipt` takes the latter as stamps."""
        received = np.array(self.received, dtype=np.int64)
        return (received if by_receipt else np.array(self.stamps, dtype=np.int64)), received


class BagStreams:
    """Reads a bag once.

    Args:
        reader: The bag.
        connections: Those to read.
        odometry: Message type of odometry.
        transforms: Message types of transforms.

    Attributes:
        frames: The transforms.
        of: The streams of messages by topic; topics without a message are missing.
        moved: The streams of transforms from an odometry frame to a robot's, by (parent, child).
    """

    def __init__(self, reader: Any, connections: Iterable[Any], odometry: str, transforms: frozenset[str]) -> None:
        self.frames = FrameTree()
        self.of: dict[str, Stream] = {}
        self.moved: dict[tuple[str, str], Stream] = {}
        wanted = list(connections)
        check_definitions(reader, {connection.msgtype for connection in wanted})
        stamp_of = _Stamps(reader)
        for connection, received_ns, raw in messages(reader, wanted):
            if connection.msgtype in transforms:
                message = deserialized(reader, raw, connection)
                self.frames.add(message, connection.topic.endswith("tf_static"), connection.topic)
                self._add_moves(message, received_ns)
                continue
            stream = self.of.get(connection.topic)
            if stream is None:
                message = deserialized(reader, raw, connection)
                child = message.child_frame_id if connection.msgtype == odometry else ""
                stream = self.of[connection.topic] = Stream(message.header.frame_id, child)
            stream.stamps.append(stamp_of(raw, connection))
            stream.received.append(received_ns)

    def _add_moves(self, message: Any, received_ns: int) -> None:
        for transform in message.transforms:
            pair = transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/")
            if last_part(pair[0]) == ODOM and (last_part(pair[1]) in BASES or pair in self.moved):
                stream = self.moved.setdefault(pair, Stream(*pair))
                stream.stamps.append(ns_of(transform.header.stamp))
                stream.received.append(received_ns)


class _Stamps:
    """Reads the stamp of a message whose first field is its header, without decoding the rest, which is much slower."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader
        self._is_first: dict[str, bool] = {}

    def __call__(self, raw: bytes, connection: Any) -> int:
        name = connection.msgtype
        if name not in self._is_first:
            self._is_first[name] = self._reader.typestore.fielddefs[name][1][0][0] == "header"
        if not self._is_first[name] or len(raw) < 12:
            return ns_of(deserialized(self._reader, raw, connection).header.stamp)
        # ROS 1: a sequence number, then the time. ROS 2: four bytes that tell the order of bytes, then the time.
        order = "<" if not self._reader.is2 or raw[1] & 1 else ">"
        sec, nanosec = struct.unpack_from(f"{order}{'i' if self._reader.is2 else 'I'}I", raw, 4)
        return int(sec) * SECOND + int(nanosec)


def last_part(frame: str) -> str:
    """A frame's name without the prefix of a robot."""
    return frame.rsplit("/", 1)[-1]
