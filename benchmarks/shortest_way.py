"""Cost of the shortest path among boxes (`navloom_optimal`), and how it grows with their number.

    python benchmarks/shortest_way.py [--json]

The worlds are scattered boxes, and walls with gaps. The lazy search is measured; up to 250 boxes also the search in the
graph of all tangents, which must find the same length. Times are CPU times, s; memory is the growth of the peak memory
of the process, MB.
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
from navloom_optimal.lazy_tangents import TangentSearch
from navloom_optimal.shape_space import ShapeSpace
from navloom_optimal.tangents import ShortestPath, shortest_among

__all__ = ["WORLDS", "measured"]

WHOLE_UP_TO = 250
"""Most boxes for which the graph of all tangents is also measured."""
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
    """Measure a world: length, m, time of the lazy search and of the whole graph, s, tangents examined, memory, MB."""
    boxes, edge = WORLDS[kind](count)
    shapes = shortest_path._shapes(list(boxes), Place(0.0, 0.0), RADIUS)
    ends = shortest_path._points(np.array([(-1.0, -1.0), (edge + 1.5, edge + 1.5)]))
    circles = shortest_path._joined(ends, shortest_path._shape_circles(shapes))
    before, began = _peak(), time.process_time()
    search = TangentSearch(circles, ShapeSpace(shapes))
    found = search.run()
    lazy, grown = time.process_time() - began, _peak() - before
    whole = None
    if count <= WHOLE_UP_TO:
        began = time.process_time()
        _agree(found, shortest_among(circles, ShapeSpace(shapes)))
        whole = time.process_time() - began
    length = None if found is None else found.length
    return {"world": kind, "boxes": len(boxes), "length_m": length, "lazy_s": lazy, "whole_s": whole,
            "looked_at": search.looked_at, "memory_mb": grown}  # fmt: skip


def _agree(one: ShortestPath | None, other: ShortestPath | None) -> None:
    lengths = [None if path is None else path.length for path in (one, other)]
    assert lengths[0] == lengths[1] or (one and other and abs(one.length - other.length) < 1e-9), lengths


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main() -> None:
    """Measure all worlds and print a table, or JSON."""
    shortest_path.warm_up()
    found = [measured(kind, count) for kind in WORLDS for count in (100, 250, 1000, 4000)]
    if "--json" in sys.argv[1:]:
        print(json.dumps(found))
        return
    print(f"{'world':<10} {'boxes':>5} {'lazy, s':>8} {'whole, s':>8} {'looked at':>9} {'memory, MB':>10}")
    for one in found:
        whole = "-" if one["whole_s"] is None else f"{one['whole_s']:.2f}"
        print(f"{one['world']:<10} {one['boxes']:>5} {one['lazy_s']:>8.2f} {whole:>8} {one['looked_at']:>9} "
              f"{one['memory_mb']:>10.0f}")  # fmt: skip


if __name__ == "__main__":
    main()
