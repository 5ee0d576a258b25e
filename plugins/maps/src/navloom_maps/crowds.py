"""World schemes `crowd:SEED` and `people_flow:SEED`: halls in which people walk who give way to each other.

Every draw is made when the world is read, from streams of its own for each person: whatever the robot does, the same
people have the same goals, and more people leave those of lower numbers as they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from navloom.geometry.actors import Actor, Body, Walk
from navloom.geometry.world import Box, Place, World
from navloom.worlds import WorldError, options_of, seed_of

from navloom_maps.option_values import share_of, sides_of

__all__ = ["Area", "crowd_flow", "crowd_world", "hall", "people_flow_world"]

Point = tuple[float, float]
Area = tuple[float, float, float, float]
"""Lowest x, lowest y, highest x, highest y, m."""
_PERSON = Body("legs", 0.44, 0.44, (0.0, 1.75))
_SPEEDS = (0.8, 1.4)
"""Slowest and fastest wanted speed of a person, m/s."""
_APART = 0.7
"""Least distance of two people at the start, m."""
_CLEAR = 1.5
"""Least distance of a person from the robot at the start, m."""
_WALL = 0.2
"""Thickness of walls, m."""
_BESIDE = 0.5
"""Least distance of the places that people go to from the edges of their area, m."""
_GOALS = 100
"""Goals of a person, who then begins with the first again: enough for some seven minutes in 10 x 10 m."""
_CROWD = {"people": "20", "size": "10", "blind": "0.5"}
_FLOW = {"people": "16", "size": "16x6", "against": "0.5", "blind": "0.5", "way": "along"}
_SIZES = (4.0, 100.0)
_DENSEST = 1.0
"""Most people to a square metre."""


def crowd_world(argument: str, base: Path) -> World:
    """World scheme `crowd:SEED`: people in a square who walk from goal to goal, and a robot that crosses it.

    Options:
        people: Their number.
        size: Side of their square, m. The robot starts and arrives 1 m outside.
        blind: Share of people, from 0 to 1, that do not give way to robots.

    Raises:
        WorldError: The seed or an option is not valid.
    """
    reference = f"crowd:{argument}"
    name, options = options_of(argument, _CROWD)
    seed = seed_of("crowd", name)
    (size,) = sides_of(reference, "size", options["size"], 1, _SIZES)
    count = _count(reference, options["people"], size * size)
    blind = _chosen(seed, 1, count, share_of(reference, "blind", options["blind"]))
    start, goal = Place(0.5 * size, -1.0, 0.5 * math.pi), Place(0.5 * size, size + 1.0)

    def walk(number: int, first: Point, rng: np.random.Generator, speed: float) -> Walk:
        goals = rng.uniform(_BESIDE, size - _BESIDE, (_GOALS, 2)).tolist()
        sees = number not in blind
        return Walk(first, tuple((x, y) for x, y in goals), speed, 1.5 * speed, sees_robots=sees, loops=True)

    actors = _people(seed, count, (_BESIDE, _BESIDE, size - _BESIDE, size - _BESIDE), start, walk)
    return _hall(reference, (0.0, -2.0, size, size + 2.0), start, goal, actors)


def people_flow_world(argument: str, base: Path) -> World:
    """World scheme `people_flow:SEED`: people who walk through a hall in both directions, and enter again at its ends.

    Options:
        people: Their number.
        size: Length x width of the flow, m. It goes along x.
        against: Share of people, from 0 to 1, that walk in the direction of -x.
        blind: Share of people, from 0 to 1, that do not give way to robots.
        way: "along": the robot drives through a corridor in the direction of x; "across": through the flow, along y.

    Raises:
        WorldError: The seed or an option is not valid.
    """
    reference = f"people_flow:{argument}"
    name, options = options_of(argument, _FLOW)
    seed = seed_of("people_flow", name)
    length, width = sides_of(reference, "size", options["size"], 2, (2.0, _SIZES[1]))
    count = _count(reference, options["people"], length * width)
    against, blind = (
        _chosen(seed, stream, count, share_of(reference, key, options[key]))
        for stream, key in ((2, "against"), (1, "blind"))
    )
    if options["way"] not in ("along", "across"):
        raise WorldError(f"{reference}: way={options['way']}: expected along or across")
    is_along = options["way"] == "along"
    if is_along:
        start, goal, area = Place(0.0, 0.5 * width), Place(length, 0.5 * width), (-3.0, 0.0, length + 3.0, width)
    else:
        start, goal = Place(0.5 * length, -1.5, 0.5 * math.pi), Place(0.5 * length, width + 1.5)
        area = (-3.0, -3.0, length + 3.0, width + 3.0)

    def walk(number: int, first: Point, rng: np.random.Generator, speed: float) -> Walk:
        ends = (-2.0, length + 2.0)[:: -1 if number in against else 1]
        lanes = rng.uniform(_BESIDE, width - _BESIDE, 2).tolist()
        (entry, goal), sees = zip(ends, lanes, strict=True), number not in blind
        return Walk(first, (goal,), speed, 1.5 * speed, flows=True, sees_robots=sees, entry=entry)

    actors = _people(seed, count, (0.0, _BESIDE, length, width - _BESIDE), start, walk)
    return _hall(reference, area, start, goal, actors)


def crowd_flow() -> World:
    """Sixteen people walk across the robot's way in both directions; half of them do not give way to it."""
    return replace(people_flow_world("0?way=across", Path()), name="crowd_flow")


