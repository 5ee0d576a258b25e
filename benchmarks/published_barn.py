"""Published scores of the BARN challenge beside scores here under their conditions, and what each condition changes.

    python benchmarks/published_barn.py barn_dev.npz --out F.jsonl [--worlds 1-300] [--rows move_base,mppi] [--seeds 1]

A row is a method of `examples/barn_published.toml`, with changes of its config. Rows that begin with a method's name
and a plus differ from its row in one condition. Results already in the file are not driven again; one file holds the
drives of one version. Success is by ground truth and without a contact; the score is that of the challenge, the metric
`barn_2_8`. Intervals are bootstrap intervals over worlds, 95 %.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from campaign import kept, rows_of
from navloom.config import load_config
from navloom.plugins import Discovery
from navloom.runs.episode import run_episode
from navloom.runs.metrics import all_metrics, measure
from navloom_study.study_worlds import expanded

__all__ = ["PUBLISHED", "ROWS", "drive", "main", "table"]

CONFIG = Path(__file__).resolve().parent.parent / "examples" / "barn_published.toml"
MOTORS = ("platform.motor_time_constant", "robot.motor_lag"), ("platform.dead_time", "robot.dead_time")


def _motors(lag: float, dead_time: float) -> list[str]:
    """Changes of the motors, s, of which the plugins are told."""
    return [f"{place}={value}" for places, value in zip(MOTORS, (lag, dead_time), strict=True) for place in places]


SLOW = ["robot.max_linear=0.5", "robot.max_angular_deg=108.9", "robot.max_acceleration=3", "robot.max_deceleration=3"]
"""Limits of Nav2's MPPI controller, by its default file."""
ROWS: dict[str, tuple[str, list[str]]] = {
    "move_base": ("move_base", []),
    "dwa": ("dwa", []),
    "vfh_swept": ("vfh_swept", []),
    "mppi": ("mppi", SLOW),
    "move_base+ideal_motors": ("move_base", [*_motors(0.0, 0.0), "platform.slip=0"]),
    "move_base+slow_motors": ("move_base", _motors(0.3, 0.15)),
    "move_base+acceleration": ("move_base", ["robot.max_acceleration=10", "robot.max_deceleration=10"]),
    "move_base+controller_5_hz": ("move_base", ["avoider.rate_hz=5", "gate.stop_deadline=0.4"]),
    "move_base+planner_1_hz": ("move_base", ["navigation.replan_period=1.0"]),
    "move_base+less_inflation": ("move_base", ["planner.inflation_radius=0.22"]),
    "move_base+inflation_weight_2": ("move_base", ["avoider.obstacle=2.0"]),
    "move_base+inflation_weight_5": ("move_base", ["avoider.obstacle=5.0"]),
    "move_base+no_horizon": ("move_base", ["avoider.contact=0.5"]),
    "move_base+no_recovery": ("move_base", ["navigation.max_recoveries=0", "avoider.back_up=0"]),
    "move_base+shipped_checks": ("move_base", ["avoider.reacts=true", "avoider.roll_check=true"]),
    "mppi+ideal_motors": ("mppi", [*SLOW, *_motors(0.0, 0.0), "platform.slip=0"]),
}
FIT: dict[str, tuple[str, list[str]]] = {
    f"move_base+motors_{lag}_{dead_time}": ("move_base", _motors(lag, dead_time))
    for lag in (0.05, 0.1, 0.2, 0.4)
    for dead_time in (0.0, 0.05, 0.15)
    if (lag, dead_time) != (0.1, 0.05)
}
"""Motors to fit to the published times and score, by lag and dead time, s; `move_base` has those that are left out."""
ROWS |= FIT
PUBLISHED = {
    "move_base": "organisers' DWA, 50 worlds: .850 success, .056 contacts, .159 [.143, .174], 21.6/31.5/53.2 s",
    "vfh_swept": "winner of 2026, VFH*, 50 worlds: .482, about 9.8 s",
    "mppi": "Nav2's MPPI, 8 worlds: .756 success, 0 contacts, .105 [.093, .116], 34/46/84 s",
}


