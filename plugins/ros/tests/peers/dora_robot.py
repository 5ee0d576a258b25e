"""A simulated ROS robot on dora-rs, for campaign_ros2_base.py: a differential base of 0.4 m in a room with two boxes.

`python dora_robot.py ROUTER SHAPES LOG PREFIX…`: SHAPES is a file with the Arrow types of the messages. LOG gets a line
for each command (monotonic time, speed, turn rate), for each timeout, and for the true pose every 50 ms. The base stops
0.5 s after the last command. After a restart it is at its last true pose, and its odometry starts from zero.
"""

import json
import math
import os
import sys
import tempfile
import time
from pathlib import Path

ROUTER, SHAPES, LOG, PREFIXES = sys.argv[1], sys.argv[2], sys.argv[3], sys.argv[4:]
os.environ["AMENT_PREFIX_PATH"] = ":".join(PREFIXES)

import dora  # noqa: E402
import numpy as np  # noqa: E402
import pyarrow  # noqa: E402

TIMEOUT, STEP, BEAMS, REACH = 0.5, 0.01, 360, 8.0
ACCELERATION, TURN_ACCELERATION = 1.5, 6.0
LONGEST_STEP = 0.05
AHEAD = 0.12
"""Distance from the base to the laser, forward, m."""
ROOM = (-1.0, -2.5, 6.0, 2.5)
BOXES = [(2.0, -0.6, 2.6, 0.4), (4.0, 0.2, 4.5, 1.2)]
SETTINGS = {
    "mode": "client",
    "connect": {"endpoints": [ROUTER]},
    "scouting": {"multicast": {"enabled": False}},
    "timestamping": {"enabled": True},
}
NUMBERS = {"bool": pyarrow.bool_(), "byte": pyarrow.uint8(), "char": pyarrow.uint8(), "string": pyarrow.string()}


def arrow(shape):
    if isinstance(shape, dict):
        return pyarrow.struct([(name, arrow(inner)) for name, inner in shape.items()])
    if isinstance(shape, list):
        return pyarrow.list_(arrow(shape[0]))
    return NUMBERS.get(shape) or getattr(pyarrow, shape)()


def edges():
    for low_x, low_y, high_x, high_y in [ROOM, *BOXES]:
        corners = [(low_x, low_y), (high_x, low_y), (high_x, high_y), (low_x, high_y)]
        yield from zip(corners, corners[1:] + corners[:1], strict=True)


EDGES = np.array(list(edges()))


