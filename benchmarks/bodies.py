"""Contacts and arrivals of long bodies whose base is off their centre, at doors, corners and posts.

    python benchmarks/bodies.py [--episodes 300] [--seeds A:B] [--bodies 0,3] [--scenes door,post] [--jobs 2]
        [--set A.B=V] [--json]

Ten bodies of 0.7 to 1.5 m, with the base in each quarter of the body, drive with `building`'s plugins in lockstep.
Bodies and scenes take turns; beam spacing, noise, room and seed are drawn from a stream of the episode's number, so
that two versions of navloom get the same episodes. A way is *roomy* if it is wider than the body by at least 0.4 m and
leaves room to turn.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from navloom.config import load_config
from navloom.runs.episode import run_episode

__all__ = ["BODIES", "Body", "Task", "drive", "tasks"]

SCENES = ("door", "corner", "post")
SPACINGS_DEG = (1.0, 0.5, 0.25)
SIGMAS = (0.005, 0.01, 0.03)
ROOMS = (0.2, 0.4, 0.6)
"""Room beside the body in a door or corridor, both sides together, m."""
ROOMY = 0.4


class Body(NamedTuple):
    """A rectangle: how far it reaches in front of, behind, left and right of the base, m."""

    front: float
    rear: float
    left: float
    right: float

    @property
    def radius(self) -> float:
        """Distance of the farthest corner from the base, m."""
        return math.hypot(max(self.front, self.rear), max(self.left, self.right))

    @property
    def width(self) -> float:
        return self.left + self.right

    @property
    def polygon(self) -> list[list[float]]:
        """Corners, m, base frame, counter-clockwise."""
        return [[self.front, -self.right], [self.front, self.left], [-self.rear, self.left], [-self.rear, -self.right]]


BODIES = (
    Body(1.1, 0.3, 0.3, 0.3),
    Body(0.3, 1.1, 0.3, 0.3),
    Body(1.2, 0.3, 0.35, 0.25),
    Body(0.3, 1.2, 0.25, 0.35),
    Body(0.9, 0.4, 0.2, 0.35),
    Body(0.4, 0.9, 0.35, 0.2),
    Body(0.75, 0.75, 0.25, 0.25),
    Body(0.7, 0.2, 0.3, 0.2),
    Body(0.2, 0.7, 0.2, 0.3),
    Body(0.5, 0.2, 0.25, 0.25),
)


@dataclass(frozen=True)
class Task:
    """One episode.

    Attributes:
        number: It seeds what the scene draws.
        body: Index in BODIES.
        scene: One of SCENES.
        spacing_deg: Angle between two beams.
        sigma: Standard deviation of a range, m, of the laser and of `gate.range_sigma`.
        room: Room beside the body, m.
        seed: Of the run.
    """

    number: int
    body: int
    scene: str
    spacing_deg: float
    sigma: float
    room: float
    seed: int


def tasks(count: int, seeds: range, bodies: Sequence[int], scenes: Sequence[str]) -> Iterator[Task]:
    """The episodes: bodies and scenes in turn, the rest drawn."""
    for number in range(count):
        stream = np.random.default_rng(number)
        spacing, sigma, room = (float(stream.choice(values)) for values in (SPACINGS_DEG, SIGMAS, ROOMS))
        body, scene = bodies[number % len(bodies)], scenes[number // len(bodies) % len(scenes)]
        yield Task(number, body, scene, spacing, sigma, room, int(stream.choice(seeds)))


def drive(task: Task, changes: Sequence[str] = ()) -> dict[str, Any]:
    """Drive one episode: the task, outcome, contacts, way, m, and time, s."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "world.toml").write_text(_world(task))
        Path(folder, "robot.toml").write_text(_config(task))
        episode = run_episode(load_config(f"{folder}/robot.toml", changes, task.seed))
    said, result = episode.summary(), episode.result
    return asdict(task) | {
        "roomy": _is_roomy(task),
        "outcome": said["outcome"],
        "reason": said["reason"],
        "contacts": said["collisions"],
        "place": (round(result.place.x, 2), round(result.place.y, 2)),
        "way_m": said["path_length_m"],
        "time_s": said["sim_time_s"],
    }


def _is_roomy(task: Task) -> bool:
    return task.scene == "post" or task.room >= ROOMY


