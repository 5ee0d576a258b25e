"""Drives along paths of `hybrid_astar`, end to end: arrivals, contacts, time.

    python benchmarks/hybrid_drives.py [--drives 20] [--bodies long,car] [--controller NAME] [--set A.B=V …] [--json]

The bodies and queries are those of `hybrid_astar.py`, on storeys without unmapped furniture. The robot has the lag,
dead time and slip of `building`, a laser with noise, and a localizer that matches scans; the gate's monitor is on. The
controller drives the whole path (`navigation.handover = "never"`): an avoider knows nothing of cusps.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from typing import Any

from hybrid_astar import BODIES, Query, queries
from navloom.config import load_config
from navloom.runs.episode import run_episode

__all__ = ["driven"]

STEERED = (
    'robot.drive="ackermann"',
    "robot.wheelbase=0.5",
    "robot.max_steering_deg=34.5",  # a radius of 0.727 m: 1.1 times it is the car's 0.8 m
    "robot.max_steering_rate_deg=60",
)


def driven(body: str, query: Query, changes: Sequence[str] = ()) -> dict[str, Any]:
    """Drive one query: outcome, ticks in contact, least gap, m, way and planned way, m, duration, s, CPU time, s."""
    start, goal = (
        f"{{x={x!r},y={y!r},heading_deg={math.degrees(math.remainder(heading, math.tau))!r}}}"
        for x, y, heading in (query.start, query.goal)
    )
    settings = [
        f'world.ref="{query.world}"',
        f"navigation.start={start}",
        f"navigation.goal={goal}",
        'navigation.handover="never"',
        f"robot.footprint={{polygon={BODIES[body][0].tolist()}}}",
        "run.stop_after=400.0",
        'sensor=[{name="laser",kind="laser_2d",beams=361,field_of_view_deg=360,range_max=20.0,sigma=0.01}]',
        'localizer={plugin="scan_matching"}',
        'mapper={plugin="known_map"}',
        'planner={plugin="hybrid_astar"}',
        *(STEERED if body == "car" else ()),
        *changes,
    ]
    began = time.process_time()
    said = run_episode(load_config("building", settings, 1)).summary()
    told = {key: said[key] for key in ("outcome", "reason", "collisions", "min_clearance_m", "path_length_m",
                                       "plan_length_m", "sim_time_s")}  # fmt: skip
    return {"body": body, "world": query.world} | told | {"cpu_s": time.process_time() - began}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--drives", type=int, default=20)
    parser.add_argument("--bodies", default="long,car")
    parser.add_argument("--controller", default="lyapunov_tracker")
    parser.add_argument("--set", nargs="*", default=[])
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    for body in given.bodies.split(","):
        rows = []
        names = [f"floor:{seed}?unmapped=0" for seed in range(given.drives)]
        for query in queries(body, given.drives, names):
            rows.append(driven(body, query, [f'controller={{plugin="{given.controller}"}}', *given.set]))
            print(json.dumps(rows[-1]), flush=True)
        arrived = sum(row["outcome"] == "succeeded" for row in rows)
        told = {
            "body": body,
            "drives": len(rows),
            "arrived": arrived,
            "in contact": sum(row["collisions"] > 0 for row in rows),
        }
        print(json.dumps(told) if given.json else told, flush=True)


if __name__ == "__main__":
    main()
