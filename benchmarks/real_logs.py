"""Localizers on real CARMEN logs, open loop, over maps that leave out what is localised.

    python benchmarks/real_logs.py LOG... [--localizers odometry,scan_matching] [--leave-out alternate,first_half]
        [--relations F] [--faults turn,spin,drag,gap] [--places 5] [--unknown] [--set A=V] [--json]

The logs' poses come from a particle filter: they make the maps and are the reference, some centimetres off themselves.
Two ways to leave out: `alternate` maps every second scan and localises with the others, over the whole log;
`first_half` maps the scans of the first half and localises the second half: `covered` is the share of it that lies in
free space of that map. Odometry is the raw one; where a log has none, see `log_drives.read`.

Faults are made in the odometry where the robot drives, over the map of every second scan, each in a part of the log of
its own that begins 20 s before it and ends 100 s after it. `turn` steps the heading by 12 to 30 degrees, `spin` turns
the wheels for 2 s at 0.5 m/s, `drag` moves the robot by 1.3 m without its wheels, `gap` is 10 s without any message.
`--unknown` starts such parts without a pose.

Credit for the logs: Radish, D. Haehnel, C. Stachniss and others.
"""

from __future__ import annotations

import argparse
import gzip
import json
import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from log_drives import FAULTS, LogDrive, drive, faulty, map_of, read
from navloom import ANYWHERE, OccupancyGrid
from navloom.geometry.frames import compose, inverse
from navloom.messages import PoseEstimate
from navloom.runs.localization import Localization
from numpy.typing import NDArray

__all__ = ["covered", "kuemmerle", "left_out", "main", "report"]

Floats = NDArray[np.float64]
INTEL_EPOCH = 976052857.337
"""Time of the Intel log at its zero, s since 1970, in its relations."""
BEFORE, AFTER = 20.0, 100.0
"""Part of the log round a made fault, s."""
NOTICED = (0.5, math.radians(15.0))
"""Error from which a fault has to be noticed, m and rad."""


def left_out(log: LogDrive, way: str) -> tuple[OccupancyGrid, LogDrive]:
    """A map, and the part of the log that it leaves out."""
    if way == "alternate":
        return map_of(log, log.scans[::2]), replace(log, scans=log.scans[1::2])
    half = len(log.scans) // 2
    middle_ns = log.scans[half].stamp_ns
    return map_of(log, log.scans[:half]), log.between(middle_ns, log.scans[-1].stamp_ns)


def covered(known: OccupancyGrid, truth: Floats) -> float:
    """Share of (n, 3) poses that lie in free cells of a map without a turn."""
    columns, rows = ((truth[:, :2] - (known.origin.x, known.origin.y)) / known.resolution).astype(int).T
    inside = (rows >= 0) & (rows < known.cells.shape[0]) & (columns >= 0) & (columns < known.cells.shape[1])
    return round(float((known.cells[rows[inside], columns[inside]] == 0).sum() / len(truth)), 3)


def report(found: Localization, said: list[PoseEstimate]) -> dict[str, Any]:
    """How good the poses of one drive are."""
    tracked = found.is_tracking
    error, turn = found.error[tracked], np.degrees(found.turn_error[tracked])
    end_is_true = found.error[-1] <= NOTICED[0] and found.turn_error[-1] <= NOTICED[1]
    state = said[-1].state
    return {
        "seconds": round(float(found.time[-1]), 1),
        "end": state if state != "tracking" else "tracking" if end_is_true else "false",
        "end_error_m": round(float(found.error[-1]), 3),
        "error_m": _spread(error),
        "turn_error_deg": _spread(turn),
        "not_tracking_s": round(found.not_tracking, 1),
        "false_tracking_s": round(found.false_tracking, 1),
        "within_3_sigma": round(float(found.is_within[tracked].mean()), 4) if tracked.any() else None,
        "sigma_m": round(float(np.median(found.sigma[tracked])), 4) if tracked.any() else None,
        "jump_max_m": round(float(found.jumps.max()), 3) if len(found.jumps) else 0.0,
    }


def _spread(values: Floats) -> dict[str, float]:
    """Median, 95th percentile and maximum."""
    if not len(values):
        return {}
    names = ("median", "p95", "max")
    return {name: round(float(np.percentile(values, q)), 3) for name, q in zip(names, (50, 95, 100), strict=True)}


def kuemmerle(found: Localization, first_ns: int, relations: Path, epoch: float) -> dict[str, Any]:
    """Kuemmerle et al. 2009: mean and standard deviation of the errors of relations between pairs of poses.

    Args:
        found: Poses; those of relations beyond their time are not used.
        first_ns: Stamp of the first pose, ns.
        relations: Lines `t1 t2 x y z roll pitch yaw`, s, m, rad.
        epoch: What the log's times lack to those of the relations, s.
    """
    with gzip.open(relations, "rt") if relations.suffix == ".gz" else relations.open() as file:
        rows = np.array([[float(word) for word in line.split()] for line in file if line.strip()])
    times = found.time + first_ns * 1e-9 + epoch
    inside = ((rows[:, :2] >= times[0] - 0.1) & (rows[:, :2] <= times[-1] + 0.1)).all(axis=1)
    rows = rows[inside]
    ends = [_pose_at(times, found.estimate, rows[:, column]) for column in (0, 1)]
    estimated = compose(inverse(ends[0]), ends[1])
    off = compose(inverse(rows[:, [2, 3, 7]]), estimated)
    away, turned = np.hypot(off[:, 0], off[:, 1]), np.degrees(np.abs(off[:, 2]))
    return {
        "relations": len(rows),
        "translation_m": [round(float(away.mean()), 4), round(float(away.std()), 4)],
        "rotation_deg": [round(float(turned.mean()), 3), round(float(turned.std()), 3)],
        "largest_m": round(float(away.max()), 3),
    }


