"""A simulated ROS robot in the test's process, on a real network over loopback."""

from __future__ import annotations

import math
import threading
import time

import numpy as np
from navloom_ros.node import Node
from navloom_ros.qos import SENSOR, Qos

ROOM = 4.0
"""Half the side of the square room that it is in, m."""
MOUNT = 0.1
"""Distance from the base to the laser, forward, m."""
FIRST = Qos(transient_local=True, depth=1)


class Robot:
    """Follows each command without inertia, and stops 0.5 s after the last one.

    Attributes:
        pose: True pose in the room, m and rad.
        heard: Commands as (time, s, monotonic; forward speed, m/s; turn rate, rad/s), newest last.
        is_silent: It publishes nothing.
        touches: Its bumper is pressed.

    Args:
        types: Of its distribution.
        router: Endpoint of its router.
        stamped: It takes TwistStamped.
        clock_ahead: Lead of its clock over that of this host, s.
        simulated: Its stamps are those of /clock, which starts at 0.
        namespace: Of all its topics but /clock.
    """

    def __init__(self, types, router, stamped=False, clock_ahead=123.0, simulated=False, namespace="/"):
        self.pose, self.heard = np.zeros(3), []
        self.is_silent, self.touches = False, False
        self._ahead = -time.time() if simulated else clock_ahead
        self._node = node = Node("base", router=router, types=types, namespace=namespace)
        self._kind = "geometry_msgs/msg/TwistStamped" if stamped else "geometry_msgs/msg/Twist"
        self._commands = node.subscription("cmd_vel", self._kind)
        self._odometry = node.publisher("odom", "nav_msgs/msg/Odometry")
        self._scan = node.publisher("scan", "sensor_msgs/msg/LaserScan", SENSOR)
        self._sonar = node.publisher("sonar", "sensor_msgs/msg/Range", SENSOR)
        self._bumper = node.publisher("bumper", "std_msgs/msg/Bool")
        self._clock = node.publisher("/clock", "rosgraph_msgs/msg/Clock", SENSOR) if simulated else None
        static = node.publisher("tf_static", "tf2_msgs/msg/TFMessage", FIRST)
        mounted = {"laser": MOUNT, "sonar": 0.2}
        base = {"frame_id": "base_link"}
        static.publish(
            transforms=[
                {"header": base, "child_frame_id": frame, "transform": {"translation": {"x": ahead}}}
                for frame, ahead in mounted.items()
            ]
        )
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self):
        self._ending.set()
        self._thread.join()
        self._node.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def _run(self):
        before, round_number = time.monotonic(), 0
        while not self._ending.wait(0.02):
            now = time.monotonic()
            while (received := self._commands.take()) is not None:
                twist = getattr(received.message, "twist", received.message)
                self.heard.append((now, twist.linear.x, twist.angular.z))
            at, speed, turn = self.heard[-1] if self.heard else (0.0, 0.0, 0.0)
            speed, turn = (speed, turn) if now - at < 0.5 else (0.0, 0.0)
            step = now - before
            before = now
            self.pose += (speed * math.cos(self.pose[2]) * step, speed * math.sin(self.pose[2]) * step, turn * step)
            round_number += 1
            if not self.is_silent:
                self._publish(speed, turn, round_number)

    def _publish(self, speed, turn, round_number):
        x, y, heading = self.pose.tolist()
        seconds = time.time() + self._ahead
        stamp = {"sec": int(seconds), "nanosec": int(seconds % 1.0 * 1e9)}
        if self._clock is not None:
            self._clock.publish(clock=stamp)
        rotation = {"z": math.sin(heading / 2), "w": math.cos(heading / 2)}
        self._odometry.publish(
            header={"stamp": stamp, "frame_id": "odom"},
            pose={"pose": {"position": {"x": x, "y": y}, "orientation": rotation}},
            twist={"twist": {"linear": {"x": speed}, "angular": {"z": turn}}},
        )
        if round_number % 3:
            return
        angles = np.linspace(-math.pi, math.pi, 181)
        place = (x + MOUNT * math.cos(heading), y + MOUNT * math.sin(heading))
        ranges = [_wall(place, heading + angle) for angle in angles.tolist()]
        step = float(angles[1] - angles[0])
        limits = {"range_min": 0.1, "range_max": 12.0}
        self._scan.publish(
            header={"stamp": stamp, "frame_id": "laser"}, angle_min=-math.pi, angle_max=math.pi, angle_increment=step,
            ranges=ranges, **limits,
        )  # fmt: skip
        header = {"stamp": stamp, "frame_id": "sonar"}
        self._sonar.publish(header=header, field_of_view=0.3, min_range=0.1, max_range=3.0, range=float("inf"))
        self._bumper.publish(data=self.touches)


def _wall(place, bearing):
    """Distance to the wall of the room along a bearing, m."""
    along = (math.cos(bearing), math.sin(bearing))
    ways = [(math.copysign(ROOM, a) - p) / a for p, a in zip(place, along, strict=True) if abs(a) > 1e-9]
    return min(ways)
