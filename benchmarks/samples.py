"""The messages of the round trips in `wire` and `zenoh_ends`."""

from __future__ import annotations

import numpy as np
from navloom.messages import MapUpdate, Message, OccupancyGrid, Pose2D
from navloom_benchmarks.samples import samples as bench_samples
from navloom_benchmarks.samples import wire_bytes, wire_size

__all__ = ["samples", "wire_bytes", "wire_size"]


def samples() -> dict[str, Message]:
    """By name: a velocity command, a sweep of 77 frames of 181 beams, and maps of 330 x 330 and 1000 x 1000 cells."""
    random = np.random.default_rng(7)
    command, sweep = bench_samples(random).values()
    return {
        "command 64 B": command,
        "sweep 110 KB": sweep,
        "map 110 KB": _map(random, 330),
        "map 1 MB": _map(random, 1000),
    }


def _map(random: np.random.Generator, cells: int) -> MapUpdate:
    grid = random.integers(-1, 101, (cells, cells)).astype(np.int8)
    return MapUpdate(0, OccupancyGrid(grid, 0.05, Pose2D(0.0, 0.0, 0.0)), np.zeros((40, 4)), ())