def _people(
    seed: int, count: int, area: Area, robot: Place,
    walk: Callable[[int, Point, np.random.Generator, float], Walk],
) -> tuple[Actor, ...]:  # fmt: skip
    """People at places in an area, lowest and highest x and y, m, apart from each other and from the robot."""
    places: list[Point] = []
    actors = []
    for number in range(count):
        rng = np.random.default_rng((seed, 0, number))
        while True:
            x, y = rng.uniform(area[:2], area[2:]).tolist()
            if math.hypot(x - robot.x, y - robot.y) >= _CLEAR and all(math.dist((x, y), p) >= _APART for p in places):
                break
        places.append((x, y))
        course = walk(number, (x, y), rng, float(rng.uniform(*_SPEEDS)))
        actors.append(Actor(f"person {number + 1}", course, _PERSON))
    return tuple(actors)


def _hall(name: str, area: Area, start: Place, goal: Place, actors: tuple[Actor, ...]) -> World:
    """A hall, from its lowest to its highest x and y, m, with walls around it."""
    walls, bounds = hall(area)
    return World(name, walls, start=start, goal=goal, bounds=bounds, actors=actors)


def hall(area: Area) -> tuple[tuple[Box, ...], Area]:
    """Walls around an area, and the area with them."""
    x0, y0, x1, y1 = area
    left, low, right, high = x0 - _WALL, y0 - _WALL, x1 + _WALL, y1 + _WALL
    walls = (
        Box("left wall", (left, x0), (low, high)), Box("right wall", (x1, right), (low, high)),
        Box("rear wall", (left, right), (low, y0)), Box("front wall", (left, right), (y1, high)),
    )  # fmt: skip
    return walls, (left, low, right, high)


def _count(reference: str, text: str, area: float) -> int:
    most = math.floor(_DENSEST * area)
    if not (text.isascii() and text.isdigit() and len(text) <= 4 and 1 <= int(text) <= most):
        raise WorldError(f"{reference}: people={text}: expected a number from 1 to {most}, one to a square metre")
    return int(text)


def _chosen(seed: int, stream: int, count: int, share: float) -> set[int]:
    """Which of the people have a property: as many as the share says, drawn from a stream."""
    return set(np.random.default_rng((seed, stream)).permutation(count)[: round(share * count)].tolist())