def _pose_at(times: Floats, poses: Floats, at: Floats) -> Floats:
    """(k, 3) poses between those of (n,) times."""
    columns = (poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
    return np.column_stack([np.interp(at, times, values) for values in columns])


def _places(log: LogDrive, count: int) -> Iterator[int]:
    """Stamps at which the robot drives, spread over the log, ns."""
    first_ns, last_ns = log.stamps_ns[0] + round(BEFORE * 1e9), log.stamps_ns[-1] - round(AFTER * 0.5e9)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(log.odometry[:, :2], axis=0).T))])
    low, high = np.interp([first_ns, last_ns], log.stamps_ns, way)
    for share in (np.arange(count) + 0.5) / count:
        yield int(log.stamps_ns[int(np.searchsorted(way, low + share * (high - low)))])


def _fault_row(log: LogDrive, name: str, known: OccupancyGrid, fault: str, number: int, at_ns: int, params: Any) -> Any:
    """How a localizer recovered from one made fault, or from a start without a pose.

    Returns:
        wrong: Whether the localizer tracked falsely after it. noticed_s: How long, s; None if it did not or never
        noticed. found_again: Whether it tracks truly at the end. Others as `report`.
    """
    part = log.between(at_ns - round(BEFORE * 1e9), at_ns + round(AFTER * 1e9))
    amounts = {"turn": (12.0, -18.0, 24.0, -30.0)[number % 4], "spin": 0.5, "drag": 1.3, "gap": 10.0}
    odometry, sigma, begun = None, None, BEFORE
    if fault == "unknown":
        part, sigma, begun = log.between(at_ns, at_ns + round(AFTER * 1e9)), ANYWHERE, 0.0
    else:
        part, odometry = faulty(part, fault, at_ns, amounts[fault])
    found, said = drive(part, name, known, params, sigma, odometry)
    after = found.time >= begun
    wrong = after & found.is_tracking & ((found.error > NOTICED[0]) | (found.turn_error > NOTICED[1]))
    first = int(np.argmax(wrong))
    noticed = first + int(np.argmin(wrong[first:])) if wrong.any() and not wrong[first:].all() else None
    row = report(found, said)
    return {
        "fault": fault,
        "amount": amounts.get(fault),
        "at_s": round((at_ns - int(log.stamps_ns[0])) * 1e-9, 1),
        "wrong": bool(wrong.any()),
        "noticed_s": None if noticed is None else round(float(found.time[noticed] - found.time[first]), 1),
        "found_again": row["end"] == "tracking",
        **row,
    }


def main() -> int:
    """Measure every localizer on every log."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="+", type=Path, metavar="LOG")
    parser.add_argument("--localizers", default="odometry,scan_matching")
    parser.add_argument("--leave-out", default="alternate,first_half")
    parser.add_argument("--relations", type=Path, help="true relations between poses of the first log")
    parser.add_argument(
        "--epoch", type=float, default=INTEL_EPOCH, help="s from the log's times to those of the relations"
    )
    parser.add_argument("--faults", default="", help=f"of {', '.join(FAULTS)}")
    parser.add_argument("--places", type=int, default=5)
    parser.add_argument("--unknown", action="store_true", help="start at each place without a pose")
    parser.add_argument("--set", action="append", default=[], metavar="A=V", help="a parameter of the localizers")
    parser.add_argument("--json", action="store_true", help="one JSON object per drive")
    given = parser.parse_args()
    params = {key: json.loads(value) for key, _, value in (text.partition("=") for text in given.set)}
    faults = [name for name in given.faults.split(",") if name] + ["unknown"] * given.unknown
    for path in given.logs:
        log = read(path)
        for way in given.leave_out.split(","):
            known, part = left_out(log, way)
            for name in given.localizers.split(","):
                own = {} if name == "odometry" else params
                common = {"log": path.name.partition(".")[0], "leave_out": way, "localizer": name}
                found, said = drive(part, name, known, own)
                row = report(found, said) | {"covered": covered(known, part.truth)}
                if given.relations is not None and path == given.logs[0]:
                    row["kuemmerle"] = kuemmerle(found, int(part.stamps_ns[0]), given.relations, given.epoch)
                _print({**common, **row}, given.json)
                for fault in faults if way == "alternate" and name != "odometry" else ():
                    for number, at_ns in enumerate(_places(part, given.places)):
                        _print({**common, **_fault_row(part, name, known, fault, number, at_ns, own)}, given.json)
    return 0


def _print(row: dict[str, Any], as_json: bool) -> None:
    """A row as JSON, or as one line: spreads as median/p95/max."""
    words = (
        f"{key} {'/'.join(map(str, value.values() if isinstance(value, dict) else [value]))}"
        for key, value in row.items()
        if value not in (None, {})
    )
    print(json.dumps(row) if as_json else ", ".join(words), flush=True)


if __name__ == "__main__":
    sys.exit(main())
