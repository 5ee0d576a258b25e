"""The people tracker on recorded and made crowds, seen by the simulator's laser on a robot that stands or turns.

    python benchmarks/tracking.py [--people F.npz#SCENE | --crowd N | --dynabarn F.npz#N@PHASE] [--from S] [--for S]
        [--body legs|disc] [--beams N] [--turn RAD_S] [--speed M_S] [--map] [--seed N] [--json]

`--people` reads `SCENE_t`, s, `SCENE_id` and `SCENE_xy`, m, of a file; the robot is in the middle of them. `--crowd` is
of people who walk from place to place in a room of 13 m. `--dynabarn` is of cylinders. With `--map`, a map shows the
walls. With `--speed`, the robot drives 5 m to and fro along x. Printed are OSPA and its parts, false tracks, velocity
and latency as the metrics of `compare` define them, the CPU time of a step, and how fast a track follows:

- `appeared_*`: of bodies that come into view within 8 m, from behind something: time up to the first track, and
  `LATER` after they appeared, the share that has a track and the error of its velocity;
- `turned_*`: the same share and error `LATER` after the velocity of a body in view jumped by more than `JUMP`.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
from navloom import Box, World
from navloom.messages import Tracks
from navloom.runs.moving_bodies import MovingBodies
from navloom.runs.tracking import Tracking, tracking_of
from navloom_maps.dynabarn import dynabarn_world
from navloom_people_tracker.params import PeopleTrackerParams
from navloom_people_tracker.tracking import Tracker
from navloom_people_tracker.views import place_beams
from navloom_people_tracker.warming import warm_up
from navloom_sensors_sim.beams import fan, fan_step, read_laser
from navloom_sensors_sim.casting import Obstacles
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

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
LATER, JUMP, NEAR = 0.3, 1.0, 8.0
"""When the velocity of a track is judged, s; change of velocity of a body that turns, m/s; farthest such body, m."""
SEEN_BY, HIDDEN_FOR = 3, 0.5
"""Fewest echoes of a body in view; and how long it was out of view before it appears, s."""


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


def of_dynabarn(reference: str, until: float) -> tuple[Floats, Floats, Floats]:
    """Times, s, (n, k, 2) places, m, and (k,) radii, m, of the cylinders of a world `F.npz#N@PHASE`."""
    at, actors = np.arange(0.0, until, PERIOD), dynabarn_world(reference, Path()).actors
    ways = [[motion[:2] for time in at.tolist() if (motion := actor.course.at(time))] for actor in actors]
    return at, np.array(ways).transpose(1, 0, 2), np.array([actor.body.radius for actor in actors])


def cylinders(bodies: MovingBodies, row: int, has_legs: bool) -> Floats:
    """Rows of `Obstacles.cylinders` of the bodies at a time."""
    rows = []
    there = np.isfinite(bodies.places[row, :, 0])
    given = bodies.places[row, there], np.nan_to_num(bodies.velocities[row, there]), bodies.radii[there]
    for (x, y), (vx, vy), radius in zip(*given, strict=True):
        if not has_legs:
            rows.append((x, y, radius, 0.0, 1.8, 1.0))
            continue
        speed = math.hypot(vx, vy)
        ux, uy = (vx / speed, vy / speed) if speed > 0.05 else (1.0, 0.0)
        swing = STRIDE * min(1.0, speed) * math.sin(math.tau * STEPS * PERIOD * row + x + y)
        for side in (-1.0, 1.0):
            ahead, left = side * swing, side * HIPS
            rows.append((x + ahead * ux - left * uy, y + ahead * uy + left * ux, LEG, 0.0, 1.8, 1.0))
    return np.array(rows).reshape(-1, 6)


def delays(bodies: MovingBodies, echoes: NDArray[np.int64], near: Bools, seen: Tracking) -> dict[str, float]:
    """How fast tracks follow: see the top.

    Args:
        bodies: The truth. seen: The tracks beside it.
        echoes: (n, k) number of those of each body in each scan.
        near: (n, k) whether a body is within `NEAR` of the robot.
    """
    in_view, hidden, later = (echoes >= SEEN_BY) & near, round(HIDDEN_FOR / PERIOD), round(LATER / PERIOD)
    errors = np.full(echoes.shape, np.nan)
    for row, moment in enumerate(seen.moments):
        for body, column in moment.pairs:
            errors[row, moment.bodies[body]] = np.hypot(*(moment.speeds[column] - moment.true_speeds[body]))
    waits, found = [], dict[str, list[float]](appeared=[], turned=[])
    jumps = np.hypot(*np.moveaxis(np.diff(bodies.places, 2, axis=0) / PERIOD, 2, 0)) > JUMP
    for row, body in zip(*np.nonzero(in_view), strict=True):
        until = min(row + later, len(echoes) - 1)
        stays = in_view[row : until + 1, body].all() and until - row == later
        appears = row > 10 and not (echoes[row - hidden : row, body] >= SEEN_BY).any()
        if appears and stays:
            found["appeared"].append(errors[until, body])
            known = np.flatnonzero(np.isfinite(errors[row:, body]))
            lost = np.flatnonzero(~in_view[row:, body])
            waits.append(PERIOD * min([*known[:1], *lost[:1], len(echoes) - row]))
        if 10 < row < len(echoes) - 1 and jumps[row - 1, body] and stays:
            found["turned"].append(errors[until, body])
    figures = {"appeared_latency": float(np.mean(waits)) if waits else math.nan}
    for name, given in found.items():
        figures[f"{name}_number"] = len(given)
        figures[f"{name}_known"] = float(np.isfinite(given).mean()) if given else math.nan
        figures[f"{name}_speed_error"] = float(np.nanmedian(given)) if np.isfinite(given).any() else math.nan
    return figures


def followed(
    times: Floats, places: Floats, radii: Floats, walls: list[Box], given: argparse.Namespace
) -> dict[str, Any]:
    """Figures of the tracker."""
    bodies = MovingBodies(places, np.gradient(places, times, axis=0), radii)
    echoes = np.zeros(places.shape[:2], np.int64)
    # To and fro over 5 m.
    along = 2.5 - np.abs(np.mod(given.speed * times, 10.0) - 5.0)
    rng, tracker = np.random.default_rng(given.seed), Tracker(PeopleTrackerParams())
    bearings, step = fan(given.beams, math.tau, 0.0), fan_step(given.beams, math.tau)
    halves = [(0.5 * (wall.x[1] - wall.x[0]), 0.5 * (wall.y[1] - wall.y[0])) for wall in walls]
    boxes = [(*wall.centre, *half, 0.0, 2.4, 1.0, 0.0, 1.0) for wall, half in zip(walls, halves, strict=True)]
    made_of = np.array(boxes).reshape(-1, 9), np.zeros((0, 0), np.float32), np.zeros(7)
    origins = np.repeat([[0.0], [0.0], [0.3]], given.beams, axis=1)
    directions = np.stack([np.cos(bearings), np.sin(bearings), np.zeros(given.beams)])
    options = np.array([0.05, REACH, SIGMA, bearings[0], step])
    messages, spent = [], []
    warm_up()
    for row, now in enumerate(times.tolist()):
        obstacles = Obstacles(made_of[0], cylinders(bodies, row, given.body == "legs"), *made_of[1:])
        pose = np.array([along[row], 0.0, given.turn * now])
        ranges, beams = np.empty(given.beams), np.empty((given.beams, 5))
        read_laser(pose, origins, directions, obstacles, options, rng.standard_normal(given.beams), ranges)
        began = time.thread_time()
        place_beams(np.tile(pose, (given.beams, 1)), origins[:2].T, bearings, ranges, options[:2], beams)
        away = np.hypot(*(beams[None, :, 2:4] - places[row, :, None]).transpose(2, 0, 1))
        echoes[row] = ((away < radii[:, None] + 0.1) & (beams[:, 4] > 0.0)).sum(axis=1)
        at_wall = (np.abs(beams[:, 2:4]).max(axis=1) > ROOM - 0.3) & bool(walls)
        tracker.see(now, "laser", pose, beams, step, np.where(at_wall, 1, 0) if given.map else np.full(given.beams, -1))
        found = tracker.published(now)
        spent.append(1e3 * (time.thread_time() - began))
        means = found.means[:, :2].copy(), found.means[:, 2:].copy()
        messages.append(
            (now, Tracks(round(1e9 * now), found.ids, *means, found.covariances, found.radii, now - found.seen))
        )
    robot = np.column_stack([times, along, np.zeros(len(times))])
    seen = tracking_of({("people", "tracks"): messages}, bodies, robot, World("made"), 0.5)
    parts = seen.distances.mean(axis=0)
    numbers = [len(one.bodies) for one in seen.moments]
    near = np.hypot(*(places - robot[:, None, 1:]).transpose(2, 0, 1)) < NEAR
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
        **delays(bodies, echoes, near, seen),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", help="file and scene, as F.npz#hotel")
    parser.add_argument("--dynabarn", help="world of cylinders, as F.npz#41@0")
    parser.add_argument("--crowd", type=int, default=20, help="people of a made crowd")
    parser.add_argument("--from", dest="begin", type=float, default=0.0, help="time in the scene at which to begin, s")
    parser.add_argument("--for", dest="lasts", type=float, default=60.0, help="s")
    parser.add_argument("--body", choices=("legs", "disc"), default="legs")
    parser.add_argument("--beams", type=int, default=360)
    parser.add_argument("--turn", type=float, default=0.0, help="turn rate of the robot, rad/s")
    parser.add_argument("--speed", type=float, default=0.0, help="of the robot, m/s")
    parser.add_argument("--map", action="store_true", help="a map shows the walls")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    walls: list[Box] = []
    if given.dynabarn:
        given.body = "disc"
        *ways, radii = of_dynabarn(given.dynabarn, given.lasts)
    elif given.people:
        path, _, scene = given.people.partition("#")
        ways = list(recorded(path, scene, given.begin, given.begin + given.lasts))
        radii = np.full(ways[1].shape[1], DISC)
    else:
        ways, walls = list(made(given.crowd, given.lasts, np.random.default_rng(given.seed))), room(ROOM)
        radii = np.full(given.crowd, DISC)
    found = followed(*ways, radii, walls, given)
    print(json.dumps(found) if given.json else "\n".join(f"{name:22}{value:.3f}" for name, value in found.items()))


if __name__ == "__main__":
    main()
