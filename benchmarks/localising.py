"""Closed-loop campaign of localizers: found from anywhere, wrong starts, kidnapped, unmapped things, odometry faults.

    python benchmarks/localising.py [--localizer global_matching] [--parts global,kidnapped,...]
        [--maps willow,house,floors] [--floors 1000:1010] [--count 50] [--peer] [--set A.B=V] [--jobs 2]
        [--out F.jsonl] [--json]

Each drive is a run of `building` in lockstep with a start, a goal 6 to 20 m away and at most 120 s, drawn from its
part, map and number, so that two versions of navloom get the same drives.

global       The start is unknown. On the floors `--count` is shared among them.
wrong_start  Believed exactly, and wrong by 1 m and 30 degrees.
kidnapped    Carried off after 8 s to a place at least 2.5 m from its way.
unmapped     Pallets, trolleys and people beside the way hide 30 to 70 % of some view.
turn         The odometry turns by 12 to 30 degrees in a step.
spin         The wheels turn for 2 s and the robot does not.
drag         The robot is dragged back by 1.3 m.
aisle        Bare aisles between racks of 24 m, with a laser that reaches 8 m.

With `--out`, results are added to a file of JSON lines, and drives that it holds are not driven again. With `--peer`,
the package `amcl`, where it is installed, gets the same scans, odometry, map and spread of the start.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from campaign import kept, rows_of
from localising_scenes import AT, CARRIED, PARTS, Scene, Task, alike, scene_of
from navloom.config import load_config
from navloom.geometry.world import Place
from navloom.runs.episode import Episode, run_episode
from navloom.runs.localization import FALSE, Localization
from navloom.runs.metrics import measure

__all__ = ["drive", "main", "table", "tasks"]

STREAMS = (("localizer", "pose"), ("platform", "laser"), ("platform", "odometry"))
LIMIT = 120.0
"""Longest drive, s."""
NOTICED = 5.0
"""Time of motion within which a disturbance has to be noticed, s."""
COUNTS = {
    "global": 50, "wrong_start": 100, "kidnapped": 50, "unmapped": 200, "turn": 20, "spin": 20, "drag": 20,
    "aisle": 20,
}  # fmt: skip
"""Drives of the whole campaign: for `global` on each map, where the floors are one; otherwise shared by the maps."""
METRICS = (
    "success", "false_success", "found_time", "found_distance", "not_tracking_time", "false_tracking_time", "jump_max",
    "jumps", "within_3_sigma", "sigma_median", "heading_sigma_median", "pose_error_rms", "pose_error_max",
    "pose_heading_rms", "cross_track_rms", "collisions", "path_length",
)  # fmt: skip


def tasks(parts: Sequence[str], maps: Sequence[str], floors: Sequence[str], count: int | None) -> Iterator[Task]:
    """The drives of the campaign."""
    for part in parts:
        number = COUNTS[part] if count is None else count
        if part == "aisle":
            yield from (Task(part, "aisles", index) for index in range(number))
        elif part == "global":
            for name in maps:
                names = floors if name == "floors" else [name]
                yield from (Task(part, names[index % len(names)], index) for index in range(number))
        else:
            names = [*(name for name in maps if name != "floors"), *(floors if "floors" in maps else ())]
            yield from (Task(part, names[index % len(names)], index) for index in range(number))


def drive(task: Task, localizer: str, changes: Sequence[str] = (), peer: bool = False) -> dict[str, Any]:
    """Drive one scene: how it ended, the metrics, and what its part asks for."""
    begun, used = time.perf_counter(), time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        scene = scene_of(task, Path(folder))
        loaded = load_config("building", [*scene.changes, f"localizer.plugin={localizer}", *changes])
        episode = run_episode(loaded, reads=STREAMS)
        trail = episode.trail
        found = measure(trail)
        row: dict[str, Any] = {
            "key": task.key, "part": task.part, "map": task.map, "localizer": localizer, "outcome": trail.outcome,
            "reason": trail.reason, "seconds": trail.duration, **{name: found[name] for name in METRICS},
            "lost_while_right": _lost_while_right(episode), **_of_part(task, scene, episode),
        }  # fmt: skip
        if peer:
            from amcl_peer import follow

            row["amcl"] = follow(episode, scene.start if task.part != "global" else None)
    row |= {"wall_s": time.perf_counter() - begun, "cpu_s": time.process_time() - used}
    return {name: _rounded(value) for name, value in row.items()}


def _rounded(value: Any) -> Any:
    return round(value, 4) if isinstance(value, float) else value


def _lost_while_right(episode: Episode) -> float:
    """Time in which the localizer says lost and is less than 0.1 m off, s."""
    known, states = episode.trail.localization, {}
    for _, said in episode.trail.streams.get(("localizer", "pose"), ()):
        states[said.stamp_ns * 1e-9] = said.state  # type: ignore[attr-defined]
    lost = np.array([states.get(at) == "lost" for at in known.time.tolist()], dtype=np.bool_)
    return float(known.spans[lost & (known.error < 0.1)].sum()) if lost.size else 0.0


def _of_part(task: Task, scene: Scene, episode: Episode) -> dict[str, Any]:
    """What only some parts have."""
    known = episode.trail.localization
    if task.part == "global":
        twins = alike(task, scene.start)
        return {"alike": bool(twins), "false_at_alike": _at_a_twin(known, task)}
    if task.part == "unmapped":
        return {"covered": round(scene.covered, 3)}
    if task.part in ("kidnapped", "turn", "spin", "drag"):
        return _after(known, AT if task.part == "turn" else AT + CARRIED) | {"false_at_alike": _at_a_twin(known, task)}
    return {}


def _at_a_twin(known: Localization, task: Task) -> bool:
    """Whether a false pose was one from which a look-alike room looks the same as from the true one."""
    wrong = np.flatnonzero(known.is_tracking & (known.error > FALSE))
    if not len(wrong):
        return False
    middle = int(wrong[len(wrong) // 2])
    x, y, _ = known.estimate[middle].tolist()
    twins = alike(task, Place(*known.truth[middle].tolist()))
    return any(math.dist((x, y), (twin.x, twin.y)) < 1.0 for twin in twins)


def _after(known: Localization, end: float) -> dict[str, Any]:
    """How a localizer recovered from a disturbance that ended at a run time, s.

    Returns:
        noticed_s: Time of motion in which the localizer tracked falsely after it, s: until it noticed or was right.
        found_again_s: Time until lasting true tracking, s; None if it never came.
        end_error_m: Error at the end of the drive.
    """
    rows = known.time >= end
    if not rows.any():
        return {"noticed_s": None, "found_again_s": None, "end_error_m": None}
    after = Localization(*(getattr(known, name)[rows] for name in known.__dataclass_fields__))
    is_false = after.is_tracking & ((after.error > FALSE) | (after.turn_error > math.radians(15.0)))
    until = len(is_false) if is_false.all() else int(np.argmin(is_false))
    again = after.found_at
    return {
        "noticed_s": round(float(after.spans[:until][after.is_moving[:until]].sum()), 3),
        "found_again_s": None if again is None else round(float(after.time[again] - end), 3),
        "end_error_m": round(float(after.error[-1]), 4),
    }


def table(rows: Sequence[dict[str, Any]]) -> str:
    """What the campaign must show, by part and map; look-alikes apart."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in rows:
        name = "floors" if row["map"].startswith("floor:") else row["map"]
        groups.setdefault((row["part"], f"{name} alike" if row.get("alike") else name), []).append(row)
    lines = [f"{'part':12}{'map':14}"]
    for (part, name), of in sorted(groups.items(), key=lambda item: (PARTS.index(item[0][0]), item[0][1])):
        cells = _cells(of)
        lines[0] = lines[0][:26] + "".join(f"{title:>11}" for title in cells)
        lines.append(f"{part:12}{name:14}" + "".join(f"{cell:>11}" for cell in cells.values()))
    return "\n".join(lines)


