"""A foreign process on the robot's network: `python outsider.py WHAT`; each line of standard input starts it once.

`replay` records every command of controller, avoider and gate from the start; `go old`, `go fresh` or `go future` then
publishes them again, thousands a second, for one second. `forge` follows each command of controller and avoider, for
five seconds, with a forged one within the robot's limits. `flood` publishes 10,000 malformed messages to keys that the
robot reads. Each prints a line of JSON when it is done.
"""

from __future__ import annotations

import itertools
import json
import random
import struct
import sys
import time
from collections import deque
from collections.abc import Iterator
from typing import Any

from navloom.messages import Command, TrackingCommand, Twist2D
from navloom.messages.codec import decode, encode, schema_label
from navloom.messages.envelope import Envelope
from navloom_live.operating.client import Client
from navloom_live.operating.robot_lookup import join
from navloom_live.transport.keyspace import LARGEST
from navloom_live.transport.quality_of_service import quality_of

__all__ = ["FLOODED", "MALFORMED", "MARK", "main"]

COMMANDS = ("controller/faulty_tracker/command", "avoider/faulty_vfh/command", "gate/main/command")
FLOODED = (
    *COMMANDS,
    "platform/logged_sim/odometry",
    "platform/logged_sim/sonars",
    "localizer/odometry/pose",
    "reference/main/reference",
    "goal/main/drive",
    "avoider/faulty_vfh/handover",
    "mapper/faulty_map/map",
)
MALFORMED, HUGE = 10_000, 4
"""Messages of a flood, and how many of them are larger than a message may be."""
KEPT = 600
"""Commands of each stream that are kept: those of 30 s."""
REPLAY = 1.0
"""Duration of a replay, s."""
MARK = 0.123
"""Turn rate that no healthy command has, rad/s: a motor command with it is a forged one that got through."""
FORGED = 5.0
"""Duration of a forgery, s."""
AHEAD_NS = 5_000_000_000
"""How far ahead commands from the future are stamped, ns."""


def replay(client: Client) -> None:
    """Record commands; for each line of input, publish them again in its mode."""
    heard: dict[str, deque[bytes]] = {key: deque(maxlen=KEPT) for key in map(client.keys.prefix.__add__, _slashed())}
    for key in heard:
        client.bus.subscribe(key, lambda key, data, label: heard[key].append(data or b""))
    _say({"ready": True})
    for line in sys.stdin:
        _, mode = line.split()
        kept = {key: list(messages) for key, messages in heard.items()}
        sent = _publish(client, kept, mode)
        _say({"sent": sent, "kept": {key: len(messages) for key, messages in kept.items()}})


def _slashed() -> list[str]:
    return [f"/{key}" for key in COMMANDS]


def _publish(client: Client, kept: dict[str, list[bytes]], mode: str) -> int:
    """Publish commands again: old, up to 30 s back; fresh, of the last second; or future, marked and 5 s ahead."""
    ways = {key: client.bus.publication(key, quality_of(Command)) for key in kept}
    count = {"old": KEPT, "fresh": 20, "future": 20}[mode]
    limit, sent = time.monotonic() + REPLAY, 0
    rounds = itertools.cycle([(key, data) for key, messages in kept.items() for data in messages[-count:]])
    while time.monotonic() < limit:
        for key, data in itertools.islice(rounds, 50):
            label = schema_label(TrackingCommand if "/controller/" in key else Command)
            ways[key].put(_ahead(data, label) if mode == "future" else data, label)
            sent += 1
        time.sleep(0.01)  # 5,000 a second: a hundred times the robot's own rate
    return sent


def _ahead(data: bytes, label: str) -> bytes:
    message, at = decode(data, label)
    twist = Twist2D(0.5, 0.0, MARK)
    errors = (0.0, 0.0, 0.0)
    forged = TrackingCommand(twist, *errors) if isinstance(message, TrackingCommand) else Command(twist)
    stamp, cause = at.stamp_ns + AHEAD_NS, at.cause_ns + AHEAD_NS
    return encode(forged, Envelope(at.key, at.sequence + 100, at.tick + 100, stamp, cause, at.epoch))


def forge(client: Client) -> None:
    """For each line of input, follow each command of controller and avoider with a forged one, for FORGED s."""
    keys = [f"{client.keys.prefix}/{key}" for key in COMMANDS[:2]]
    ways = {key: client.bus.publication(key, quality_of(Command)) for key in keys}
    counts = {"until": 0.0, "sent": 0}

    def answer(key: str, data: bytes | None, label: str) -> None:
        if time.monotonic() < counts["until"]:
            message, at = decode(data or b"", label)
            twist = Twist2D(0.3, 0.0, MARK)
            forged = TrackingCommand(twist, 0.0, 0.0, 0.0) if isinstance(message, TrackingCommand) else Command(twist)
            ways[key].put(encode(forged, at._replace(sequence=at.sequence + 1)), label)
            counts["sent"] += 1

    for key in keys:
        client.bus.subscribe(key, answer)
    _say({"ready": True})
    for _ in sys.stdin:
        counts.update(until=time.monotonic() + FORGED, sent=0)
        time.sleep(FORGED)
        _say({"sent": counts["sent"]})


def flood(client: Client) -> None:
    """For each line of input, publish malformed messages as fast as possible."""
    keys = [f"{client.keys.prefix}/{key}" for key in FLOODED]
    ways = {key: client.bus.publication(key, quality_of(Command)) for key in keys}
    huge = bytes(LARGEST + 64)
    _say({"ready": True})
    for _ in sys.stdin:
        began = time.monotonic()
        for number, (data, label) in enumerate(itertools.islice(rubbish(), MALFORMED - HUGE)):
            ways[keys[number % len(keys)]].put(data, label)
        for number in range(HUGE):
            ways[keys[number]].put(huge, schema_label(Command))
        _say({"sent": MALFORMED, "took_s": time.monotonic() - began})


def rubbish() -> Iterator[tuple[bytes, str]]:
    """Bytes and schema label of malformed messages: unknown or wrong schema, truncated, random, false length, NaN."""
    source = random.Random(4)
    good = encode(Command(Twist2D(0.5, 0.0, MARK)), Envelope("a/b/c/d/e", 1, 1, 1, 1, 0))
    label = schema_label(Command)
    while True:
        yield good, "navloom.NoSuchThing/1"
        yield good, "navloom.Command/99"
        yield good, schema_label(TrackingCommand)
        yield good[: source.randrange(len(good))], label
        yield source.randbytes(source.randrange(1, 2000)), label
        yield struct.pack("<I", 0xFFFFFFFF) + good[4:], label
        yield good.replace(struct.pack(">d", MARK), struct.pack(">d", float("nan"))), label
        yield b"", ""


def _say(what: dict[str, Any]) -> None:
    print(json.dumps(what), flush=True)


def main(what: str) -> None:
    """Do WHAT until the end of standard input."""
    with join() as client:
        {"replay": replay, "forge": forge, "flood": flood}[what](client)


if __name__ == "__main__":
    main(sys.argv[1])
