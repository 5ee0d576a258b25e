"""World scheme `fleet:SCENE#SEED`: halls with a start and a goal for each robot of a fleet, in one another's way."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from navloom.geometry.world import Box, Place, World
from navloom.worlds import WorldError, did_you_mean, options_of

from navloom_maps.crowds import Area, hall
from navloom_maps.option_values import sides_of

__all__ = ["SCENES", "fleet_world"]

Point = tuple[float, float]
Scene = tuple[list[tuple[Point, Point]], list[Box], Area]
"""From where to where each robot drives, what stands between them, and the free area of the hall."""

_ROW = 1.5
"""Distance of the starts of robots behind each other, m."""
_LANE = 1.2
"""Least distance of the starts of robots beside each other, m."""
_SIGMA = 0.05
"""Standard deviation of a start and a goal in x and y, m: in exact symmetry all robots would stop for each other."""
_FARTHEST = 0.15
"""Farthest that they are moved in x and y, m."""
_WALL = 0.2
"""Thickness of the wall with the door, m."""
_BESIDE = 1.5
"""Room beside the outermost starts of an open hall, m: its walls are seen by a laser that reaches 10 m."""
_SHELF, _DEPTH = 6.0, 1.0
"""Length and depth of a shelf, m."""
_MOST = 200


def fleet_world(argument: str, base: Path) -> World:
    """World scheme `fleet:SCENE#SEED`: a hall with a task for each robot of a fleet.

    The seed moves each start and goal by some 5 cm; in the scene `aisles` it also deals out the goals.

    Options:
        robots: Their number, even but in a circle.
        width: Width, m, of what the scene is about, see `SCENES`.

    Raises:
        WorldError: The scene, the seed or an option is not valid.
    """
    reference = f"fleet:{argument}"
    name, options = options_of(argument, {"robots": "10", "width": ""})
    scene, _, number = name.partition("#")
    if scene not in SCENES:
        raise WorldError(f"{reference}: no scene {scene!r}; {did_you_mean(scene, SCENES)}")
    if re.fullmatch(r"\d{1,18}", number, re.ASCII) is None:
        raise WorldError(f"{reference}: expected a seed after the scene, a whole number from 0, as in fleet:{scene}#3")
    seed = int(number)
    count = _count(reference, options["robots"], scene)
    make, limits = SCENES[scene]
    width = sides_of(reference, "width", options["width"], 1, limits)[0] if options["width"] else None
    ways, obstacles, area = make(count, width, seed)
    tasks = tuple(_task(way, np.random.default_rng((seed, 0, k))) for k, way in enumerate(ways))
    walls, bounds = hall(area)
    start, goal = tasks[0]
    return World(reference, (*walls, *obstacles), start=start, goal=goal, bounds=bounds, tasks=tasks)


def _circle(count: int, width: float | None, seed: int) -> Scene:
    """Robots on a circle, each of which drives to the opposite side; `width` is its diameter."""
    radius = 0.5 * width if width else max(3.0, 0.4 * count)
    turns = [math.tau * k / count for k in range(count)]
    places = [(radius * math.cos(turn), radius * math.sin(turn)) for turn in turns]
    half = radius + _BESIDE
    return [((x, y), (-x, -y)) for x, y in places], [], (-half, -half, half, half)


def _corridor(count: int, width: float | None, seed: int) -> Scene:
    """Two groups at the ends of a corridor, `width` m wide, that change ends."""
    width = width or 3.0
    ways = _swapped(count, _lanes(width), 3.0)
    end = _end(ways) + 1.5
    return ways, [], (-end, -0.5 * width, end, 0.5 * width)


def _doorway(count: int, width: float | None, seed: int) -> Scene:
    """Two groups in two rooms that change rooms through one door, `width` m wide."""
    half, side = 0.5 * (width or 1.2), 3.0
    ways = _swapped(count, _lanes(2.0 * side - 1.5), 2.5)
    end, thick = _end(ways) + 1.5, 0.5 * _WALL
    walls = [
        Box("wall right of the door", (-thick, thick), (-side, -half)),
        Box("wall left of the door", (-thick, thick), (half, side)),
    ]
    return ways, walls, (-end, -side, end, side)


def _crossing(count: int, width: float | None, seed: int) -> Scene:
    """Two streams, each `width` m wide, that cross at a right angle."""
    along = _swapped(count, _lanes(width or 3.0), 3.0)[: count // 2]
    half = max(_end(along), 0.5 * (width or 3.0)) + _BESIDE
    return [*along, *(((sy, sx), (gy, gx)) for (sx, sy), (gx, gy) in along)], [], (-half, -half, half, half)


def _aisles(count: int, width: float | None, seed: int) -> Scene:
    """A store: two groups change sides through aisles, `width` m wide, between shelves."""
    aisle, half = width or 1.6, count // 2
    pitch, aisles = aisle + _DEPTH, max(2, math.ceil(count / 4), math.ceil((half * _LANE + _DEPTH) / (aisle + _DEPTH)))
    long, end = aisles * pitch - _DEPTH, 0.5 * _SHELF + 3.0
    shelves = [
        Box(f"shelf {k}", (k * pitch - _DEPTH, k * pitch), (-0.5 * _SHELF, 0.5 * _SHELF)) for k in range(1, aisles)
    ]
    spots = [(k + 0.5) * long / half for k in range(half)]
    ways = []
    for side in (-1.0, 1.0):
        # Dealt out one after the other, from a stream of its own each, so that no two have one goal.
        dealt = np.random.default_rng((seed, 1 if side < 0.0 else 2)).permutation(half).tolist()
        y = side * (end - 1.0)
        ways += [((x, y), (spots[to], -y)) for x, to in zip(spots, dealt, strict=True)]
    return ways, shelves, (0.0, -end, long, end)


SCENES: dict[str, tuple[Callable[[int, float | None, int], Scene], tuple[float, float]]] = {
    "circle": (_circle, (4.0, 100.0)),
    "corridor": (_corridor, (1.0, 20.0)),
    "doorway": (_doorway, (0.6, 4.0)),
    "crossing": (_crossing, (1.0, 20.0)),
    "aisles": (_aisles, (0.8, 5.0)),
}
"""Each scene, and the least and greatest width of its circle, corridor, door, streams or aisles, m."""


def _swapped(count: int, lanes: Sequence[float], first: float) -> list[tuple[Point, Point]]:
    """Two groups in rows, the first `first` m from the middle, each to the other side of it, the front row to the rear.

    So nobody has to pass one of its own group that has arrived.
    """
    half, ways = count // 2, []
    rows = math.ceil(half / len(lanes))
    for side in (-1.0, 1.0):
        for k in range(half):
            row, y = k // len(lanes), lanes[k % len(lanes)]
            ways.append(((side * (first + row * _ROW), y), (-side * (first + (rows - 1 - row) * _ROW), y)))
    return ways


def _lanes(width: float) -> list[float]:
    """Middle lines of as many lanes as there is room for, m."""
    count = max(1, math.floor(width / _LANE))
    return [((k + 0.5) / count - 0.5) * width for k in range(count)]


def _end(ways: Sequence[tuple[Point, Point]]) -> float:
    """Farthest x of a start or goal, m."""
    return max(abs(x) for way in ways for x, _ in way)


def _task(way: tuple[Point, Point], rng: np.random.Generator) -> tuple[Place, Place]:
    """Start and goal, each moved a little; the robot starts with its front to the goal."""
    (sx, sy), (gx, gy) = np.array(way) + np.clip(rng.normal(0.0, _SIGMA, (2, 2)), -_FARTHEST, _FARTHEST)
    heading = math.atan2(gy - sy, gx - sx)
    return Place(float(sx), float(sy), heading), Place(float(gx), float(gy))


def _count(reference: str, text: str, scene: str) -> int:
    count = int(text) if text.isascii() and text.isdigit() and len(text) <= 4 else 0
    if not 2 <= count <= _MOST:
        raise WorldError(f"{reference}: robots={text}: expected a number from 2 to {_MOST}")
    if count % 2 and scene != "circle":
        raise WorldError(f"{reference}: robots={text}: expected an even number, half in each group")
    return count
