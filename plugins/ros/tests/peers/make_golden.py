"""Writes `data/kilted_wheels.json` with ROS 2 Kilted's own wheels: bytes of random messages, and hashes of all types.

Run it by hand with a Python that has the wheels of the dependency group `ros-peers`:

    python make_golden.py ../data/kilted_wheels.json
"""

import array
import importlib
import json
import random
import sys
from pathlib import Path

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from rosidl_parser.definition import Array, BasicType, NamespacedType

PACKAGES = [
    "action_msgs",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "lifecycle_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rosgraph_msgs",
    "sensor_msgs",
    "service_msgs",
    "std_msgs",
    "std_srvs",
    "type_description_interfaces",
    "unique_identifier_msgs",
    "visualization_msgs",
]
MESSAGES = [
    "action_msgs/msg/GoalInfo",
    "action_msgs/msg/GoalStatusArray",
    "action_msgs/srv/CancelGoal",
    "diagnostic_msgs/msg/DiagnosticArray",
    "geometry_msgs/msg/Point",
    "geometry_msgs/msg/PolygonStamped",
    "geometry_msgs/msg/PoseArray",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
    "geometry_msgs/msg/Twist",
    "geometry_msgs/msg/TwistStamped",
    "lifecycle_msgs/srv/ChangeState",
    "lifecycle_msgs/srv/GetAvailableTransitions",
    "lifecycle_msgs/srv/GetState",
    "nav_msgs/msg/Goals",
    "nav_msgs/msg/OccupancyGrid",
    "nav_msgs/msg/Odometry",
    "nav_msgs/msg/Path",
    "nav_msgs/srv/GetMap",
    "nav_msgs/srv/GetPlan",
    "nav_msgs/srv/LoadMap",
    "nav_msgs/srv/SetMap",
    "rcl_interfaces/srv/GetParameters",
    "rcl_interfaces/srv/SetParameters",
    "rosgraph_msgs/msg/Clock",
    "sensor_msgs/msg/BatteryState",
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/Imu",
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/PointCloud2",
    "sensor_msgs/msg/Range",
    "std_msgs/msg/Bool",
    "std_msgs/msg/ByteMultiArray",
    "std_msgs/msg/Char",
    "std_msgs/msg/ColorRGBA",
    "std_msgs/msg/Empty",
    "std_msgs/msg/Float64MultiArray",
    "std_msgs/msg/Header",
    "std_msgs/msg/Int64",
    "std_msgs/msg/String",
    "std_srvs/srv/Empty",
    "std_srvs/srv/SetBool",
    "std_srvs/srv/Trigger",
    "unique_identifier_msgs/msg/UUID",
    "visualization_msgs/msg/Marker",
    "visualization_msgs/msg/MarkerArray",
]
INTEGERS = {f"{sign}int{bits}": (sign, bits) for sign in ("", "u") for bits in (8, 16, 32, 64)}


def scalar(slot, rng):
    if not isinstance(slot, BasicType):
        return "".join(rng.choice("abc/_ äµ") for _ in range(rng.randrange(9)))
    name = slot.typename
    if name == "boolean":
        return rng.random() < 0.5
    if name == "octet":
        return bytes([rng.randrange(256)])
    if name in INTEGERS:
        sign, bits = INTEGERS[name]
        return rng.randrange(2**bits) if sign else rng.randrange(2**bits) - 2 ** (bits - 1)
    return float(np.float32(rng.uniform(-1e3, 1e3)))


def value(slot, rng):
    if isinstance(slot, NamespacedType):
        module = importlib.import_module(".".join(slot.namespaces))
        return filled(getattr(module, slot.name), rng)
    if hasattr(slot, "value_type"):
        count = slot.size if isinstance(slot, Array) else rng.randrange(4)
        return [value(slot.value_type, rng) for _ in range(count)]
    return scalar(slot, rng)


def filled(cls, rng):
    message = cls()
    for field, slot in zip(cls.get_fields_and_field_types(), cls.SLOT_TYPES, strict=True):
        setattr(message, field, value(slot, rng))
    return message


def plain(message):
    if hasattr(message, "get_fields_and_field_types"):
        return {field: plain(getattr(message, field)) for field in message.get_fields_and_field_types()}
    if isinstance(message, bytes):
        return message[0]
    if isinstance(message, (list, tuple, np.ndarray, array.array)):
        return [plain(one) for one in message]
    return message.item() if isinstance(message, np.generic) else message


def classes(name):
    package, kind, short = name.split("/")
    cls = getattr(importlib.import_module(f"{package}.{kind}"), short)
    return (
        [(name, cls)] if kind == "msg" else [(f"{name}_{part}", getattr(cls, part)) for part in ("Request", "Response")]
    )


def hashes():
    """Hash of every type in the wheels, parts of services included."""
    found = {}
    for path in sorted((Path(sys.prefix) / "share").glob("*/*/*.json")):
        if path.parent.name in ("msg", "srv", "action") and path.parent.parent.name in PACKAGES:
            for type_hash in json.loads(path.read_text("utf-8"))["type_hashes"]:
                found[type_hash["type_name"]] = type_hash["hash_string"]
    return found


def main(target):
    rng = random.Random(7)
    messages = []
    for name, cls in (pair for one in MESSAGES for pair in classes(one)):
        for _ in range(2):
            message = filled(cls, rng)
            data = serialize_message(message)
            assert deserialize_message(data, cls) == message
            messages.append({"type": name, "value": plain(message), "cdr": data.hex()})
    lines = ",\n".join(json.dumps(one, ensure_ascii=False) for one in messages)
    text = f'{{"hashes": {json.dumps(hashes(), indent=0)},\n"messages": [\n{lines}\n]}}\n'
    Path(target).write_text(text, "utf-8")
    print(len(messages), "messages,", len(hashes()), "hashes")


if __name__ == "__main__":
    main(sys.argv[1])
