"""Made episodes and studies, for tests of reports."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from navloom.runs.metrics import measure
from navloom_study import METRICS, Trail
from navloom_study.episode_key import EpisodeKey
from navloom_study.episode_rows import Row
from navloom_study.study_folder import table_of
from navloom_study.tracks import FOLDER, encoded, file_of

NAMES = [metric.name for metric in METRICS]


def straight(outcome: str, seconds: int = 20, speed: float = 0.4, aside: float = 0.0) -> Trail:
    """A drive along y in ticks of 1 s; the shortest way is 7.5 m, the limits are 120 s and 0.5 m/s."""
    time = np.arange(seconds + 1.0)
    flat, never = np.zeros_like(time), np.zeros(time.size, dtype=np.bool_)
    return Trail(
        time=time, x=flat + aside, y=speed * time, heading=flat, vx=flat + speed, wz=flat, clearance=flat + 1.0,
        cross_track=flat + aside, command_vx=flat + speed, command_wz=flat, engaged=never, stopped_by_gate=never,
        outcome=outcome, reason=f"because {outcome}", touches=int(outcome == "collision"), recoveries=0, gate_stops=0,
        period=1.0, optimal=7.5, goal_distance=0.1, limit=120.0, max_linear=0.5, max_deceleration=1.0, reaction=0.1,
        tick_ns=np.full(time.size, 1000),
    )  # fmt: skip


def study_folder(
    folder: Path, methods: Sequence[str], worlds: Sequence[str], seeds: Sequence[int], trail_of: Callable[..., Trail]
) -> Path:
    """The folder of a finished study as `navloom compare` writes it, with its tracks."""
    (folder / FOLDER).mkdir(parents=True)
    rows = []
    for number, method in enumerate(methods):
        for world in worlds:
            for seed in seeds:
                trail, key = trail_of(method, world, seed), EpisodeKey(method, world, seed)
                timing = {"tick_us_p50": 100.0 + number, "tick_us_p95": 200.0, "tick_us_p99": 300.0 + 9e5 * number,
                          "tick_us_max": 400.0 + 9e5 * number, "too_slow": number > 0, "wall_s": 1.0}  # fmt: skip
                rows.append(Row(key, trail.outcome, trail.reason, measure(trail), "ab" * 32, timing))
                (folder / FOLDER / file_of(key)).write_bytes(encoded(trail, (0.0, 8.0), 0.2))
    (folder / "episodes.csv").write_text(table_of(rows, NAMES), "utf-8")
    request = {
        "config": "paper",
        "methods": {m: {"config_sha256": "c" * 64, "changes": [f'avoider.plugin="{m}"']} for m in methods},
        "worlds": {w: {"sha256": "d" * 64, "changes": [f'world.ref="{w}"']} for w in worlds},
        "seeds": list(seeds),
        "metrics": NAMES,
        "held_equal": {"run.period": 0.05, "robot.height": 1.2, "navigation.speed": [0.2, 0.4]},
        "differs": {"avoider.plugin": {m: m for m in methods}},
        "versions": {"navloom": "0.1.0"},
    }
    (folder / "study.json").write_text(json.dumps(request), "utf-8")
    timing = {"wall_s": 9.0, "jobs": 1, "machine": {"cores": 2, "processor": "x"},
              "episodes": [{**vars(row.key), **row.timing} for row in rows]}  # fmt: skip
    (folder / "timing.json").write_text(json.dumps(timing), "utf-8")
    return folder
