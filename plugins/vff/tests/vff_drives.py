"""Drives in lockstep with the VFF in charge from start to goal: the map is empty, so only the sensors know obstacles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from navloom import Box, OccupancyGrid, Place, Pose2D, World
from navloom.config import load_config
from navloom.runtime.build import assemble, make_plugins
from navloom.runtime.executor import lockstep_of
from navloom.study.recorder import Recorder
from navloom.worlds.small import clutter_world, u_trap

SONARS = '{name="sonars",kind="sonar_ring"}'
LASER = '{name="laser",kind="laser_2d",beams=181,field_of_view_deg=270.0,range_max=8.0}'


class Ending(NamedTuple):
    """How a drive ended: outcome and reason of the goal, least gap to anything, m, and duration, s."""

    outcome: str
    reason: str
    gap: float
    seconds: float
    track: np.ndarray


def drive(world, start, goal, seed, sensor=SONARS, overrides: Sequence[str] = (), plugin="vff", seconds=240.0) -> Ending:
    """Drive the paper's robot to a goal, map frame, m; nothing but the avoider decides on the way.

    The reference is the straight line of an empty map, and its look-ahead point the goal itself.
    """
    place = f"x={start.x},y={start.y},heading_deg={math.degrees(start.heading)}"
    system = assemble(
        load_config(
            "paper",
            [
                f"run.seed={seed}",
                f"run.stop_after={seconds}",
                'world.ref="empty"',
                f"navigation.start={{{place}}}",
                f"navigation.goal={{x={goal.x},y={goal.y}}}",
                "navigation.goal_tolerance=0.3",
                "navigation.look_ahead=100.0",
                'navigation.handover="always"',
                "navigation.stuck_after=1000.0",
                "navigation.max_recoveries=0",
                f"sensor=[{sensor}]",
                'mapper={plugin="known_map"}',
                f'avoider={{plugin="{plugin}"{"".join("," + text for text in overrides)}}}',
            ],
        )
    )
    system.world = world
    left, low, right, high = world.bounds
    cells = np.zeros((round((high - low) / 0.2), round((right - left) / 0.2)), np.int8)
    system.map = OccupancyGrid(cells, 0.2, Pose2D(left, low, 0.0))
    make_plugins(system)
    recorder = Recorder()
    log = lockstep_of(system, [recorder]).run(round(seconds / 0.05) + 2)
    result = log.results[-1]
    gap = math.inf if recorder.min_clearance is None else recorder.min_clearance
    return Ending(result.outcome, result.reason, gap, recorder.truth[-1][0], np.array(recorder.truth))


def field(seed: int, **options) -> Ending:
    """A clutter field of 20 posts between start and goal."""
    world = clutter_world(str(seed), Path())
    assert world.start is not None and world.goal is not None
    return drive(world, world.start, world.goal, seed, **options)


def door(width: float, approach: int, **options) -> Ending:
    """A doorway in a long wall, approached from a seeded place and heading."""
    stream = np.random.default_rng([approach, 17])
    wall = (Box("left", (-8.0, -0.5 * width), (3.0, 3.2)), Box("right", (0.5 * width, 8.0), (3.0, 3.2)))
    start = Place(stream.uniform(-1.5, 1.5), stream.uniform(-0.5, 0.5), 0.5 * math.pi + stream.uniform(-0.5, 0.5))
    return drive(World("door", wall, bounds=(-10.0, -4.0, 10.0, 10.0)), start, Place(0.0, 6.0), approach, **options)


def dead_end(width: float, depth: float, approach: int, **options) -> Ending:
    """A dead end, open towards the robot, its end wall at y = 5 m between the robot and its goal."""
    stream = np.random.default_rng([approach, 18])
    half, mouth = 0.5 * width, 5.0 - depth
    walls = (
        Box("left", (-half - 0.2, -half), (mouth, 5.2)),
        Box("right", (half, half + 0.2), (mouth, 5.2)),
        Box("end", (-half - 0.2, half + 0.2), (5.0, 5.2)),
    )
    start = Place(stream.uniform(-0.5, 0.5), mouth - 2.0, 0.5 * math.pi + stream.uniform(-0.3, 0.3))
    return drive(World("dead end", walls, bounds=(-9.0, -6.0, 9.0, 12.0)), start, Place(0.0, 8.0), approach, **options)


def way_past(ending: Ending, width: float) -> str:
    """Of a drive to a door: through it, around the wall, or the reason why neither."""
    if ending.outcome != "succeeded":
        return ending.reason
    crossing = ending.track[np.argmax(ending.track[:, 2] > 3.1)]
    return "through" if abs(crossing[1]) < 0.5 * width else "around"
