"""The people tracker on recorded and made crowds, seen by the simulator's laser on a robot that stands or turns.

    python benchmarks/tracking.py [--people F.npz#SCENE | --crowd N] [--from S] [--for S] [--body legs|disc]
        [--beams N] [--turn RAD_S] [--map] [--seed N] [--json]

`--people` reads `SCENE_t`, s, `SCENE_id` and `SCENE_xy`, m, of a file; the robot is in the middle of them. `--crowd` is
of people who walk from place to place in a room of 13 m. With `--map`, a map shows the walls. Printed are OSPA and its
parts, false tracks, velocity and latency as the metrics of `compare` define them, and the CPU time of a step.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from typing import Any

import numpy as np
from navloom import Box, World
from navloom.messages import Tracks
from navloom.runs.moving_bodies import MovingBodies
from navloom.runs.tracking import tracking_of
from navloom_people_tracker.params import PeopleTrackerParams
from navloom_people_tracker.tracking import Tracker
from navloom_people_tracker.views import place_beams
from navloom_sensors_sim.beams import fan, fan_step, read_laser
from navloom_sensors_sim.casting import Obstacles
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PERIOD = 0.1
"""Time between scans, s."""
SIGMA, REACH = 0.02, 20.0
"""Standard deviation and limit of a range, m."""
ROOM = 6.5
"""Half width of the room, m."""
DISC, LEG = 0.25, 0.06
"""Radius of a person who is a disc, and of a leg, m."""
STRIDE, HIPS, STEPS = 0.25, 0.1, 0.9
"""Half a stride at 1 m/s and half the distance between the legs, m; strides a second."""


def recorded(path: str, scene: str, begin: float, until: float) -> tuple[Floats, Floats]:
    """Times, s, and (n, k, 2) places, m, of the people of a scene round the middle of all; NaN for none."""
    with np.load(path) as file:
        stamps, numbers, places = (file[f"{scene}_{name}"] for name in ("t", "id", "xy"))
    at = np.arange(begin, until, PERIOD)
    own = [number for number in np.unique(numbers) if (abs(stamps[numbers == number] - 0.5 * (begin + until))
                                                       <= until - begin).any()]  # fmt: skip
    found = np.full((len(at), len(own), 2), np.nan)
    middle = np.median(places, axis=0)
    for column, number in enumerate(own):
        rows = numbers == number
        given, order = places[rows] - middle, np.argsort(stamps[rows])
        times = stamps[rows][order]
        for axis in range(2):
            found[:, column, axis] = np.interp(at, times, given[order, axis], left=np.nan, right=np.nan)
    return at - begin, found


def made(count: int, until: float, rng: np.random.Generator, half: float = 5.5) -> tuple[Floats, Floats]:
    """Times, s, and (n, k, 2) places, m, of people who walk from place to place at 0.5 to 1.4 m/s."""
    at = np.arange(0.0, until, PERIOD)
    found = np.empty((len(at), count, 2))
    for column in range(count):
        times, places = [0.0], [rng.uniform(-half, half, 2)]
        while times[-1] < until:
            places.append(rng.uniform(-half, half, 2))
            times.append(times[-1] + float(np.hypot(*(places[-1] - places[-2]))) / rng.uniform(0.5, 1.4))
        for axis in range(2):
            found[:, column, axis] = np.interp(at, times, np.array(places)[:, axis])
    return at, found


def room(half: float) -> list[Box]:
    """The walls of a square room around the origin; its half width, m."""
    ends = ((-half, half), (-half, -half + 0.1), (half - 0.1, half))
    return [Box("south", ends[0], ends[1]), Box("north", ends[0], ends[2]),
            Box("west", ends[1], ends[0]), Box("east", ends[2], ends[0])]  # fmt: skip


def cylinders(bodies: MovingBodies, row: int, has_legs: bool) -> Floats:
    """Rows of `Obstacles.cylinders` of the people at a time."""
    rows = []
    there = np.isfinite(bodies.places[row, :, 0])
    for (x, y), (vx, vy) in zip(bodies.places[row, there], np.nan_to_num(bodies.velocities[row, there]), strict=True):
        if not has_legs:
            rows.append((x, y, DISC, 0.0, 1.8, 1.0))
            continue
        speed = math.hypot(vx, vy)
        ux, uy = (vx / speed, vy / speed) if speed > 0.05 else (1.0, 0.0)
        swing = STRIDE * min(1.0, speed) * math.sin(math.tau * STEPS * PERIOD * row + x + y)
        for side in (-1.0, 1.0):
            ahead, left = side * swing, side * HIPS
            rows.append((x + ahead * ux - left * uy, y + ahead * uy + left * ux, LEG, 0.0, 1.8, 1.0))
    return np.array(rows).reshape(-1, 6)


def followed(times: Floats, places: Floats, walls: list[Box], given: argparse.Namespace) -> dict[str, Any]:
    """Figures of the tracker."""
    bodies = MovingBodies(places, np.gradient(places, times, axis=0), np.full(places.shape[1], 0.3))
    rng, tracker = np.random.default_rng(given.seed), Tracker(PeopleTrackerParams())
    bearings, step = fan(given.beams, math.tau, 0.0), fan_step(given.beams, math.tau)
    halves = [(0.5 * (wall.x[1] - wall.x[0]), 0.5 * (wall.y[1] - wall.y[0])) for wall in walls]
    boxes = [(*wall.centre, *half, 0.0, 2.4, 1.0, 0.0, 1.0) for wall, half in zip(walls, halves, strict=True)]
    made_of = np.array(boxes).reshape(-1, 9), np.zeros((0, 0), np.float32), np.zeros(7)
    origins = np.repeat([[0.0], [0.0], [0.3]], given.beams, axis=1)
    directions = np.stack([np.cos(bearings), np.sin(bearings), np.zeros(given.beams)])
    options = np.array([0.05, REACH, SIGMA, bearings[0], step])
    messages, spent = [], []
    for row, now in enumerate(times.tolist()):
        obstacles = Obstacles(made_of[0], cylinders(bodies, row, given.body == "legs"), *made_of[1:])
        pose, ranges, beams = np.array([0.0, 0.0, given.turn * now]), np.empty(given.beams), np.empty((given.beams, 5))
        read_laser(pose, origins, directions, obstacles, options, rng.standard_normal(given.beams), ranges)
        began = time.thread_time()
        place_beams(np.tile(pose, (given.beams, 1)), origins[:2].T, bearings, ranges, options[:2], beams)
        at_wall = (np.abs(beams[:, 2:4]).max(axis=1) > ROOM - 0.3) & bool(walls)
        tracker.see(now, "laser", pose, beams, step, np.where(at_wall, 1, 0) if given.map else np.full(given.beams, -1))
        found = tracker.published(now)
        spent.append(1e3 * (time.thread_time() - began))
        means = found.means[:, :2].copy(), found.means[:, 2:].copy()
        messages.append(
            (now, Tracks(round(1e9 * now), found.ids, *means, found.covariances, found.radii, now - found.seen))
        )
    robot = np.column_stack([times, np.zeros((len(times), 2))])
    seen = tracking_of({("people", "tracks"): messages}, bodies, robot, World("made"), 0.5)
    parts = seen.distances.mean(axis=0)
    numbers = [len(one.bodies) for one in seen.moments]
    return {
        "people_mean": float(np.mean(numbers)),
        "people_max": max(numbers),
        "ospa": parts[0],
        "ospa_location": parts[1],
        "ospa_cardinality": parts[2],
        "false_tracks_per_min": 60.0 * seen.false_tracks / seen.duration,
        "speed_rms": float(np.sqrt((seen.speed_errors**2).mean())),
        "latency": float(np.mean(seen.latencies)),
        "step_ms_p50": float(np.percentile(spent, 50)),
        "step_ms_p99": float(np.percentile(spent, 99)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", help="file and scene, as F.npz#hotel")
    parser.add_argument("--crowd", type=int, default=20, help="people of a made crowd")
    parser.add_argument("--from", dest="begin", type=float, default=0.0, help="time in the scene at which to begin, s")
    parser.add_argument("--for", dest="lasts", type=float, default=60.0, help="s")
    parser.add_argument("--body", choices=("legs", "disc"), default="legs")
    parser.add_argument("--beams", type=int, default=360)
    parser.add_argument("--turn", type=float, default=0.0, help="turn rate of the robot, rad/s")
    parser.add_argument("--map", action="store_true", help="a map shows the walls")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if given.people:
        path, _, scene = given.people.partition("#")
        people, walls = recorded(path, scene, given.begin, given.begin + given.lasts), []
    else:
        people, walls = made(given.crowd, given.lasts, np.random.default_rng(given.seed)), room(ROOM)
    found = followed(*people, walls, given)
    print(json.dumps(found) if given.json else "\n".join(f"{name:22}{value:.3f}" for name, value in found.items()))


if __name__ == "__main__":
    main()
