"""Decodes bytes that navloom_ros encoded, with ROS 2 Kilted's own deserializer, for test_ros_peers.py.

Each line of input is a JSON list of a type and its bytes, hexadecimal; each line of output has the values.
"""

import importlib
import json
import sys

from make_golden import plain
from rclpy.serialization import deserialize_message

for line in sys.stdin:
    name, data = json.loads(line)
    package, kind, short = name.split("/")
    owner, _, part = short.partition("_") if kind == "srv" else (short, "", "")
    cls = getattr(importlib.import_module(f"{package}.{kind}"), owner)
    message = deserialize_message(bytes.fromhex(data), getattr(cls, part) if part else cls)
    print(json.dumps(plain(message)), flush=True)
