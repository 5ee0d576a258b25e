"""Many robots in one simulated world, in lockstep: speed, CPU time of their steps by role, memory.

    python benchmarks/one_world.py [--robots 20] [--processes 1,2] [--world REF] [--seconds 20] [--json]

Every robot is a member with the stack of `building`; starts and goals are drawn on the map, apart from each other.
README.md beside this file explains the figures.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from fleet import memory
from localising_scenes import ground_of
from navloom.plugins import Discovery
from navloom.runs.fleet import load_fleet, run_fleet

__all__ = ["fleet_text", "measured"]

WORLD = "floor:1?size=40x30&unmapped=0"
APART = 2.0
"""Least distance between two starts, and between two goals, m."""
INTERVAL = 2.0
"""Least time between two looks at the memory, s; a run must take longer."""
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
        MEMBER.format(
            number=number, x=x, y=y, to_x=to_x, to_y=to_y, turn=round(math.degrees(math.atan2(to_y - y, to_x - x)), 1)
        )
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


def measured(path: str, processes: int) -> dict[str, Any]:
    """Run a fleet once: its hash, times of the run and of its steps, and memory."""
    members, held = load_fleet(path), [0.0]
    began = told = time.perf_counter()

    def look(done: float, total: float) -> None:
        nonlocal told
        # Now and then: to add up the pages of a process takes as long as some ticks.
        if time.perf_counter() - told > INTERVAL:
            pids = [os.getpid(), *(child.pid for child in multiprocessing.active_children() if child.pid is not None)]
            held.append(memory(pids))
            told = time.perf_counter()

    fleet = run_fleet(members, processes=processes, progress=look)
    took, logs = time.perf_counter() - began, [episode.log for episode in fleet.episodes.values()]
    ticks = sum(log.ticks for log in logs)
    simulated = max(log.ticks for log in logs) * members[0].config.run.period
    by_role: Counter[str] = Counter()
    for log in logs:
        for (role, _), steps in log.computed_ns.items():
            by_role[role] += sum(steps)
    return {
        "robots": len(members),
        "processes": processes,
        "simulated_s": round(simulated, 2),
        "prepared_s": round(took - fleet.wall_ns * 1e-9, 2),
        "times_real": round(simulated / (fleet.wall_ns * 1e-9), 2),
        "cpu_per_simulated": round(by_role.total() * 1e-9 / simulated, 3),
        "us_a_tick": {role: round(spent * 1e-3 / ticks, 1) for role, spent in by_role.most_common()},
        "pss_mb": round(max(held)),
        "load": round(os.getloadavg()[0], 1),
        "trace_sha256": fleet.trace_sha256,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--world", default=WORLD)
    parser.add_argument("--avoider", default="improved_vfh")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--processes", default="1", metavar="N,N", help="numbers of processes, in turn")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fleet.toml"
        path.write_text(fleet_text(given.robots, given.world, given.avoider, given.seconds), "utf-8")
        for processes in map(int, given.processes.split(",")):
            found = measured(str(path), processes)
            told = json.dumps(found) if given.json else "\n".join(f"{name:18}{value}" for name, value in found.items())
            print(told, flush=True)


if __name__ == "__main__":
    main()