def _cells(rows: Sequence[dict[str, Any]]) -> dict[str, str]:
    found = [row for row in rows if row["found_time"] is not None and row["found_time"] < LIMIT]
    disturbed = [row for row in rows if "found_again_s" in row]

    def counted(holds: Callable[[dict[str, Any]], bool], of: Sequence[dict[str, Any]] = rows) -> str:
        return str(sum(map(holds, of))) if of else "-"

    def middle(name: str, of: Sequence[dict[str, Any]] = rows) -> str:
        values = [row[name] for row in of if row[name] is not None]
        return f"{np.median(values):.3g}" if values else "-"

    within = [row["within_3_sigma"] for row in rows if row["within_3_sigma"] is not None]
    return {
        "drives": str(len(rows)),
        "reached": counted(lambda row: row["success"] == 1.0),
        "found": str(len(found)),
        "false": counted(lambda row: (row["false_tracking_time"] or 0.0) > 0.0 and not row.get("false_at_alike")),
        "contact": counted(lambda row: row["collisions"] > 0),
        "lost right": counted(lambda row: row["lost_while_right"] > 0.0),
        "noticed": counted(lambda row: row["noticed_s"] is not None and row["noticed_s"] <= NOTICED, disturbed),
        "again": counted(lambda row: row["found_again_s"] is not None, disturbed),
        "time s": middle("found_time", found),
        "way m": middle("found_distance", found),
        "3 sigma": f"{np.mean(within):.4f}" if within else "-",
        "sigma m": middle("sigma_median"),
        "rms m": middle("pose_error_rms"),
    }


