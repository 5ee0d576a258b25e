"""Decodes mutated messages: the only error may be MalformedMessage, in bounded time and memory.

`python plugins/ros/tests/fuzz_cdr.py 1000000` decodes a million and prints the longest time and the peak memory.
test_ros_messages.py runs a few.
"""

from __future__ import annotations

import random
import resource
import struct
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from navloom_ros.errors import MalformedMessage

sys.path.insert(0, str(Path(__file__).parent))
from ros_golden import CDR, KILTED, WHEELS

SEEDS = [*CDR.items(), *((message["type"], bytes.fromhex(message["cdr"])) for message in WHEELS["messages"])]
HUGE = (0xFFFFFFFF, 0x7FFFFFFF, 0x80000000, 0x10000000, 0x00FFFFFF, 0)
ROOM = 256 << 20
"""Memory that decoding may allocate beyond that of the process before, bytes."""


@dataclass
class Report:
    """Outcome of the mutated messages."""

    tried: int = 0
    decoded: int = 0
    refused: int = 0
    slowest: float = 0.0
    slowest_type: str = ""
    others: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        return (
            f"{self.tried} tried: {self.decoded} decoded, {self.refused} refused, {len(self.others)} other errors; "
            f"slowest {1e3 * self.slowest:.2f} ms ({self.slowest_type}); peak memory of the process {peak:.0f} MB"
        )


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Apply one to four changes: bits, bytes, 32-bit lengths, and parts that are cut, doubled or appended."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        place = rng.randrange(max(1, len(changed)))
        kind = rng.randrange(7)
        if kind == 0 and changed:
            changed[place % len(changed)] ^= 1 << rng.randrange(8)
        elif kind == 1 and changed:
            changed[place % len(changed)] = rng.randrange(256)
        elif kind == 2 and len(changed) >= 8:
            aligned = min(place & ~3, len(changed) - 4)
            struct.pack_into("<I", changed, aligned, rng.choice(HUGE) if rng.random() < 0.7 else rng.randrange(4096))
        elif kind == 3:
            del changed[place:]
        elif kind == 4:
            del changed[place : place + rng.randint(1, 16)]
        elif kind == 5:
            changed[place:place] = changed[place : place + rng.randint(1, 64)]
        else:
            changed += rng.randbytes(rng.randint(1, 32))
    return bytes(changed)


def fuzz(count: int, seed: int = 0) -> Report:
    """Decode `count` mutated messages, mostly as their own type, sometimes as another one."""
    rng = random.Random(seed)
    report = Report()
    for _ in range(count):
        name, data = rng.choice(SEEDS)
        if rng.random() < 0.1:
            name = rng.choice(SEEDS)[0]
        payload = mutated(data, rng)
        start = time.thread_time()
        try:
            KILTED.decode(name, payload)
            report.decoded += 1
        except MalformedMessage:
            report.refused += 1
        except (Exception, MemoryError) as error:
            report.others.append(f"{name} {payload.hex()}: {error!r}")
        spent = time.thread_time() - start
        report.tried += 1
        if spent > report.slowest and report.tried > len(SEEDS):
            report.slowest, report.slowest_type = spent, f"{name}, {len(payload)} bytes"
    return report


def warm_up() -> None:
    """Generate the decoder of every type, which takes longer than decoding any message."""
    for name, data in SEEDS:
        KILTED.decode(name, data)


def limit_memory() -> None:
    """Limit the memory of the process to ROOM more than it has now."""
    used = int(Path("/proc/self/statm").read_text("ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + ROOM, resource.RLIM_INFINITY))


if __name__ == "__main__":
    warm_up()
    limit_memory()
    result = fuzz(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    print(result)
    print("\n".join(result.others[:10]))
    sys.exit(bool(result.others))