def _world(task: Task) -> str:
    body, stream = BODIES[task.body], np.random.default_rng((task.number, 1))
    room = [
        ("left wall", -4.2, -4.0, -2.0, 8.0), ("right wall", 4.0, 4.2, -2.0, 8.0),
        ("rear wall", -4.2, 4.2, -2.2, -2.0), ("front wall", -4.2, 4.2, 8.0, 8.2),
    ]  # fmt: skip
    start, goal = (0.0, 0.0), (float(stream.uniform(-2.5, 2.5)), 6.0)
    width = body.width + task.room
    if task.scene == "door":
        middle = float(stream.uniform(-2.4, 2.4))
        room += [
            ("wall left", -4.0, middle - 0.5 * width, 3.0, 3.2),
            ("wall right", middle + 0.5 * width, 4.0, 3.0, 3.2),
        ]
    elif task.scene == "corner":  # a passage beside the wall, round the end of a partition
        across = 2.0 * body.radius + task.room
        side = 1.0 if stream.random() < 0.5 else -1.0
        end = side * (4.0 - width - float(stream.uniform(0.0, 1.0)))
        room += [("partition", *sorted((-4.0 * side, end)), 1.0 + body.radius, 1.2 + body.radius)]
        room += [("block", *sorted((-4.0 * side, end)), 1.2 + body.radius + across, 1.4 + body.radius + across)]
        goal = (float(stream.uniform(-2.0, 1.0)) * side, 1.2 + body.radius + 0.5 * across)
    else:
        for k in range(3):
            x, y, size = stream.uniform((-1.5, 1.8, 0.02), (1.5, 4.8, 0.15)).tolist()
            room.append((f"post {k}", x - size, x + size, y - size, y + size))
    boxes = "".join(f'[[box]]\nname = "{name}"\nx = [{a!r}, {b!r}]\ny = [{c!r}, {d!r}]\n' for name, a, b, c, d in room)
    return (
        f"bounds = [-4.2, -2.2, 4.2, 8.2]\nstart = {{ x = {start[0]}, y = {start[1]}, heading_deg = 90.0 }}\n"
        f"goal = {{ x = {goal[0]!r}, y = {goal[1]!r} }}\n{boxes}"
    )


def _config(task: Task) -> str:
    body = BODIES[task.body]
    beams = round(270.0 / task.spacing_deg) + 1
    return f"""
[run]
stop_after = 200.0
[robot]
footprint = {{ polygon = {body.polygon} }}
height = 0.6
half_track = {min(0.25, body.left, body.right)}
max_linear = 0.5
max_angular_deg = 45.84
max_acceleration = 0.5
max_deceleration = 0.5
max_angular_acceleration_deg = 57.3
motor_lag = 0.1
dead_time = 0.05
[platform]
motor_time_constant = 0.1
dead_time = 0.05
slip = 0.01
[world]
ref = "world.toml"
[navigation]
speed = [0.2, 0.4]
[gate]
range_sigma = {task.sigma}
[[sensor]]
name = "laser"
kind = "laser_2d"
beams = {beams}
field_of_view_deg = 270.0
range_max = 20.0
sigma = {task.sigma}
[localizer]
plugin = "scan_matching"
[mapper]
plugin = "known_map"
[planner]
plugin = "astar"
inflation_margin = 0.05
[controller]
plugin = "lyapunov_tracker"
[avoider]
plugin = "dwa"
[recovery]
plugin = "retrace"
"""


def _drive(work: tuple[Task, Sequence[str]]) -> dict[str, Any]:
    return drive(*work)


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Contacts and arrivals by body, and of all."""
    lines = [f"{'body: front rear left right, m':32}{'episodes':>9}{'contacts':>9}{'roomy: arrived':>16}{'others':>12}"]
    for index in (*sorted({row["body"] for row in rows}), None):
        chosen = [row for row in rows if index is None or row["body"] == index]
        shares = []
        for roomy in (True, False):
            of = [row["outcome"] == "succeeded" for row in chosen if row["roomy"] is roomy]
            shares.append(f"{sum(of)} of {len(of)}")
        name = "all" if index is None else " ".join(f"{side:g}" for side in BODIES[index])
        contacts = sum(row["contacts"] > 0 for row in chosen)
        lines.append(f"{name:32}{len(chosen):9}{contacts:9}{shares[0]:>16}{shares[1]:>12}")
    return "\n".join(lines)


def main() -> int:
    """Run the campaign; exit code 1 if there was a contact."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=300)
    parser.add_argument("--seeds", default="0:20", metavar="A:B")
    parser.add_argument("--bodies", default=",".join(map(str, range(len(BODIES)))))
    parser.add_argument("--scenes", default=",".join(SCENES))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--set", action="append", default=[], metavar="A.B=V")
    parser.add_argument("--json", action="store_true", help="print one JSON object per episode, no table")
    given = parser.parse_args()
    first, end = map(int, given.seeds.split(":"))
    bodies = [int(text) for text in given.bodies.split(",")]
    work = [(task, given.set) for task in tasks(given.episodes, range(first, end), bodies, given.scenes.split(","))]
    rows = []
    with multiprocessing.get_context("spawn").Pool(given.jobs) as pool:
        for row in pool.imap(_drive, work):
            rows.append(row)
            if given.json:
                print(json.dumps(row), flush=True)
            elif row["outcome"] != "succeeded":
                print(json.dumps(row), file=sys.stderr, flush=True)
    if not given.json:
        print(table(rows))
    return int(any(row["contacts"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
