"""Drives in lockstep that an avoider steers from start to goal: the same worlds and seeds for all avoiders.

Without a map, the reference is the straight line on an empty map, its look-ahead point is the goal, and only the
sensors see obstacles. With one, it is a planner's path on the true map and a point on it. The gate's limits apply.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from navloom import Box, OccupancyGrid, Place, Pose2D, World
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.lockstep_builder import lockstep_of
from navloom.engine.plugin_factory import make_plugins
from navloom.runs.episode_recorder import Recorder
from navloom.runs.episode_trail import TRUTH_MARGIN
from navloom.worlds.trial_worlds import clutter_world
from navloom_maps.barn import barn_world
from numpy.typing import NDArray

SONARS = '{name="sonars",kind="sonar_ring"}'
PAIRS = '{name="sonars",kind="sonar_ring",layout="pairs"}'
MIRRORS = '{name="sonars",kind="sonar_ring",critical_angle_deg=29.0}'
CROSSTALK = '{name="sonars",kind="sonar_ring",sigma=0.03,crosstalk=0.05}'
LASER = '{name="laser",kind="laser_2d",beams=181,field_of_view_deg=270.0,range_max=8.0}'
FINE_LASER = '{name="laser",kind="laser_2d",beams=720,field_of_view_deg=270.0,range_max=30.0}'
BOTH_KINDS = pytest.mark.parametrize("sensors", [SONARS, LASER], ids=["sonars", "laser"])
JACKAL = (
    "robot.footprint={length=0.42,width=0.33}",
    "robot.wheel_radius=0.098",
    "robot.half_track=0.19",
    "robot.max_linear=2.0",
    "robot.max_angular_deg=115.0",
    "robot.max_acceleration=2.0",
    "robot.max_deceleration=3.0",
    "platform.max_wheel_speed=30.0",
    "navigation.speed=[0.2,2.0]",
)
BARN = Path(os.environ.get("NAVLOOM_DATA", "")) / "barn" / "barn_dev.npz"
BOUNDS = (-8.0, -8.0, 8.0, 10.0)
UP = 0.5 * math.pi
"""Heading along the y axis, rad."""


DRIFT = 0.04
"""Error of the robot's place as a share of its way: nothing corrects its odometry here, whatever the avoider does."""


@dataclass(frozen=True)
class Ending:
    """How a drive ended.

    Attributes:
        word: reached, missed (it reports success, but is farther from its goal than DRIFT allows), trapped, contact or
            timeout.
        gap: Smallest distance of the footprint to an obstacle, m.
        seconds: Duration, s.
        track: (n, 2) positions, m, map frame.
    """

    word: str
    gap: float
    seconds: float
    track: NDArray[np.float64]


def drive(
    world: World,
    start: Place,
    goal: Place,
    seed: int,
    *,
    avoider: str,
    sensors: str = SONARS,
    params: Sequence[str] = (),
    settings: Sequence[str] = (),
    knows_map: bool = False,
    limit: float = 240.0,
) -> Ending:
    """Drive the paper's robot, 0.8 x 0.8 m, 0.5 m/s, 25 deg/s, or another by `settings`.

    Args:
        world: The world.
        start, goal: Places where the drive begins and ends.
        seed: Seed of every random stream.
        avoider: Name of the plugin.
        sensors: TOML tables of the sensors.
        params: TOML assignments to the avoider's table.
        settings: Overrides of the config.
        knows_map: Plan on the true map and look 1.5 m ahead; else drive straight to the goal.
        limit: Longest duration, s.
    """
    ahead = 1.5 if knows_map else 100.0
    planner = ['planner={plugin="astar",cell=0.1}'] if knows_map else []
    system = assemble(
        load_config(
            "paper",
            [
                'mapper={plugin="known_map"}',
                *planner,
                f"run.seed={seed}",
                f"run.stop_after={limit}",
                'world.ref="empty"',
                f"navigation.start={{x={start.x},y={start.y},heading_deg={math.degrees(start.heading)}}}",
                f"navigation.goal={{x={goal.x},y={goal.y}}}",
                f"navigation.goal_tolerance={world.goal_tolerance or 0.3}",
                f"navigation.look_ahead={ahead}",
                'navigation.handover="always"',
                "navigation.stuck_after=1000.0",
                "navigation.max_recoveries=0",
                f"sensor=[{sensors}]",
                f"avoider={{{','.join([f'plugin={avoider!r}', *params])}}}",
                *settings,
            ],
        )
    )
    system.world = world
    system.map = true_map(world) if knows_map else empty_map(world)
    make_plugins(system)
    recorder = Recorder()
    (result,) = lockstep_of(system, [recorder]).run(round(20 * limit) + 2).results
    words = {"succeeded": "reached", "collision": "contact", "stuck": result.reason}
    word, driven = words.get(result.outcome, result.outcome), recorder.driven
    allowed = system.goal_tolerance + TRUTH_MARGIN + DRIFT * float(np.hypot(*np.diff(driven, axis=0).T).sum())
    if word == "reached" and math.dist(driven[-1], (goal.x, goal.y)) > allowed:
        word = "missed"
    gap = math.inf if recorder.min_clearance is None else recorder.min_clearance
    return Ending(word, gap, recorder.truth[-1][0], driven)


