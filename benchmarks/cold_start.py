"""Cold start: one method drives bodies that nothing was tuned for, on storeys and in worlds of the BARN data set.

    python benchmarks/cold_start.py [--drives 50] [--development] [--bodies puck,long] [--kinds floor,barn]
        [--first 0] [--jobs 2] [--set A.B=V] [--out F.jsonl] [--json]

Half of a body's drives are in storeys (`floor:SEED`, the shipped config `building`, a known map), half in worlds of
`barn/barn_dev.npz` in the folder `NAVLOOM_DATA` (the config `explore`, no map). Of the config, only the robot, its
simulated motors and its sensors are replaced, `mppi` takes the role of the avoider, and the speeds that `explore` gives
for its own robot are left out, so that they follow from the new one. A world that the body does not
fit through is passed over: see `fits`. With `--out`, an interrupted campaign continues.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from campaign import kept, rows_of
from navloom.config import load_config
from navloom.geometry.frames import transform
from navloom.geometry.solids import box_corners
from navloom.geometry.world import Box, World
from navloom.runs.episode import run_episode
from navloom_maps import DEVELOPMENT_SEEDS, TEST_SEEDS, barn_world, floor_world
from navloom_maps.barn import barn_numbers
from numpy.typing import NDArray
from scipy import ndimage
from scipy.signal import fftconvolve

__all__ = ["BODIES", "Body", "Task", "drive", "fits", "table", "tasks"]

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
CELL = 0.05
"""Edge of a cell of the search in `fits`, m."""
ROOM = 0.1
"""Room around the body that a way must leave, m."""
HEADINGS = ((1, 0), (2, 1), (1, 1), (1, 2), (0, 1), (-1, 2), (-1, 1), (-2, 1))
"""Directions of `fits`, cells; the opposite ones follow from them."""


class Body(NamedTuple):
    """A robot: keys of `[robot]`, the time constants of its motors, s, and its lasers."""

    robot: dict[str, Any]
    motor_lag: float
    dead_time: float
    lasers: tuple[dict[str, Any], ...]

    @property
    def corners(self) -> Floats:
        """(n, 2) corners of the footprint, m, base frame."""
        shape = self.robot["footprint"]
        if "radius" in shape:
            angles = np.arange(32) * math.tau / 32
            return float(shape["radius"]) * np.column_stack([np.cos(angles), np.sin(angles)])
        if "polygon" in shape:
            return np.array(shape["polygon"], dtype=float)
        x, y = 0.5 * shape["length"], 0.5 * shape["width"]
        return np.array([(x, -y), (x, y), (-x, y), (-x, -y)])

    def settings(self) -> list[str]:
        """The description as `--set` takes it."""
        lasers = [{"name": f"laser_{k}", "kind": "laser_2d", **laser} for k, laser in enumerate(self.lasers)]
        return [
            *(f"robot.{key}={_toml(value)}" for key, value in self.robot.items()),
            f"robot.motor_lag={self.motor_lag}", f"robot.dead_time={self.dead_time}",
            f"platform.motor_time_constant={self.motor_lag}", f"platform.dead_time={self.dead_time}",
            f"sensor={_toml(lasers)}",
        ]  # fmt: skip


BODIES = {
    # A small round robot with a cheap rotating scanner.
    "puck": Body(
        {
            "footprint": {"radius": 0.14},
            "height": 0.2,
            "wheel_radius": 0.033,
            "half_track": 0.1,
            "max_linear": 0.3,
            "max_angular_deg": 150.0,
            "max_acceleration": 1.0,
            "max_deceleration": 1.0,
        },
        0.05,
        0.02,
        ({"beams": 360, "field_of_view_deg": 359.0, "range_max": 6.0, "sigma": 0.015, "z": 0.18, "rate_hz": 10.0},),
    ),
    # A square transport base with a safety scanner.
    "square": Body(
        {
            "footprint": {"length": 0.5, "width": 0.5},
            "height": 0.5,
            "wheel_radius": 0.08,
            "half_track": 0.22,
            "max_linear": 0.8,
            "max_angular_deg": 90.0,
            "max_acceleration": 0.6,
            "max_deceleration": 1.0,
            "max_angular_acceleration_deg": 180.0,
        },
        0.15,
        0.1,
        ({"beams": 541, "field_of_view_deg": 270.0, "range_max": 20.0, "sigma": 0.03, "z": 0.2, "x": 0.15},),
    ),
    # Wheels in front, a tail of 0.6 m behind them; the scanner sees the sides of the tail, not what is behind it.
    "tailed": Body(
        {
            "footprint": {"polygon": [[0.2, -0.25], [0.2, 0.25], [-0.6, 0.25], [-0.6, -0.25]]},
            "height": 0.4,
            "wheel_radius": 0.1,
            "half_track": 0.23,
            "max_linear": 1.2,
            "max_angular_deg": 60.0,
            "max_acceleration": 0.8,
            "max_deceleration": 1.5,
            "max_angular_acceleration_deg": 120.0,
        },
        0.2,
        0.08,
        ({"beams": 361, "field_of_view_deg": 270.0, "range_max": 12.0, "sigma": 0.02, "z": 0.25, "x": 0.12},),
    ),
    # A long, slow to turn vehicle with a scanner at either end.
    "long": Body(
        {
            "footprint": {"length": 1.2, "width": 0.4},
            "height": 0.6,
            "wheel_radius": 0.1,
            "half_track": 0.17,
            "max_linear": 1.0,
            "max_angular_deg": 45.0,
            "max_acceleration": 0.5,
            "max_deceleration": 0.8,
            "max_angular_acceleration_deg": 90.0,
        },
        0.25,
        0.12,
        (
            {"beams": 271, "field_of_view_deg": 270.0, "range_max": 25.0, "sigma": 0.03, "z": 0.2, "x": 0.55},
            {
                "beams": 271,
                "field_of_view_deg": 270.0,
                "range_max": 25.0,
                "sigma": 0.03,
                "z": 0.2,
                "x": -0.55,
                "heading_deg": 180.0,
            },
        ),
    ),
}


class Task(NamedTuple):
    """One drive: name of the body, `floor` or `barn`, reference of the world, seed of the run."""

    body: str
    kind: str
    world: str
    seed: int


def tasks(bodies: Sequence[str], kinds: Sequence[str], each: int, *, first: int = 0, develops: bool) -> Iterator[Task]:
    """The drives: `each` of a body and kind, in worlds that the body fits through, from the given one on."""
    for body in bodies:
        for kind in kinds:
            count = 0
            for number, world in enumerate(_worlds(kind, develops)[first:], start=first):
                if count == each:
                    break
                if fits(_world(world), BODIES[body].corners):
                    count += 1
                    yield Task(body, kind, world, number)


def _worlds(kind: str, develops: bool) -> list[str]:
    if kind == "floor":
        return [f"floor:{seed}" for seed in (DEVELOPMENT_SEEDS if develops else TEST_SEEDS)]
    return [f"barn:{_barn()}#{number}" for number in barn_numbers(_barn(), Path())]


def _barn() -> str:
    return str(Path(os.environ["NAVLOOM_DATA"], "barn", "barn_dev.npz"))


@cache
def _world(reference: str) -> World:
    scheme, _, argument = reference.partition(":")
    return floor_world(argument, Path()) if scheme == "floor" else barn_world(argument, Path())


def fits(world: World, corners: Floats, room: float = ROOM) -> bool:
    """Whether straight moves and turns in place lead the body from start to goal, with room around it.

    A search over cells and 16 headings.

    Args:
        world: With start and goal. corners: (n, 2) of the body, m, base frame. room: m.
    """
    assert world.start is not None and world.goal is not None
    occupied = _occupied(world)
    ways = [vector for sign in (1, -1) for vector in ((sign * x, sign * y) for x, y in HEADINGS)]
    free = [~_grown(occupied, corners, math.atan2(y, x), room) for x, y in ways]
    # To turn from one heading to the next, both must be free; a step passes the cells between.
    turns = np.array([free[k] & free[(k + 1) % 16] for k in range(16)])
    place = _cell(world, world.start.x, world.start.y)
    reached = np.zeros((16, *occupied.shape), dtype=bool)
    nearest = round(world.start.heading / (math.tau / 16)) % 16
    reached[nearest][place] = free[nearest][place]
    goal, before = _cell(world, world.goal.x, world.goal.y), -1
    while (now := int(reached.sum())) != before and not reached[(slice(None), *goal)].any():
        before = now
        for k, (x, y) in enumerate(ways):
            line = np.zeros((2 * abs(y) + 1, 2 * abs(x) + 1), dtype=bool)
            for end in ((0, 0), (x, y), (-x, -y)):
                line[abs(y) + end[1], abs(x) + end[0]] = True
            reached[k] = ndimage.binary_propagation(reached[k], line, free[k])
        for k in (*range(16), *range(15, -1, -1)):
            both = (reached[k] | reached[(k + 1) % 16]) & turns[k]
            reached[k] |= both
            reached[(k + 1) % 16] |= both
    return bool(reached[(slice(None), *goal)].any())


def _cell(world: World, x: float, y: float) -> tuple[int, int]:
    return int((y - world.bounds[1]) / CELL), int((x - world.bounds[0]) / CELL)


def _occupied(world: World) -> Bools:
    """(rows, cols) cells of the bounds whose middle is in an obstacle of any height."""
    x0, y0, x1, y1 = world.bounds
    xs, ys = np.arange(x0, x1, CELL) + 0.5 * CELL, np.arange(y0, y1, CELL) + 0.5 * CELL
    x, y = np.meshgrid(xs, ys)
    occupied = np.zeros(x.shape, dtype=bool)
    if world.raster is not None:  # its frame is the map's
        rows, cols = world.raster.occupied.shape
        column, row = ((x / world.raster.resolution).astype(int), (y / world.raster.resolution).astype(int))
        occupied |= world.raster.occupied[row.clip(0, rows - 1), column.clip(0, cols - 1)]
    for solid in world.obstacles:
        if isinstance(solid, Box):
            outline = box_corners(solid)
            reach = float(np.ptp(outline, axis=0).max())
        else:
            reach = 2.0 * (solid.radius + CELL)
        row, column = _cell(world, *solid.centre)
        half = math.ceil(0.5 * reach / CELL) + 1
        window = (
            slice(max(0, row - half), max(0, row + half + 1)),
            slice(max(0, column - half), max(0, column + half + 1)),
        )
        wx, wy = x[window], y[window]
        if isinstance(solid, Box):
            sides = np.roll(outline, -1, axis=0) - outline
            inside = [sx * (wy - cy) - sy * (wx - cx) >= 0.0 for (cx, cy), (sx, sy) in zip(outline, sides, strict=True)]
            occupied[window] |= np.all(inside, axis=0)
        else:
            occupied[window] |= np.hypot(wx - solid.x, wy - solid.y) <= solid.radius + 0.5 * CELL
    return occupied


def _grown(occupied: Bools, corners: Floats, heading: float, room: float) -> Bools:
    """Cells at which the base cannot be: the obstacles grown by the body, mirrored, and by the room around it."""
    outline = -transform((0.0, 0.0, heading), corners)
    reach = math.ceil((float(np.hypot(*corners.T).max()) + room) / CELL)
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1] * CELL
    sides = np.roll(outline, -1, axis=0) - outline
    lengths = np.hypot(*sides.T)
    beyond = [
        (sy * (x - cx) - sx * (y - cy)) / n for (cx, cy), (sx, sy), n in zip(outline, sides, lengths, strict=True)
    ]
    body = (np.max(beyond, axis=0) <= room).astype(float)
    # A dilation: how many obstacles' cells the body meets at each cell, by the fast Fourier transform.
    met: Bools = fftconvolve(occupied.astype(float), body, mode="same") > 0.5
    return met


def drive(task: Task, changes: Sequence[str] = ()) -> dict[str, Any]:
    """Drive once: the task, outcome, reason, contacts, way, m, time, s, and CPU time, s."""
    config = "building" if task.kind == "floor" else "explore"
    method = ("avoider.plugin=mppi", "navigation.handover=always", "navigation.speed=default",
              "navigation.lateral_acceleration=default")  # fmt: skip
    given = (*BODIES[task.body].settings(), f"world.ref={_toml(task.world)}", *method, *changes)
    began = time.process_time()
    episode = run_episode(load_config(config, given, task.seed))
    said = episode.summary()
    return task._asdict() | {
        "arrived": said["outcome"] == "succeeded" and bool(said["truly_reached"]),
        "outcome": said["outcome"],
        "reason": said["reason"],
        "contacts": said["collisions"],
        "recoveries": said["recoveries"],
        "clearance_m": said["min_clearance_m"],
        "way_m": said["path_length_m"],
        "optimal_m": said["optimal_length_m"],
        "time_s": said["sim_time_s"],
        "cpu_s": round(time.process_time() - began, 1),
    }


def _toml(value: Any) -> str:
    """A value in the notation of `--set`."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value)


