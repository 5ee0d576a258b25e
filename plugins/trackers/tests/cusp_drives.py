"""Drives in lockstep along paths with headings: cusps, reverse starts, sideways; steered, differential, holonomic."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from navloom import Box, OccupancyGrid, Path, Planner, PlannerInput, Pose2D, World
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.lockstep_builder import lockstep_of
from navloom.engine.plugin_factory import make_plugins
from navloom.runs.episode_recorder import Recorder
from navloom.runs.episode_trail import trail_of
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Leg = tuple[float, float]

STEERED = [
    "robot.footprint={ polygon=[[-0.25,-0.3],[0.85,-0.3],[0.85,0.3],[-0.25,0.3]] }",
    'robot.drive="ackermann"',
    "robot.wheelbase=0.6",
    "robot.max_steering_deg=35",
    "robot.max_steering_rate_deg=60",
    "robot.max_angular_deg=60",
]
"""A body of 1.1 x 0.6 m that turns on circles of 0.86 m radius at least."""
HOLONOMIC = ["robot.footprint={ length=0.8, width=0.4 }", 'robot.drive="holonomic"', "robot.max_angular_deg=60"]
DIFFERENTIAL = ["robot.footprint={ length=0.8, width=0.4 }", "robot.max_angular_deg=60"]


def arcs(*legs: Leg, heading: float = 0.0, step: float = 0.05) -> tuple[Floats, Floats]:
    """Points (n, 2), m, and headings (n,), rad, from the origin along arcs.

    Args:
        legs: Length, m, negative backwards, and turn, rad, of each.
        heading: At the origin, rad.
        step: Largest distance between points, m.
    """
    x, y, poses = 0.0, 0.0, [(0.0, 0.0, heading)]
    for length, turn in legs:
        count = math.ceil(abs(length) / step)
        chord = length / count * float(np.sinc(0.5 * turn / count / math.pi))
        for _ in range(count):
            middle = heading + 0.5 * turn / count
            x, y, heading = x + chord * math.cos(middle), y + chord * math.sin(middle), heading + turn / count
            poses.append((x, y, heading))
    found = np.array(poses)
    return found[:, :2], found[:, 2]


def three_point_turn() -> tuple[Floats, Floats]:
    """Left, back, left: 60 degrees each on circles of 1 m, from 1 m of straight way to 1 m of straight way back."""
    third = math.pi / 3.0
    return arcs((1.0, 0.0), (third, third), (-third, third), (third, third), (1.0, 0.0))


def parking() -> tuple[Floats, Floats]:
    """Past the place, then back into it along an S, 1.2 m aside."""
    bend = math.acos(1.0 - 0.6 / 1.2)
    return arcs((3.0, 0.0), (-1.2 * bend, bend), (-1.2 * bend, -bend), (-0.3, 0.0))


def backwards() -> tuple[Floats, Floats]:
    """Out backwards round a quarter, and on forwards."""
    return arcs((-1.0, 0.0), (-0.6 * math.pi, -0.5 * math.pi), (2.0, 0.0))


CUSPS = {"three_point_turn": three_point_turn, "parking": parking, "backwards": backwards}


class HeadedPath(Planner):
    """Answers every request with the same path with headings."""

    name = "headed_path"

    def __init__(self, points: Floats, headings: Floats) -> None:
        self.points, self.headings = points, headings

    def plan(self, given: PlannerInput) -> Path:
        length = float(np.hypot(*np.diff(self.points, axis=0).T).sum())
        return Path(given.request.request_id, self.points, length, None, self.headings)


@dataclass(frozen=True)
class Drive:
    """Results of a drive.

    Attributes:
        outcome, reason: Of the goal.
        seconds: Duration, s.
        rms, most: RMS and largest distance of the real robot from its trajectory, m.
        overshoot: Largest way beyond a cusp, m.
        off, turned: Distance from the goal, m, and heading error there, rad.
        contacts: Ticks in contact.
        clearance: Least gap to an obstacle, m.
        track: (n, 5) time, s, true x, y, m, heading, rad, and speed, m/s.
    """

    outcome: str
    reason: str
    seconds: float
    rms: float
    most: float
    overshoot: float
    off: float
    turned: float
    contacts: int
    clearance: float
    track: Floats


def drive(
    tracker: str,
    path: tuple[Floats, Floats],
    body: Sequence[str] = STEERED,
    settings: Sequence[str] = (),
    walls: Sequence[Box] = (),
) -> Drive:
    """Drive along a path with headings, with exact odometry, to its last heading."""
    points, headings = path
    start, goal = (
        f"{{x={points[k, 0]},y={points[k, 1]},heading_deg={math.degrees(math.remainder(headings[k], math.tau))}}}"
        for k in (0, -1)
    )
    system = assemble(
        load_config(
            "paper",
            [
                "run.stop_after=180.0",
                'world.ref="empty"',
                f"navigation.start={start}",
                f"navigation.goal={goal}",
                "navigation.goal_tolerance=0.1",
                'navigation.handover="never"',
                'sensor=[{name="laser",kind="laser_2d",beams=361,field_of_view_deg=360,range_max=10.0,sigma=0.005}]',
                'mapper={plugin="known_map"}',
                'avoider={plugin="dwa"}',
                'platform={plugin="sensors_sim",noise=false}',
                f'controller={{plugin="{tracker}"}}',
                *body,
                *settings,
            ],
        )
    )
    system.world = World("floor", tuple(walls), bounds=(-9.0, -9.0, 9.0, 9.0))
    system.map = OccupancyGrid(np.zeros((18, 18), np.int8), 1.0, Pose2D(-9.0, -9.0, 0.0))
    make_plugins(system)
    system.parts[("planner", system.config.planner.instance)].plugin = HeadedPath(points, headings)
    recorder = Recorder()
    log = lockstep_of(system, [recorder]).run(3602)
    (result,) = log.results
    truth = np.array(recorder.truth)
    track, samples = truth[:, :5], recorder.trajectories[0].samples
    away = np.array([np.hypot(*(samples[:, 1:3] - place).T).min() for place in track[:, 1:3]])
    found = trail_of(system, recorder, log, result)
    gaps, turned = truth[:, 5], math.remainder(track[-1, 3] - headings[-1], math.tau)
    return Drive(
        found.outcome, result.reason, float(track[-1, 0]), math.sqrt(float((away**2).mean())), float(away.max()),
        beyond_cusps(samples, track), math.hypot(*(track[-1, 1:3] - points[-1])), turned, int((gaps == 0.0).sum()),
        float(gaps.min()), track,
    )  # fmt: skip


def beyond_cusps(samples: Floats, track: Floats) -> float:
    """Largest way, m, that a track (n, 5) leads beyond a cusp of a trajectory (k, 6), until it leads back."""
    most, last = 0.0, 0
    for k in np.flatnonzero(np.diff(np.sign(samples[:, 5]))):
        sign = math.copysign(1.0, samples[k, 5])
        while last < len(track) - 1 and (
            np.hypot(*(track[last, 1:3] - samples[k, 1:3])) > 0.2 or sign * track[last, 4] >= 0.0
        ):
            last += 1
        dx, dy = track[last, 1:3] - samples[k, 1:3]
        most = max(most, sign * float(math.cos(samples[k, 3]) * dx + math.sin(samples[k, 3]) * dy))
    return most