def empty_map(world: World) -> OccupancyGrid:
    """A free map of the size of the world."""
    left, low, right, high = world.bounds
    floor = np.zeros((round((high - low) / 0.2), round((right - left) / 0.2)), np.int8)
    return OccupancyGrid(floor, 0.2, Pose2D(left, low, 0.0))


def true_map(world: World, cell: float = 0.05) -> OccupancyGrid:
    """A raster of a world of cylinders: occupied cells have their centre in one, or within half a cell of it."""
    left, low, right, high = world.bounds
    x = np.arange(left + 0.5 * cell, right, cell)
    y = np.arange(low + 0.5 * cell, high, cell)
    floor = np.zeros((y.size, x.size), np.int8)
    for post in world.obstacles:
        floor[np.hypot(x[None, :] - post.x, y[:, None] - post.y) <= post.radius + 0.5 * cell] = 100
    return OccupancyGrid(floor, cell, Pose2D(left, low, 0.0))


def field(seed: int, **options: object) -> Ending:
    """Drive through a clutter field of 20 posts, 1.6 m apart."""
    world = clutter_world(str(seed), Path())
    assert world.start is not None and world.goal is not None
    return drive(world, world.start, world.goal, seed, **options)  # type: ignore[arg-type]


def door(width: float, approach: int, **options: object) -> Ending:
    """Drive to a goal behind a doorway in a wall 16 m long, from a seeded place and heading."""
    stream = np.random.default_rng([approach, 17])
    wall = (
        Box("left of the door", (-8.0, -0.5 * width), (3.0, 3.2)),
        Box("right of the door", (0.5 * width, 8.0), (3.0, 3.2)),
    )
    start = Place(stream.uniform(-1.5, 1.5), stream.uniform(-0.5, 0.5), 0.5 * math.pi + stream.uniform(-0.5, 0.5))
    world = World("door", wall, bounds=(-11.0, -4.0, 11.0, 10.0))
    return drive(world, start, Place(0.0, 6.0), approach, **options)  # type: ignore[arg-type]


def way_past(ending: Ending) -> str:
    """Way of a drive to a door: through it or round the end of the wall; else the word of its ending."""
    if ending.word != "reached":
        return ending.word
    crossing = ending.track[np.argmax(ending.track[:, 1] > 3.1)]
    return "through" if abs(crossing[0]) < 2.0 else "around"


def dead_end(width: float, depth: float, approach: int, **options: object) -> Ending:
    """Drive towards a goal behind a dead end that is open towards the robot and ends at y = 5 m."""
    stream = np.random.default_rng([approach, 18])
    half, mouth = 0.5 * width, 5.0 - depth
    walls = (
        Box("left", (-half - 0.2, -half), (mouth, 5.2)),
        Box("right", (half, half + 0.2), (mouth, 5.2)),
        Box("end", (-half - 0.2, half + 0.2), (5.0, 5.2)),
    )
    start = Place(stream.uniform(-0.5, 0.5), mouth - 2.0, 0.5 * math.pi + stream.uniform(-0.3, 0.3))
    world = World("dead end", walls, bounds=(-9.0, -6.0, 9.0, 12.0))
    return drive(world, start, Place(0.0, 8.0), approach, **options)  # type: ignore[arg-type]


def sudden(seed: int, **options: object) -> Ending:
    """Drive at 0.5 m/s towards a box of 0.3 m that appears 0.35 to 0.7 m before the front of the robot."""
    stream = np.random.default_rng([seed, 5])
    ahead, aside, time = stream.uniform(0.75, 1.1), stream.uniform(-0.5, 0.5), stream.uniform(2.2, 3.0)
    near = 0.5 * (time - 0.5) + ahead  # half a second at half the speed: the start
    box = Box("box", (aside - 0.15, aside + 0.15), (near, near + 0.3), appears_at=time)
    world = World("sudden", (box,), bounds=(-8.0, -6.0, 8.0, 10.0))
    return drive(world, Place(0.0, 0.0, 0.5 * math.pi), Place(0.0, 7.0), seed, **options)  # type: ignore[arg-type]


def barn(number: int, settings: Sequence[str] = JACKAL, **options: object) -> Ending:
    """Drive a Jackal with a 2D laser of 720 beams at up to 2 m/s through a BARN world."""
    world = barn_world(f"{BARN}#{number}", Path())
    assert world.start is not None and world.goal is not None
    options = {"sensors": FINE_LASER, "limit": world.time_limit or 100.0, "settings": settings, **options}
    return drive(world, world.start, world.goal, number, **options)  # type: ignore[arg-type]


def all_of(work: Callable[..., Ending], rows: Iterable[tuple[object, ...]], **options: object) -> list[Ending]:
    """Run one drive for each row of arguments, on two cores."""
    with ProcessPoolExecutor(2) as pool:
        waiting = [pool.submit(work, *row, **options) for row in rows]
        return [drive.result() for drive in waiting]


def told(name: str, endings: Sequence[Ending], word: Callable[[Ending], str] = lambda e: e.word) -> Counter[str]:
    """Count how drives ended; print the counts and the smallest gap."""
    words = Counter(word(ending) for ending in endings)
    print(f"{name}: {dict(sorted(words.items()))}, least gap {min(ending.gap for ending in endings):.3f} m")
    return words


def assignments(values: Mapping[str, object]) -> list[str]:
    """Parameters as TOML assignments."""
    return [f"{key}={str(value).lower() if isinstance(value, bool) else repr(value)}" for key, value in values.items()]
