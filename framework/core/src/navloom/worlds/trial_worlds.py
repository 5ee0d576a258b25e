"""Small worlds for trying a method: an empty floor, corridors, doorways, a trap, and random posts."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from navloom.geometry.world import Box, Cylinder, Place, World
from navloom.worlds.world_errors import WorldError, seed_of

__all__ = ["clutter_world", "corridor", "crossing_person", "door_world", "doorway", "empty", "u_trap"]

_UP = 0.5 * math.pi

_POSTS, _POST_RADIUS, _GAP = 20, 0.1, 1.6
_FIELD = (-6.0, 1.0, 6.0, 13.0)
_TRIES = 5_000
_DOORS = (0.8, 4.0)
_ROOM = (
    Box("left wall", (-4.2, -4.0), (-2.0, 8.0)),
    Box("right wall", (4.0, 4.2), (-2.0, 8.0)),
    Box("rear wall", (-4.2, 4.2), (-2.2, -2.0)),
    Box("front wall", (-4.2, 4.2), (8.0, 8.2)),
)


def empty() -> World:
    """An empty floor."""
    return World("empty", start=Place(0.0, 0.0, _UP), goal=Place(0.0, 6.0), bounds=(-5.0, -2.0, 5.0, 8.0))


def corridor() -> World:
    """Two walls 2 m apart, 10 m long."""
    walls = (Box("left wall", (-1.2, -1.0), (-1.0, 9.0)), Box("right wall", (1.0, 1.2), (-1.0, 9.0)))
    return World("corridor", walls, start=Place(0.0, 0.0, _UP), goal=Place(0.0, 8.0), bounds=(-2.0, -2.0, 2.0, 10.0))


def doorway() -> World:
    """A wall across a room, with a door of 1.2 m that is 2 m beside the straight line to the goal."""
    walls = (
        *_ROOM,
        Box("door wall left", (-4.0, 1.4), (3.0, 3.2)),
        Box("door wall right", (2.6, 4.0), (3.0, 3.2)),
    )
    return World("doorway", walls, start=Place(0.0, 0.0, _UP), goal=Place(0.0, 6.0), bounds=(-4.2, -2.2, 4.2, 8.2))


def crossing_person() -> World:
    """A corridor 4 m wide and 13 m long that a person crosses back and forth at 0.4 m/s, resting 5 s at each side.

    The person never gives way, but walks no faster than a robot may drive. A robot that drives straight at 0.4 m/s sees
    the person cross about 2 m ahead. A person who walks into the robot's side would not test the robot.
    """
    walls = (Box("left wall", (-2.2, -2.0), (-2.0, 11.0)), Box("right wall", (2.0, 2.2), (-2.0, 11.0)))
    rest, walk, side = 5.0, 7.5, 1.5
    left, right, y = -side, side, 4.5
    crossing = (
        (0.0, left, y), (rest, left, y), (rest + walk, right, y), (2.0 * rest + walk, right, y),
        (2.0 * (rest + walk), left, y),
    )  # fmt: skip
    person = Cylinder("person", left, y, 0.25, (0.0, 1.8), waypoints=crossing, loops=True)
    return World(
        "crossing_person",
        (*walls, person),
        start=Place(0.0, 0.0, _UP),
        goal=Place(0.0, 9.0),
        bounds=(-2.4, -2.0, 2.4, 11.0),
    )


def door_world(argument: str, base: Path) -> World:
    """An unmapped wall across a room, with a door 1 m beside the straight line to the goal.

    The wall appears when the first sweep has ended; for robots without a sweep it is there from the start. If it were
    mapped, the planner would find the door and not the avoider.

    Args:
        argument: Width of the door, m, from 0.8 to 4.
        base: Not used, as no file is read.

    Raises:
        WorldError: The width is not such a number.
    """
    try:
        width = float(argument)
    except ValueError:
        width = math.nan
    # Negated, so that NaN is refused too.
    if not _DOORS[0] <= width <= _DOORS[1]:
        raise WorldError(f"door:{argument}: expected a width from {_DOORS[0]:g} to {_DOORS[1]:g} m, as in door:2.0")
    left, right = 1.0 - 0.5 * width, 1.0 + 0.5 * width
    wall = (
        Box("door wall left", (-4.0, left), (3.0, 3.2), appears_after_sweep=True),
        Box("door wall right", (right, 4.0), (3.0, 3.2), appears_after_sweep=True),
    )
    return World(
        f"door:{argument}",
        (*_ROOM, *wall),
        start=Place(0.0, 0.0, _UP),
        goal=Place(0.0, 6.0),
        bounds=(-4.2, -2.2, 4.2, 8.2),
    )


def u_trap() -> World:
    """A dead end of 3 m by 3 m, open towards the start: a method that only steers to the goal does not get out."""
    walls = (
        Box("trap left", (-1.7, -1.5), (2.0, 5.2)),
        Box("trap right", (1.5, 1.7), (2.0, 5.2)),
        Box("trap end", (-1.7, 1.7), (5.0, 5.2)),
    )
    return World("u_trap", walls, start=Place(0.0, 0.0, _UP), goal=Place(0.0, 8.0), bounds=(-5.0, -2.0, 5.0, 10.0))


def clutter_world(argument: str, base: Path) -> World:
    """20 posts of 0.2 m diameter on 12 m x 12 m with gaps of at least 1.6 m; the start in front, the goal behind.

    Args:
        argument: The seed, an integer >= 0.
        base: Not used, as no file is read.

    Raises:
        WorldError: The seed is not such a number.
    """
    stream = np.random.default_rng(seed_of("clutter", argument))
    least = _GAP + 2.0 * _POST_RADIUS
    centres: list[tuple[float, float]] = []
    for x, y in stream.uniform(_FIELD[:2], _FIELD[2:], size=(_TRIES, 2)).tolist():
        if all(math.hypot(x - a, y - b) >= least for a, b in centres):
            centres.append((x, y))
        if len(centres) == _POSTS:
            break
    else:
        raise WorldError(f"clutter:{argument}: no room for {_POSTS} posts; take another seed")
    posts = tuple(Cylinder(f"post {k}", x, y, _POST_RADIUS) for k, (x, y) in enumerate(centres, start=1))
    # 1.5 m outside the field, so that no post stands on them.
    start, goal = Place(0.0, -0.5, _UP), Place(0.0, 14.5)
    return World(f"clutter:{argument}", posts, start=start, goal=goal, bounds=(-7.0, -2.0, 7.0, 16.0))
