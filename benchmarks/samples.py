"""The messages that make the round trips, and the streams they take."""

from __future__ import annotations

from typing import Any

import numpy as np
from navloom.messages import Command, Envelope, MapUpdate, Message, OccupancyGrid, Pose2D, Sweep, Twist2D
from navloom.messages.codec import encode
from numpy.typing import NDArray

__all__ = ["BACK", "THERE", "encoded_size", "samples"]

THERE, BACK = ("platform", "there"), ("platform", "back")
"""Role and instance of the two streams."""


def samples() -> dict[str, Message]:
    """By name: a velocity command, a sweep of 77 frames of 181 beams, and maps of 330 x 330 and 1000 x 1000 cells."""
    random = np.random.default_rng(7)
    ranges, pitches = random.uniform(0.5, 30.0, (77, 181)), np.linspace(-0.7, 0.3, 77)
    times, bearings = np.linspace(0.0, 2.0, 77), np.linspace(-1.57, 1.57, 181)
    return {
        "command 64 B": Command(Twist2D(0.31, 0.0, -0.12)),
        "sweep 110 KB": Sweep(
            0, 1, _kept(ranges), _kept(pitches), _kept(times), _kept(bearings), "paper", 0.2, 0.0, 0.6, 0.02, 30.0
        ),
        "map 110 KB": _map(random, 330),
        "map 1 MB": _map(random, 1000),
    }


def encoded_size(message: Message) -> int:
    """Bytes of a message on the wire, header and all."""
    return len(encode(message, Envelope("bench/r1/platform/there/data", 1, 1, 0, 0, 0)))


def _map(random: np.random.Generator, cells: int) -> MapUpdate:
    grid = random.integers(-1, 101, (cells, cells)).astype(np.int8)
    return MapUpdate(0, OccupancyGrid(_kept(grid), 0.05, Pose2D(0.0, 0.0, 0.0)), _kept(np.zeros((40, 4))), ())


def _kept(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array
