"""Many robots in one simulated world, in lockstep: speed, CPU time, memory, and where a tick goes.

    python benchmarks/one_world.py [--robots 20] [--world REF] [--avoider NAME] [--seconds 20] [--profile] [--json]

Every robot is a member with the stack of `building`; starts and goals are drawn on the map, apart from each other.
README.md beside this file explains the figures.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import math
import os
import pstats
import resource
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from localising_scenes import ground_of
from navloom.plugins import Discovery
from navloom.runs.fleet import load_fleet, run_fleet

__all__ = ["fleet_text", "measured"]

WORLD = "floor:1?size=40x30&unmapped=0"
APART = 2.0
"""Least distance between two starts, and between two goals, m."""
HEAD = """
[run]
seed = 1
stop_after = {seconds}
[world]
ref = "{world}"
[avoider]
plugin = "{avoider}"
"""
MEMBER = """
[[member]]
name = "r{number}"
config = "building"
start = {{ x = {x}, y = {y}, heading_deg = {turn} }}
set = {{ navigation.goal = {{ x = {to_x}, y = {to_y} }} }}
"""


def fleet_text(robots: int, world: str, avoider: str, seconds: float, seed: int = 0) -> str:
    """The config of a fleet whose robots drive from anywhere to anywhere on a storey."""
    draw = np.random.default_rng(seed)
    ground = ground_of(Discovery().world(world, Path.cwd()))
    cells = [ground.at(cell) for cell in draw.permutation(ground.places)]
    starts, goals = _apart(iter(cells), robots), _apart(iter(reversed(cells)), robots)
    members = [
        MEMBER.format(number=number, x=x, y=y, turn=round(math.degrees(math.atan2(to_y - y, to_x - x)), 1), to_x=to_x, to_y=to_y)
        for number, ((x, y), (to_x, to_y)) in enumerate(zip(starts, goals, strict=True))
    ]
    return HEAD.format(seconds=seconds, world=world, avoider=avoider) + "".join(members)


def _apart(places: Iterator[tuple[float, float]], count: int) -> list[tuple[float, float]]:
    found: list[tuple[float, float]] = []
    for place in places:
        if all(math.dist(place, other) >= APART for other in found):
            found.append(place)
            if len(found) == count:
                return found
    raise SystemExit(f"one_world: the world has no room for {count} robots {APART} m apart: expected a larger one")


def measured(path: str) -> dict[str, Any]:
    """Run a fleet once: its hash, seconds of robot time per second, CPU time per simulated second, and memory."""
    members = load_fleet(path)
    ready = time.process_time()
    fleet = run_fleet(members)
    prepared = time.process_time() - ready
    said = fleet.summary()
    ticks = [sum(per) for per in zip(*(episode.log.tick_ns for episode in fleet.episodes.values()))]
    simulated = max(episode.log.ticks for episode in fleet.episodes.values()) * members[0].config.run.period
    return {
        "robots": len(members),
        "simulated_s": simulated,
        "wall_s": round(fleet.wall_ns * 1e-9, 3),
        "times_real": round(simulated / (fleet.wall_ns * 1e-9), 3),
        "cpu_s": round(prepared, 2),
        "tick_ms_p50": round(1e-6 * sorted(ticks)[len(ticks) // 2], 2) if ticks else None,
        "peak_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
        "reached": said["reached"],
        "collisions": said["collisions"],
        "load": os.getloadavg()[0],
        "trace_sha256": said["trace_sha256"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--world", default=WORLD)
    parser.add_argument("--avoider", default="improved_vfh")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--profile", action="store_true", help="print where the time of the run goes")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fleet.toml"
        path.write_text(fleet_text(given.robots, given.world, given.avoider, given.seconds), "utf-8")
        profile = cProfile.Profile()
        if given.profile:
            profile.enable()
        found = measured(str(path))
        profile.disable()
    print(json.dumps(found) if given.json else "\n".join(f"{name:14}{value}" for name, value in found.items()))
    if given.profile:
        pstats.Stats(profile).sort_stats("tottime").print_stats(60)


if __name__ == "__main__":
    main()