def _drive(work: tuple[Task, Sequence[str]]) -> dict[str, Any]:
    return drive(*work)


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Arrivals, contacts and recoveries by body and kind of world, and of all."""
    lines = [
        f"{'body':<10}{'worlds':<8}{'drives':>7}{'arrived':>9}{'contacts':>10}{'recoveries':>12}{'time / optimal':>16}"
    ]
    pairs = sorted({(row["body"], row["kind"]) for row in rows})
    for body, kind in (*pairs, *sorted({(body, "all") for body, _ in pairs}), ("all", "all")):
        chosen = [r for r in rows if body in ("all", r["body"]) and kind in ("all", r["kind"])]
        arrived = [row for row in chosen if row["arrived"]]
        # Over the time that the shortest way of a point robot takes at the highest speed.
        paces = [r["time_s"] * _speed(r["body"]) / r["optimal_m"] for r in arrived if r["optimal_m"]]
        lines.append(
            f"{body:<10}{kind:<8}{len(chosen):>7}{len(arrived) / len(chosen):>9.3f}"
            f"{sum(row['contacts'] > 0 for row in chosen):>10}{sum(row['recoveries'] for row in chosen):>12}"
            f"{float(np.median(paces)) if paces else math.nan:>16.2f}"
        )
    return "\n".join(lines)


def _speed(body: str) -> float:
    return float(BODIES[body].robot["max_linear"])


def main() -> int:
    """Run the campaign; exit code 1 if there was a contact, or less than .95 of a body's drives arrived."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, default=50, help="of each body, half of them of each kind")
    parser.add_argument("--development", action="store_true", help="storeys of the development seeds")
    parser.add_argument("--bodies", default=",".join(BODIES))
    parser.add_argument("--kinds", default="floor,barn")
    parser.add_argument("--first", type=int, default=0, help="index of the first world")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--set", action="append", default=[], metavar="A.B=V")
    parser.add_argument("--out", type=Path, help="JSON lines, one a drive")
    parser.add_argument("--json", action="store_true", help="print one JSON object per drive, no table")
    given = parser.parse_args()
    kinds = given.kinds.split(",")
    if "barn" in kinds and not os.environ.get("NAVLOOM_DATA"):
        parser.error(
            "worlds of BARN: set NAVLOOM_DATA to the folder that holds barn/barn_dev.npz, or give --kinds floor"
        )
    rows = kept(given.out)
    done = {(row["body"], row["world"], row["seed"]) for row in rows}
    chosen = tasks(
        given.bodies.split(","), kinds, given.drives // len(kinds), first=given.first, develops=given.development
    )
    work = ((task, given.set) for task in chosen if (task.body, task.world, task.seed) not in done)
    count = len(given.bodies.split(",")) * len(kinds) * (given.drives // len(kinds))
    for row in rows_of(_drive, work, given.jobs, given.out):
        rows.append(row)
        if given.json:
            print(json.dumps(row), flush=True)
        else:
            said = f"{row['outcome']} {row['time_s']:.0f} s, {row['cpu_s']} s of CPU"
            print(f"{len(rows)} of {count}: {row['body']} {row['world']} {said}", file=sys.stderr, flush=True)
    if not given.json:
        print(table(rows))
    bodies = {row["body"]: [other["arrived"] for other in rows if other["body"] == row["body"]] for row in rows}
    return int(any(row["contacts"] for row in rows) or any(sum(got) < 0.95 * len(got) for got in bodies.values()))


if __name__ == "__main__":
    sys.exit(main())
