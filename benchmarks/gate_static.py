"""Whether the gate's allowance for moving obstacles acts where nothing moves, and what its monitor costs.

    python benchmarks/gate_static.py [--config explore] [--set avoider.plugin=mppi …] WORLD … [--json]

A world is a reference as in a config: `barn:worlds.npz#1-50` and `floor:0-9` are several. Each is driven with
`gate.approach_speed = 0` and with its default. A row tells how each drive ended and after how long, for how many ticks
the monitor limited and stopped it, and whether both drives are equal bit for bit. At the end are the
processor's times of a tick of the monitor: all its scans, and its verdicts.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from typing import Any
from unittest.mock import patch

import numpy as np
from navloom.config import load_config
from navloom.engine import lockstep_builder
from navloom.messages import RangeScan, Twist2D
from navloom.navigation.collision_monitor import CollisionMonitor, MonitorLimits, Verdict
from navloom.runs.episode import run_episode
from navloom_study.study_worlds import expanded

__all__ = ["TimedMonitor", "drive", "main"]

SPEEDS = ("0", "2.0")
"""`gate.approach_speed` of the two drives."""


class TimedMonitor(CollisionMonitor):
    """A monitor that keeps the processor time of its ticks, µs, and counts those that limit or stop the robot."""

    def __init__(self, limits: MonitorLimits) -> None:
        super().__init__(limits)
        self.ticks: list[float] = []
        self.limited, self.stopped, self._looking = 0, 0, 0.0

    def look(self, name: str, scan: RangeScan) -> bool:
        """As a monitor."""
        start = time.thread_time()
        is_new = super().look(name, scan)
        self._looking += time.thread_time() - start
        return is_new

    def judge(self, twist: Twist2D, speed: float, time_s: float) -> Verdict:
        """As a monitor."""
        start = time.thread_time()
        verdict = super().judge(twist, speed, time_s)
        self.ticks.append(1e6 * (self._looking + time.thread_time() - start))
        self._looking = 0.0
        self.limited += bool(verdict.kind)
        self.stopped += verdict.is_stopped
        return verdict


def drive(config: str, changes: Sequence[str]) -> tuple[dict[str, Any], TimedMonitor]:
    """Drive a config once: what `result.json` would hold, and the monitor."""
    made: list[TimedMonitor] = []

    def monitor(limits: MonitorLimits) -> TimedMonitor:
        made.append(TimedMonitor(limits))
        return made[-1]

    with patch.object(lockstep_builder, "CollisionMonitor", monitor):
        episode = run_episode(load_config(config, list(changes)))
    return episode.summary(), made[-1]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; 1 if the robot was stopped more often with the allowance, or did not arrive as often."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="+")
    parser.add_argument("--config", default="explore")
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args(arguments)
    ticks: dict[str, list[float]] = {speed: [] for speed in SPEEDS}
    total: dict[str, dict[str, Any]] = {speed: {"reached": 0, "limited": 0, "stopped": 0} for speed in SPEEDS}
    worlds, equal = [world for named in given.worlds for world in expanded(named)], 0
    for world in worlds:
        row, traces = [], set()
        for speed, sums in total.items():
            result, monitor = drive(given.config, [*given.set, f"world.ref={world}", f"gate.approach_speed={speed}"])
            counts = {"reached": result["truly_reached"], "limited": monitor.limited, "stopped": monitor.stopped}
            for name, count in counts.items():
                sums[name] += count
            ticks[speed] += monitor.ticks
            traces.add(result["trace_sha256"])
            row.append(f"{result['outcome']} {result['sim_time_s']:.2f} s, {counts}")
        equal += len(traces) == 1
        if not given.json:
            print(world, *row, "equal" if len(traces) == 1 else "differ", sep=" | ", flush=True)
    for speed, sums in total.items():
        sums["tick_us"], sums["tick_us_p99"] = (round(float(us)) for us in np.percentile(ticks[speed], (50, 99)))
    summary = {"drives": len(worlds), "equal": equal, "approach_speed": total}
    print(json.dumps(summary) if given.json else f"{equal} of {len(worlds)} equal; by gate.approach_speed: {total}")
    off, on = total.values()
    return int(on["stopped"] > off["stopped"] or on["reached"] < off["reached"])


if __name__ == "__main__":
    sys.exit(main())