def ranges(x, y, bearings):
    """Distance to the nearest edge along each bearing, m; infinite beyond the laser's range."""
    along = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)[:, None, :]
    start, way = EDGES[None, :, 0, :], (EDGES[:, 1, :] - EDGES[:, 0, :])[None]
    gap = start - np.array([x, y])
    cross = along[..., 0] * way[..., 1] - along[..., 1] * way[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (gap[..., 0] * way[..., 1] - gap[..., 1] * way[..., 0]) / cross
        share = (gap[..., 0] * along[..., 1] - gap[..., 1] * along[..., 0]) / cross
    hit = np.where((share >= 0.0) & (share <= 1.0) & (distance > 0.0), distance, np.inf).min(axis=1)
    return np.where(hit > REACH, np.inf, hit)


class Robot:
    def __init__(self, config):
        context = dora.Ros2Context(PREFIXES, dora.Ros2Transport.zenoh("rep2016", config))
        self._context = context
        node = self._node = context.new_node("base", "/", dora.Ros2NodeOptions(rosout=False))
        shapes = json.loads(Path(SHAPES).read_text())
        self._arrow = {name: arrow(shape) for name, shape in shapes.items()}
        durability = dora.Ros2Durability
        flowing = dora.Ros2QosPolicies(durability=durability.Volatile, reliable=True, keep_last=10)
        latched = dora.Ros2QosPolicies(durability=durability.TransientLocal, reliable=True, keep_last=1)

        def publisher(topic, kind, qos):
            return node.create_publisher(node.create_topic(topic, kind, qos), qos)

        self._commands = node.create_subscription(
            node.create_topic("/cmd_vel", "geometry_msgs/Twist", flowing), flowing
        )
        self._odometry = publisher("/odom", "nav_msgs/Odometry", flowing)
        self._scan = publisher("/scan", "sensor_msgs/LaserScan", flowing)
        self._static = publisher("/tf_static", "tf2_msgs/TFMessage", latched)
        self._templates = json.loads(Path(SHAPES + ".empty").read_text())
        self.pose, self.odometry, self.speed, self.turn = last_pose(), [0.0, 0.0, 0.0], 0.0, 0.0
        self.heard_at, self.wanted = -math.inf, (0.0, 0.0)

    def send(self, publisher, name, message):
        publisher.publish(pyarrow.array([message], type=self._arrow[name]))

    def message(self, name, stamp, frame):
        message = json.loads(json.dumps(self._templates[name]))
        message["header"] = {"stamp": stamp, "frame_id": frame}
        return message

    def run(self, log):
        self.publish_mounts()
        before, number = time.monotonic(), 0
        while True:
            number += 1
            time.sleep(max(0.0, before + STEP - time.monotonic()))
            now = time.monotonic()
            step, before = min(now - before, LONGEST_STEP), now  # on a busy host it stands still, and never jumps
            while (message := self._commands.next()) is not None:
                twist = message.to_pylist()[0]
                self.wanted, self.heard_at = (twist["linear"]["x"], twist["angular"]["z"]), now
                log.write(json.dumps(["command", now, *self.wanted]) + "\n")
            if now - self.heard_at >= TIMEOUT and any(self.wanted):
                self.wanted = (0.0, 0.0)
                log.write(json.dumps(["timeout", now, 0.0, 0.0]) + "\n")
            self.move(self.wanted, step)
            if number % 2 == 0:
                self.publish_odometry()
            if number % 10 == 0:
                self.publish_scan()
            if number % 5 == 0:
                log.write(json.dumps(["truth", now, *self.pose, self.speed, self.turn, self.gap()]) + "\n")

    def move(self, wanted, step):
        for name, goal, limit in (("speed", wanted[0], ACCELERATION), ("turn", wanted[1], TURN_ACCELERATION)):
            value = getattr(self, name)
            setattr(self, name, value + max(-limit * step, min(limit * step, goal - value)))
        for pose in (self.pose, self.odometry):
            pose[0] += self.speed * step * math.cos(pose[2])
            pose[1] += self.speed * step * math.sin(pose[2])
            pose[2] = math.remainder(pose[2] + self.turn * step, math.tau)

    def gap(self):
        """Distance from the centre to the nearest edge, m."""
        return float(np.min(ranges(self.pose[0], self.pose[1], np.linspace(0.0, math.tau, 120, endpoint=False))))

    def publish_mounts(self):
        one = {
            "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "base_link"},
            "child_frame_id": "laser",
            "transform": {
                "translation": {"x": AHEAD, "y": 0.0, "z": 0.2},
                "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
            },
        }
        self.send(self._static, "tf2_msgs/msg/TFMessage", {"transforms": [one]})

    def publish_odometry(self):
        message = self.message("nav_msgs/msg/Odometry", stamp(), "odom")
        x, y, heading = self.odometry
        message["pose"]["pose"]["position"].update(x=x, y=y)
        message["pose"]["pose"]["orientation"].update(z=math.sin(heading / 2), w=math.cos(heading / 2))
        message["twist"]["twist"]["linear"]["x"] = self.speed
        message["twist"]["twist"]["angular"]["z"] = self.turn
        self.send(self._odometry, "nav_msgs/msg/Odometry", message)

    def publish_scan(self):
        message = self.message("sensor_msgs/msg/LaserScan", stamp(), "laser")
        step = math.tau / BEAMS
        x = self.pose[0] + AHEAD * math.cos(self.pose[2])
        y = self.pose[1] + AHEAD * math.sin(self.pose[2])
        bearings = self.pose[2] - math.pi + step * np.arange(BEAMS)
        message.update(
            angle_min=-math.pi, angle_max=math.pi - step, angle_increment=step, range_min=0.1, range_max=REACH
        )
        message["ranges"] = ranges(x, y, bearings).tolist()
        self.send(self._scan, "sensor_msgs/msg/LaserScan", message)


def last_pose():
    """The last true pose in the log; the origin if there is none."""
    told = [json.loads(line) for line in Path(LOG).read_text().splitlines()] if Path(LOG).exists() else []
    return next((one[2:5] for one in reversed(told) if one[0] == "truth"), [0.0, 0.0, 0.0])


def stamp():
    now = time.time_ns() + 77_000_000_000  # the robot's clock differs from this host's
    return {"sec": now // 1_000_000_000, "nanosec": now % 1_000_000_000}


def main():
    with tempfile.NamedTemporaryFile("w", suffix=".json5") as config, open(LOG, "a", buffering=1) as log:
        json.dump(SETTINGS, config)
        config.flush()
        robot = Robot(config.name)
        print("ready", flush=True)
        robot.run(log)


main()