def drive(work: tuple[str, str, int]) -> dict[str, Any]:
    """Drive one row in one world with one seed; a drive that fails is a result too."""
    name, world, seed = work
    method, changes = ROWS[name]
    row: dict[str, Any] = {"row": name, "world": world, "seed": seed}
    begun = time.process_time()
    try:
        loaded = load_config(str(CONFIG), [f"world.ref={world}", *changes], seed=seed, method=method)
        episode = run_episode(loaded)
    except Exception as error:
        return {**row, "error": f"{type(error).__name__}: {error}"}
    wanted = [metric for metric in all_metrics(Discovery())[0] if metric.name in ("barn_2_8", "time")]
    said = episode.summary()
    return {
        **row, "outcome": said["outcome"], "reason": said["reason"], "arrived": said["truly_reached"],
        "contacts": said["collisions"], **measure(episode.trail, wanted), "ended_s": said["sim_time_s"],
        "recoveries": said["recoveries"], "clearance": said["min_clearance_m"], "cpu_s": time.process_time() - begun,
    }  # fmt: skip


def interval(worlds: Sequence[str], values: Sequence[float]) -> tuple[float, float, float]:
    """Mean, and its 95 % interval by a bootstrap over worlds: the drives of one world are not independent."""
    given, drives = np.array(worlds), np.array(values, dtype=float)
    by_world = [drives[given == world].mean() for world in sorted(set(worlds))]
    rng = np.random.default_rng(0)
    means = rng.choice(by_world, (10_000, len(by_world))).mean(axis=1)
    return float(np.mean(by_world)), *(float(bound) for bound in np.percentile(means, (2.5, 97.5)))


def table(rows: Sequence[dict[str, Any]]) -> str:
    """A line a row."""
    head = ("row", "drives", "success", "contact", "time-out", "stuck", "score", "time if arrived, 5/50/95 %, s")
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for name in ROWS:
        found = [row for row in rows if row["row"] == name and "error" not in row]
        if not found:
            continue
        worlds = [row["world"] for row in found]
        reached = [bool(row["arrived"] and not row["contacts"]) for row in found]
        said = [f"`{name}`", str(len(found)), _share(worlds, reached)]
        said.append(_share(worlds, [row["contacts"] > 0 for row in found]))
        ends = [row["outcome"] for row in found]
        said += [f"{ends.count('timeout') / len(found):.3f}", f"{ends.count('stuck') / len(found):.3f}"]
        said.append(_share(worlds, [row["barn_2_8"] for row in found]))
        times = [row["time"] for row, is_reached in zip(found, reached, strict=True) if is_reached]
        said.append("/".join(f"{t:.1f}" for t in np.percentile(times, (5, 50, 95))) if times else "-")
        lines.append(f"| {' | '.join(said)} |")
    return "\n".join(lines)


def _share(worlds: Sequence[str], values: Sequence[float]) -> str:
    return "{:.3f} [{:.3f}, {:.3f}]".format(*interval(worlds, values))


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive what is left of the campaign, and print its table; 1 if a drive failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", help="the worlds, F.npz")
    parser.add_argument("--out", type=Path, required=True, help="file of results, which is continued")
    parser.add_argument("--worlds", default="0-299", help="numbers of worlds; those that the file has are taken")
    parser.add_argument("--every", type=int, default=1, help="only each of this many of these worlds")
    parser.add_argument("--rows", default=",".join(ROWS))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args(arguments)
    names = given.rows.split(",")
    if unknown := set(names) - set(ROWS):
        parser.error(f"--rows: {', '.join(sorted(unknown))}: expected some of {', '.join(ROWS)}")
    worlds = expanded(f"barn:{Path(given.file).resolve()}#{given.worlds}")[:: given.every]
    rows = [row for row in kept(given.out) if "error" not in row]
    done = {(row["row"], row["world"], row["seed"]) for row in rows}
    work = [(name, world, seed) for name in names for seed in range(given.seeds) for world in worlds]
    left = [piece for piece in work if piece not in done]
    for number, row in enumerate(rows_of(drive, left, given.jobs, given.out), start=1):
        rows.append(row)
        said = row.get("error") or f"{row['outcome']}, {row['ended_s']:.1f} s"
        where = f"{row['row']} {row['world'].rpartition('#')[2]}"
        print(f"{number} of {len(left)}: {where}: {said}", file=sys.stderr, flush=True)
    wanted = [row for row in rows if (row["row"], row["world"], row["seed"]) in set(work)]
    print(table(wanted))
    for name in names:
        if name in PUBLISHED:
            print(f"Published beside {name}: {PUBLISHED[name]}")
    return int(any("error" in row for row in wanted))


if __name__ == "__main__":
    sys.exit(main())