def _work(given: tuple[Task, str, Sequence[str], bool]) -> dict[str, Any]:
    task, localizer, changes, peer = given
    try:
        return drive(task, localizer, changes, peer)
    # A drive that fails is a result: the others go on.
    except Exception as error:
        return {"key": task.key, "part": task.part, "map": task.map, "error": f"{type(error).__name__}: {error}"}


def main() -> int:
    """Run what is left of the campaign, and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--localizer", default="global_matching")
    parser.add_argument("--parts", default=",".join(PARTS))
    parser.add_argument("--maps", default="willow,house,floors")
    parser.add_argument("--floors", default="1000:1010", metavar="A:B", help="seeds of the floors")
    parser.add_argument("--count", type=int, help="drives of each part (and map); default: the whole campaign's")
    parser.add_argument("--peer", action="store_true", help="also amcl on the same scans")
    parser.add_argument("--set", action="append", default=[], metavar="A.B=V")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, help="file of results, which is continued")
    parser.add_argument("--json", action="store_true", help="print each result, no table")
    given = parser.parse_args()
    first, end = map(int, given.floors.split(":"))
    floors = [f"floor:{seed}" for seed in range(first, end)]
    rows = kept(given.out)
    done = {row["key"] for row in rows}
    parts = given.parts.split(",")
    if unknown := set(parts) - set(PARTS):
        parser.error(f"--parts: {', '.join(sorted(unknown))}: expected some of {', '.join(PARTS)}")
    wanted = list(tasks(parts, given.maps.split(","), floors, given.count))
    left = [(task, given.localizer, given.set, given.peer) for task in wanted if task.key not in done]
    begun = time.perf_counter()
    for number, row in enumerate(rows_of(_work, left, given.jobs, given.out), start=1):
        rows.append(row)
        if given.json:
            print(json.dumps(row), flush=True)
        said = row.get("error") or f"{row['outcome']}, {row['wall_s']:.1f} s"
        spent = time.perf_counter() - begun
        print(f"{number} of {len(left)}, {spent:.0f} s: {row['key']}: {said}", file=sys.stderr, flush=True)
    keys = {task.key for task in wanted}
    finished = [row for row in rows if row["key"] in keys and "error" not in row]
    if not given.json:
        print(table(finished))
    return int(len(finished) < len(wanted) or any(row["collisions"] > 0 for row in finished))


if __name__ == "__main__":
    sys.exit(main())
