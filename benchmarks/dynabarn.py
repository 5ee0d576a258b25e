"""Avoiders among the moving cylinders of DynaBARN, each with and without the tracks of `people_tracker`.

    python benchmarks/dynabarn.py F.npz --out F.jsonl [--worlds 5] [--phases 2] [--methods orca+tracks,mppi] [--jobs 2]

The conditions are the organisers' (Nair et al. 2022): from (11, 0) to within 1 m of (-9, 0) in 100 s, each world at
several phases of its obstacles. Robot, motors, noise and localizer are those of the config `explore`: BARN's Jackal at
2 m/s. The field is open: wheels alone carry the pose, 20 m far, where nothing that stands is in sight, so the localizer
may be less sure of it than in rooms (CONDITIONS). A run ends with the first contact. Two rows are no avoiders:
`standing` never moves, and `blind` drives straight on at 2 m/s without the gate's monitor. Arrived is by ground truth.
Results already in the file are not driven again.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from campaign import kept, rows_of, share
from navloom.config import load_config
from navloom.runs.episode import run_episode
from navloom.runs.metric_functions import others_contacts, own_contacts
from navloom_maps.dynabarn import dynabarn_numbers

__all__ = ["METHODS", "drive", "main", "table"]

TRACKERS = "node=[{name='people',plugin='people_tracker'}]"
READERS = ("orca", "dwa", "mppi")
"""Avoiders that read tracks."""
OTHERS = ("improved_vfh", "vfh", "vfh_plus", "vfh_star", "vfh_swept", "vff")
METHODS: dict[str, list[str]] = {
    "standing": ["event=[{at=0,do='stop'}]"],
    "blind": [
        "navigation.handover=never",
        "navigation.replan_period=0",
        "navigation.speed=[2.0,2.0]",
        "gate.monitor=false",
    ],
    **{name: [f"avoider.plugin={name}"] for name in (*READERS, *OTHERS)},
    **{f"{name}+tracks": [f"avoider.plugin={name}", TRACKERS] for name in READERS},
}
CONDITIONS = ["localizer.lost_sigma=5"]
PHASES = (0.0, 7.5, 15.0, 22.5, 30.0)
"""How long the obstacles have moved before the run, s."""


def drive(work: tuple[str, str, list[str]]) -> dict[str, Any]:
    """Drive one method in one world, with changes of the config; a drive that fails is a result too."""
    method, world, changes = work
    row: dict[str, Any] = {"method": method, "world": world}
    begun = time.perf_counter()
    try:
        episode = run_episode(load_config("explore", [f"world.ref={world}", *CONDITIONS, *METHODS[method], *changes]))
    except Exception as error:
        return {**row, "error": f"{type(error).__name__}: {error}"}
    said = episode.summary()
    return {
        **row, "outcome": said["outcome"], "code": said["code"], "arrived": said["truly_reached"],
        "own": own_contacts(episode.trail), "others": others_contacts(episode.trail), "time_s": said["sim_time_s"],
        "goal_error_m": said["goal_error_m"], "pose_error_m": said["pose_error_m"]["max"],
        "gate_stops": said["gate_stops"], "wall_s": time.perf_counter() - begun,
    }  # fmt: skip


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Shares with their exact 95 % intervals (Clopper and Pearson 1934), a line a method."""
    lines = [
        "| method | runs | arrived | own contact | other's contact | false arrival | other ends | time if arrived, s |"
    ]
    lines.append("|---" * 8 + "|")
    for method in METHODS:
        found = [row for row in rows if row["method"] == method and "error" not in row]
        if not found:
            continue
        arrived = [bool(row["arrived"]) for row in found]
        own, others = [row["own"] > 0 for row in found], [row["others"] > 0 for row in found]
        false = [row["outcome"] == "succeeded" and not row["arrived"] for row in found]
        rest: dict[str, int] = {}
        for row in found:
            if row["outcome"] not in ("succeeded", "collision"):
                rest[row["code"] or row["outcome"]] = rest.get(row["code"] or row["outcome"], 0) + 1
        times = [row["time_s"] for row in found if row["arrived"]]
        ends = ", ".join(f"{count} {code}" for code, count in sorted(rest.items())) or "-"
        middle = f"{np.median(times):.1f}" if times else "-"
        lines.append(
            f"| `{method}` | {len(found)} | {share(arrived)} | {share(own)} | {share(others)} | {sum(false)} | {ends} "
            f"| {middle} |"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive what is left of the campaign, and print its table; 1 if a drive failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", help="the worlds, F.npz")
    parser.add_argument("--out", type=Path, required=True, help="file of results, which is continued")
    parser.add_argument("--worlds", type=int, help="this many worlds, evenly from all")
    parser.add_argument("--phases", type=int, default=len(PHASES))
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--set", action="append", default=[], metavar="A.B=V", help="for all methods alike")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args(arguments)
    methods = given.methods.split(",")
    if unknown := set(methods) - set(METHODS):
        parser.error(f"--methods: {', '.join(sorted(unknown))}: expected some of {', '.join(METHODS)}")
    file = Path(given.file).resolve()
    numbers = dynabarn_numbers(str(file), Path())
    some = np.linspace(0, len(numbers) - 1, given.worlds or len(numbers)).round().astype(int)
    worlds = [f"dynabarn:{file}#{numbers[k]}@{phase}" for k in some for phase in PHASES[: given.phases]]
    rows = [row for row in kept(given.out) if "error" not in row]
    done = {(row["method"], row["world"]) for row in rows}
    left = [(method, world, given.set) for world in worlds for method in methods if (method, world) not in done]
    begun = time.perf_counter()
    for number, row in enumerate(rows_of(drive, left, given.jobs, given.out), start=1):
        rows.append(row)
        spent = time.perf_counter() - begun
        said = row.get("error") or f"{row['outcome']} {row['code']}, arrived {row['arrived']}, own {row['own']:g}"
        ahead = spent / number * (len(left) - number)
        where = f"{row['method']} {row['world'].rpartition('#')[2]}"
        print(f"{number} of {len(left)}, {ahead:.0f} s left: {where}: {said}", file=sys.stderr, flush=True)
    wanted = [row for row in rows if row["method"] in methods and row["world"] in worlds]
    print(table(wanted))
    return int(any("error" in row for row in wanted))


if __name__ == "__main__":
    sys.exit(main())
