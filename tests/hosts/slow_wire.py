"""A slow cable between two TAP devices in two network namespaces: rate, delay and loss, in both directions.

It replaces `tc netem`, which many kernels of containers and small virtual machines lack, and takes the same
figures: `python slow_wire.py NAMESPACE/DEVICE NAMESPACE/DEVICE RATE DELAY LOSS`, in bit/s, s and a share of frames.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import random
import select
import struct
import sys
import time
from collections import deque
from dataclasses import dataclass, field

__all__ = ["Direction", "main"]

CLONE_NEWNET = 0x40000000
TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
LARGEST_FRAME = 65_536
QUEUE = 1000
"""Largest number of waiting frames, netem's default limit; further frames are lost."""


@dataclass
class Direction:
    """One way through the cable: frames leave one after the other at the rate, and arrive the delay later.

    Attributes:
        rate: bit/s.
        delay: s.
        loss: Share of frames, 0 to 1.
        chance: Draws whether a frame is lost.
    """

    rate: float
    delay: float
    loss: float
    chance: random.Random
    waiting: deque[tuple[float, bytes]] = field(default_factory=deque)
    free_at: float = 0.0

    def enter(self, frame: bytes, now: float) -> None:
        """Accept a frame at a time, s."""
        if len(self.waiting) >= QUEUE or self.chance.random() < self.loss:
            return
        self.free_at = max(now, self.free_at) + 8 * len(frame) / self.rate
        self.waiting.append((self.free_at + self.delay, frame))

    def due(self, now: float) -> list[bytes]:
        """Frames that have arrived by a time, s."""
        arrived = []
        while self.waiting and self.waiting[0][0] <= now:
            arrived.append(self.waiting.popleft()[1])
        return arrived

    def wait(self, now: float) -> float:
        """Time until the next frame arrives, s; inf if none is under way."""
        return max(0.0, self.waiting[0][0] - now) if self.waiting else float("inf")


def open_tap(place: str) -> int:
    """File descriptor of the existing TAP device at NAMESPACE/DEVICE."""
    namespace, _, device = place.partition("/")
    entry = os.open(f"/run/netns/{namespace}", os.O_RDONLY)
    if ctypes.CDLL(None, use_errno=True).setns(entry, CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), f"namespace {namespace} cannot be entered")
    os.close(entry)
    tap = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(tap, TUNSETIFF, struct.pack("16sH22x", device.encode(), IFF_TAP | IFF_NO_PI))
    return tap


def main(arguments: list[str]) -> None:
    """Carry frames until killed."""
    taps = [open_tap(place) for place in arguments[:2]]
    rate, delay, loss = map(float, arguments[2:])
    ways = {
        taps[0]: (taps[1], Direction(rate, delay, loss, random.Random(1))),
        taps[1]: (taps[0], Direction(rate, delay, loss, random.Random(2))),
    }
    print("ready", flush=True)
    while True:
        wait = min(way.wait(time.monotonic()) for _, way in ways.values())
        ready, _, _ = select.select(taps, [], [], None if wait == float("inf") else wait)
        now = time.monotonic()
        for tap in ready:
            _take(tap, ways[tap][1], now)
        for to, way in ways.values():
            for frame in way.due(now):
                _give(to, frame)


def _take(tap: int, way: Direction, now: float) -> None:
    """Accept every frame that waits at one end."""
    while True:
        try:
            way.enter(os.read(tap, LARGEST_FRAME), now)
        except OSError:  # no more frames, or the end is down
            return


def _give(tap: int, frame: bytes) -> None:
    """Deliver a frame; it is lost if the end is down."""
    try:
        os.write(tap, frame)
    except OSError:
        return


if __name__ == "__main__":
    main(sys.argv[1:])
