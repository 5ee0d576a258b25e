"""Writes ROS bags for tests: a robot with a planar laser drives straight through a room of 6 m by 4 m."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROOM = (-1.0, -2.0, 5.0, 2.0)
"""Lowest x and y, then highest x and y of the walls, m. The robot starts at (0, 0) and drives along x."""
START_NS = 1_600_000_000_000_000_000
SPEED, RATE_HZ, SECONDS = 0.5, 10.0, 4.0
MOUNT_X, MOUNT_YAW = 0.2, math.pi / 2.0
"""Mount of the laser: ahead of base, m, and turned to the left, rad."""
BEAMS = 181


@dataclass
class Bag:
    """Writes one bag; `ros` is 1 or 2."""

    path: Path
    ros: int
    store: Any = field(init=False)

    def __post_init__(self) -> None:
        self.store = get_typestore(Stores.ROS1_NOETIC if self.ros == 1 else Stores.ROS2_HUMBLE)
        if self.ros == 1:
            text = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
        self.writer: Any = Writer1(self.path) if self.ros == 1 else Writer2(self.path, version=9)
        self._ways: dict[str, Any] = {}

    def __enter__(self) -> Bag:
        self.writer.open()
        return self

    def __exit__(self, *exception: object) -> None:
        self.writer.close()

    def type(self, name: str) -> Any:
        """Class of a message type."""
        return self.store.types[name]

    def put(self, topic: str, message: Any, stamp_ns: int) -> None:
        name = message.__msgtype__
        if topic not in self._ways:
            self._ways[topic] = self.writer.add_connection(topic, name, typestore=self.store)
        serialize = self.store.serialize_ros1 if self.ros == 1 else self.store.serialize_cdr
        self.writer.write(self._ways[topic], stamp_ns, serialize(message, name))

    def header(self, frame: str, stamp_ns: int) -> Any:
        time = self.type("builtin_interfaces/msg/Time")(stamp_ns // 10**9, stamp_ns % 10**9)
        make = self.type("std_msgs/msg/Header")
        return make(seq=0, stamp=time, frame_id=frame) if self.ros == 1 else make(stamp=time, frame_id=frame)

    def transform(self, parent: str, child: str, x: float, yaw: float, stamp_ns: int) -> Any:
        vector, turn = self.type("geometry_msgs/msg/Vector3"), self.type("geometry_msgs/msg/Quaternion")
        motion = self.type("geometry_msgs/msg/Transform")(
            vector(x, 0.0, 0.3), turn(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        )
        one = self.type("geometry_msgs/msg/TransformStamped")(self.header(parent, stamp_ns), child, motion)
        return self.type("tf2_msgs/msg/TFMessage")([one])

    def odometry(self, x: float, stamp_ns: int) -> Any:
        """Odometry of a robot at (x, 0) that drives along x."""
        point, turn = self.type("geometry_msgs/msg/Point"), self.type("geometry_msgs/msg/Quaternion")
        vector = self.type("geometry_msgs/msg/Vector3")
        pose = self.type("geometry_msgs/msg/Pose")(point(x, 0.0, 0.0), turn(0.0, 0.0, 0.0, 1.0))
        twist = self.type("geometry_msgs/msg/Twist")(vector(SPEED, 0.0, 0.0), vector(0.0, 0.0, 0.0))
        with_pose = self.type("geometry_msgs/msg/PoseWithCovariance")(pose, np.zeros(36))
        with_twist = self.type("geometry_msgs/msg/TwistWithCovariance")(twist, np.zeros(36))
        make = self.type("nav_msgs/msg/Odometry")
        return make(self.header("odom", stamp_ns), "base_link", with_pose, with_twist)

    def scan(self, ranges: Any, stamp_ns: int, frame: str = "laser", range_max: float = 10.0) -> Any:
        """A LaserScan over ±90°."""
        return self.type("sensor_msgs/msg/LaserScan")(
            self.header(frame, stamp_ns), -math.pi / 2, math.pi / 2, math.pi / (len(ranges) - 1), 0.0, 0.1, 0.1,
            range_max, np.asarray(ranges, dtype=np.float32), np.empty(0, dtype=np.float32),
        )  # fmt: skip

    def range(self, value: float, stamp_ns: int, frame: str = "laser") -> Any:
        """A sonar's Range, 0.2 to 4 m, 0.4 rad wide."""
        given = {"header": self.header(frame, stamp_ns), "radiation_type": 0, "field_of_view": 0.4,
                 "min_range": 0.2, "max_range": 4.0, "range": value, "variance": 0.0}  # fmt: skip
        make = self.type("sensor_msgs/msg/Range")
        return make(**{name: value for name, value in given.items() if name in make.__dataclass_fields__})

    def cloud(self, points: Any, rows: int, stamp_ns: int, frame: str = "laser") -> Any:
        """A PointCloud2 of (n, 3) points, m."""
        field_type = self.type("sensor_msgs/msg/PointField")
        fields = [field_type(name, 4 * place, 7, 1) for place, name in enumerate("xyz")]
        width = len(points) // rows
        data = np.frombuffer(np.asarray(points, dtype="<f4").tobytes(), dtype=np.uint8)
        make = self.type("sensor_msgs/msg/PointCloud2")
        return make(self.header(frame, stamp_ns), rows, width, fields, False, 12, 12 * width, data, False)


def ranges_at(x: float) -> Any:
    """Ranges of the laser in the room when the robot is at (x, 0), m."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, BEAMS) + MOUNT_YAW
    cos, sin = np.cos(angles), np.sin(angles)
    at = x + MOUNT_X
    with np.errstate(divide="ignore"):
        to_x = np.where(cos > 0, (ROOM[2] - at) / cos, (ROOM[0] - at) / cos)
        to_y = np.where(sin > 0, ROOM[3] / sin, ROOM[1] / sin)
    return np.minimum(np.where(to_x > 0, to_x, np.inf), np.where(to_y > 0, to_y, np.inf))


def times() -> Iterator[tuple[float, int]]:
    """Position, m, and stamp, ns, of each step of the drive."""
    for step in range(round(SECONDS * RATE_HZ)):
        time = step / RATE_HZ
        yield SPEED * time, START_NS + round(time * 1e9)


def room_bag(path: Path, ros: int) -> Path:
    """The drive through the room: scans, odometry, the laser's mount, and a topic that the import skips."""
    with Bag(path, ros) as bag:
        bag.put("/tf_static", bag.transform("base_link", "laser", MOUNT_X, MOUNT_YAW, START_NS), START_NS)
        bag.put("/chatter", bag.type("std_msgs/msg/String")("hello"), START_NS)
        for x, stamp_ns in times():
            bag.put("/odom", bag.odometry(x, stamp_ns), stamp_ns)
            bag.put("/scan", bag.scan(ranges_at(x), stamp_ns), stamp_ns)
    return path
