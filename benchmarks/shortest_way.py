"""Cost of the shortest path among boxes (`navloom_optimal`), and how it grows with their number.

    python benchmarks/shortest_way.py [--json]

The worlds are scattered boxes, and walls with gaps. Times are CPU times, s; memory is the growth of the peak memory of
the process, MB.
"""

from __future__ import annotations

import json
import math
import resource
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from navloom.geometry.world import Box, Place
from navloom_optimal import shortest_path
from navloom_optimal.buckets import buckets_of
from navloom_optimal.circles import circles_of
from navloom_optimal.tangent_search import TangentSearch

__all__ = ["WORLDS", "measured"]

RADIUS = 0.3
"""Radius of the robot, m."""
Boxes = list[Box]


def scattered(count: int, seed: int = 0) -> tuple[Boxes, float]:
    """Rotated boxes, 0.15 per square metre, and the edge of the square that they fill, m."""
    stream = np.random.default_rng(seed)
    edge = math.sqrt(count / 0.15)
    rows = stream.uniform((0.0, 0.0, 0.2, 0.2, -3.0), (edge, edge, 1.2, 1.2, 3.0), (count, 5)).tolist()
    return [Box(f"{k}", (x, x + w), (y, y + h), yaw=yaw) for k, (x, y, w, h, yaw) in enumerate(rows)], edge


def walls(count: int, seed: int = 0) -> tuple[Boxes, float]:
    """Rows of adjacent boxes, 1 m apart, each with one gap, and the edge of the square that they fill, m."""
    stream = np.random.default_rng(seed)
    side = round(math.sqrt(count))
    gaps = stream.integers(0, side, side).tolist()
    cells = [(row, col) for row in range(side) for col in range(side) if col != gaps[row]]
    return [Box(f"{r} {c}", (c, c + 1.0), (r + 0.8, r + 1.0)) for r, c in cells], float(side)


WORLDS: dict[str, Callable[[int], tuple[Boxes, float]]] = {"scattered": scattered, "walls": walls}


def measured(kind: str, count: int) -> dict[str, Any]:
    """Measure a world: length, m, time of the search, s, number of tangents examined, memory, MB."""
    boxes, edge = WORLDS[kind](count)
    shapes = shortest_path._shapes(list(boxes), Place(0.0, 0.0), RADIUS)
    before, began = _peak(), time.process_time()
    circles = circles_of(shapes, np.array([(-1.0, -1.0), (edge + 1.5, edge + 1.5)]))
    search = TangentSearch(circles, buckets_of(shapes))
    found = search.run()
    return {"world": kind, "boxes": len(boxes), "length_m": None if found is None else found.length,
            "search_s": time.process_time() - began, "looked_at": search.looked_at,
            "memory_mb": _peak() - before}  # fmt: skip


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main() -> None:
    """Measure all worlds and print a table, or JSON."""
    shortest_path.warm_up()
    found = [measured(kind, count) for kind in WORLDS for count in (100, 250, 1000, 4000)]
    if "--json" in sys.argv[1:]:
        print(json.dumps(found))
        return
    print(f"{'world':<10} {'boxes':>5} {'search, s':>9} {'looked at':>9} {'memory, MB':>10}")
    for one in found:
        print(f"{one['world']:<10} {one['boxes']:>5} {one['search_s']:>9.2f} {one['looked_at']:>9} "
              f"{one['memory_mb']:>10.0f}")  # fmt: skip


if __name__ == "__main__":
    main()
