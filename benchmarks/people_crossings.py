"""Crossings of recorded scenes against those who walk there, each avoider with and without tracks of `people_tracker`.

    python benchmarks/people_crossings.py people_dev.npz --out F.jsonl [--scenes hotel,zara01] [--crossings 100]

The robot is that of the config `explore`, at up to 1 m/s. It goes along the axis on which people walk, against the
direction of most of those who are there when it starts, from before one end of their area to beyond the other. The
crossings begin at times spread evenly over the recording. Arrived is by ground truth, within 0.5 m of the goal, without
a contact, and in three times the time of its distance at 1 m/s. The field is open, as in DynaBARN:
`localizer.lost_sigma` is 5 m, and the wheels do not slip. Results already in the file are not driven again.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from campaign import kept, rows_of, share
from dynabarn import METHODS
from navloom.config import load_config
from navloom.plugins import Discovery
from navloom.runs.episode import run_episode
from navloom.runs.metric_functions import others_contacts, own_contacts
from navloom.runs.metrics import all_metrics, measure

__all__ = ["crossings", "drive", "main", "table"]

CONDITIONS = ["localizer.lost_sigma=5", "platform.slip=0", "navigation.goal_tolerance=0.5"]
SPEED = 1.0
"""Highest speed of the robot, m/s: a brisk walk."""
OUTSIDE = 2.0
"""Distance of start and goal from the recorded area, m: at its ends, people begin out of nothing."""
SHOWN = tuple(name for name in METHODS if name not in ("standing", "blind"))
SOCIAL = ("intimate_time", "personal_time", "time_to_collision_min", "stopped_time")


def crossings(file: Path, scene: str, count: int) -> list[dict[str, float]]:
    """Starts and goals, m, and times, s, of the crossings of a scene."""
    data = np.load(file)
    times, people, places = (data[f"{scene}_{name}"] for name in ("t", "id", "xy"))
    ways = [places[people == one][[0, -1]] for one in np.unique(people)]
    axis = int(np.argmax(np.abs([end - start for start, end in ways]).mean(axis=0)))
    low, high = places[:, axis].min() - OUTSIDE, places[:, axis].max() + OUTSIDE
    middle = float(np.median(places[:, 1 - axis]))
    found = []
    for begin in np.linspace(times.min(), times.max() - 30.0, count).round(1).tolist():
        near = np.abs(times - begin) < 10.0
        there = [places[near & (people == one)][:, axis] for one in np.unique(people[near])]
        flow = sum(float(np.sign(way[-1] - way[0])) for way in there)
        ends = (high, low) if flow > 0.0 else (low, high)
        heading = 90.0 * axis + (180.0 if flow > 0.0 else 0.0)
        start, goal = ((end, middle) if axis == 0 else (middle, end) for end in ends)
        found.append({"t": begin, "x": start[0], "y": start[1], "heading": heading, "gx": goal[0], "gy": goal[1]})
    return found


def drive(work: tuple[str, str, str, dict[str, float], list[str]]) -> dict[str, Any]:
    """Drive one method across one scene; a drive that fails is a result too."""
    method, file, scene, task, changes = work
    row: dict[str, Any] = {"method": method, "scene": scene, "t": task["t"]}
    far = float(np.hypot(task["gx"] - task["x"], task["gy"] - task["y"]))
    settings = [
        f"world.ref=people:{file}#{scene}@{task['t']}",
        f"navigation.start={{x={task['x']},y={task['y']},heading_deg={task['heading']}}}",
        f"navigation.goal={{x={task['gx']},y={task['gy']}}}", f"robot.max_linear={SPEED}",
        f"run.stop_after={3.0 * far / SPEED}",
    ]  # fmt: skip
    try:
        episode = run_episode(load_config("explore", [*settings, *CONDITIONS, *METHODS[method], *changes]))
    except Exception as error:
        return {**row, "error": f"{type(error).__name__}: {error}"}
    wanted = [metric for metric in all_metrics(Discovery())[0] if metric.name in SOCIAL]
    said, measured = episode.summary(), measure(episode.trail, wanted)
    return {
        **row, "outcome": said["outcome"], "code": said["code"], "arrived": said["truly_reached"],
        "own": own_contacts(episode.trail), "others": others_contacts(episode.trail), "time_s": said["sim_time_s"],
        **{name: measured.get(name) for name in SOCIAL},
    }  # fmt: skip


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Shares with their exact 95 % intervals (Clopper and Pearson 1934), and medians of the social metrics."""
    lines = [f"| scene | method | crossings | arrived | own contact | other's contact | {' | '.join(SOCIAL)} |"]
    lines.append("|---" * (6 + len(SOCIAL)) + "|")
    for scene in dict.fromkeys(row["scene"] for row in rows):
        for method in SHOWN:
            found = [row for row in rows if (row["scene"], row["method"]) == (scene, method) and "error" not in row]
            if not found:
                continue
            shares = [
                share([bool(row["arrived"]) for row in found]),
                share([row["own"] > 0 for row in found]),
                share([row["others"] > 0 for row in found]),
            ]
            given = [[row[name] for row in found if row[name] is not None] for name in SOCIAL]
            shares += [f"{np.median(values):.2f}" if values else "-" for values in given]
            lines.append(f"| `{scene}` | `{method}` | {len(found)} | {' | '.join(shares)} |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive what is left of the campaign, and print its table; 1 if a drive failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="the recorded people, F.npz")
    parser.add_argument("--out", type=Path, required=True, help="file of results, which is continued")
    parser.add_argument("--scenes", default="hotel,zara01")
    parser.add_argument("--crossings", type=int, default=100)
    parser.add_argument("--methods", default=",".join(SHOWN))
    parser.add_argument("--set", action="append", default=[], metavar="A.B=V", help="for all methods alike")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args(arguments)
    methods, file = given.methods.split(","), given.file.resolve()
    if unknown := set(methods) - set(SHOWN):
        parser.error(f"--methods: {', '.join(sorted(unknown))}: expected some of {', '.join(SHOWN)}")
    rows = [row for row in kept(given.out) if "error" not in row]
    done = {(row["method"], row["scene"], row["t"]) for row in rows}
    tasks = [(scene, task) for scene in given.scenes.split(",") for task in crossings(file, scene, given.crossings)]
    left = [
        (method, str(file), scene, task, given.set)
        for scene, task in tasks
        for method in methods
        if (method, scene, task["t"]) not in done
    ]
    for number, row in enumerate(rows_of(drive, left, given.jobs, given.out), start=1):
        rows.append(row)
        said = row.get("error") or f"{row['outcome']} {row['code']}, arrived {row['arrived']}, own {row['own']:g}"
        print(
            f"{number} of {len(left)}: {row['method']} {row['scene']}@{row['t']}: {said}", file=sys.stderr, flush=True
        )
    print(table([row for row in rows if row["method"] in methods]))
    return int(any("error" in row for row in rows))


if __name__ == "__main__":
    sys.exit(main())
