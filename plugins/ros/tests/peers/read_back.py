"""Reads bytes of ours with ROS 2 Kilted's own deserializer: lines of JSON with a type and bytes in, values out."""

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
