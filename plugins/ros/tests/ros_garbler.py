"""Spoils the messages of a robot's topic, for campaign_ros2_base.py and test_ros2_base_reasons.py."""

from __future__ import annotations

import copy
import random
import threading

import numpy as np
from navloom_ros.names import key_of
from navloom_ros.node import Node
from navloom_ros.qos import SENSOR, Qos
from navloom_ros.tokens import Attachment
from navloom_ros.wire import epoch_ns
from ros_golden import KILTED

HOUR = 3600
INTERVAL = 0.002
"""Interval of the spoiled messages, s."""


def flipped(message):
    """An empty message of the same type, with 20 random bytes changed."""
    data = bytearray(KILTED.encode(KILTED.new(message.__msgtype__)))
    for _ in range(20):
        data[random.randrange(len(data))] = random.randrange(256)
    return bytes(data)


def random_bytes(message):
    return random.randbytes(len(KILTED.encode(message)))


def cut_short(message):
    data = KILTED.encode(message)
    return data[: random.randrange(len(data))]


def without_numbers(message):
    """A scan whose ranges, or one of its limits, are NaN."""
    name = random.choice(["ranges", "angle_min", "angle_increment", "range_max"])
    value = np.full(len(message.ranges), np.nan, np.float32) if name == "ranges" else float("nan")
    return changed(message, **{name: value})


def of_wrong_length(message):
    """A scan of no, half, or three times the ranges, with unchanged angles."""
    ranges = random.choice([message.ranges[:0], message.ranges[::2].copy(), np.tile(message.ranges, 3)])
    return changed(message, ranges=ranges)


def stamped(seconds):
    """Returns a spoiler that moves the stamp, s."""

    def moved(message):
        header = copy.deepcopy(message.header)
        header.stamp.sec += seconds
        return changed(message, header=header)

    return moved


def changed(message, **values):
    one = copy.copy(message)
    for name, value in values.items():
        setattr(one, name, value)
    return KILTED.encode(one)


SCANS = {
    "scans of random bytes": random_bytes,
    "scans cut short": cut_short,
    "scans of NaN": without_numbers,
    "scans of wrong length": of_wrong_length,
    "scans of an hour ago": stamped(-HOUR),
    "scans of 30 s ago": stamped(-30),
    "scans an hour ahead": stamped(HOUR),
}
"""By name, what makes a spoiled message from a good LaserScan."""


def garble(router, topic, kind, spoil, ending):
    """Publish spoiled copies of a robot's newest message, faster than the robot, until `ending` is set.

    Args:
        router: Endpoint of the robot's router.
        topic, kind: The topic and its type.
        spoil: Makes the bytes from a good message.
        ending: Event that ends it.
    """
    node = Node("garbler", router=router, types=KILTED)
    heard = node.subscription(topic, kind, Qos(reliable=False, depth=200))
    first = heard.take(5.0)
    assert first is not None, f"the robot publishes no {topic}"
    put, _ = node.wire.publisher(key_of(0, topic, kind, KILTED.hash_of(kind)), SENSOR)

    def flood():
        message, number = first.message, 0
        with node:
            while not ending.wait(INTERVAL):
                number += 1
                put(spoil(message), Attachment(number, epoch_ns(), random.randbytes(16)).data)
                while (received := heard.take()) is not None:
                    if received.gid == first.gid:
                        message = received.message

    threading.Thread(target=flood, daemon=True).start()
