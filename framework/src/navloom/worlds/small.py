"""Small worlds to try a method in: an empty floor, a corridor, a doorway, a trap, and random posts."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from navloom.geometry.world import Box, Cylinder, Place, World
from navloom.worlds.errors import WorldError

__all__ = ["clutter_world", "corridor", "doorway", "empty", "u_trap"]

_UP = 0.5 * math.pi

_POSTS, _POST_RADIUS, _GAP = 20, 0.1, 1.6
_FIELD = (-6.0, 1.0, 6.0, 13.0)
_TRIES = 5_000


def empty() -> World:
    """Nothing but floor."""
    return World("empty", start=Place(0.0, 0.0, _UP), goal=Place(0.0, 6.0), bounds=(-5.0, -2.0, 5.0, 8.0))


def corridor() -> World:
    """Two walls 2 m apart, 10 m long."""
    walls = (Box("left wall", (-1.2, -1.0), (-1.0, 9.0)), Box("right wall", (1.0, 1.2), (-1.0, 9.0)))
    return World("corridor", walls, start=Place(0.0, 0.0, _UP), goal=Place(0.0, 8.0), bounds=(-2.0, -2.0, 2.0, 10.0))


def doorway() -> World:
    """A wall right across a room, with a door of 1.2 m that is 2 m beside the straight way."""
    walls = (
        Box("left wall", (-4.2, -4.0), (-2.0, 8.0)),
        Box("right wall", (4.0, 4.2), (-2.0, 8.0)),
        Box("rear wall", (-4.2, 4.2), (-2.2, -2.0)),
        Box("front wall", (-4.2, 4.2), (8.0, 8.2)),
        Box("door wall left", (-4.0, 1.4), (3.0, 3.2)),
        Box("door wall right", (2.6, 4.0), (3.0, 3.2)),
    )
    return World("doorway", walls, start=Place(0.0, 0.0, _UP), goal=Place(0.0, 6.0), bounds=(-4.2, -2.2, 4.2, 8.2))


def u_trap() -> World:
    """A dead end of 3 m by 3 m, open towards the start: what steers to the goal alone does not get out."""
    walls = (
        Box("trap left", (-1.7, -1.5), (2.0, 5.2)),
        Box("trap right", (1.5, 1.7), (2.0, 5.2)),
        Box("trap end", (-1.7, 1.7), (5.0, 5.2)),
    )
    return World("u_trap", walls, start=Place(0.0, 0.0, _UP), goal=Place(0.0, 8.0), bounds=(-5.0, -2.0, 5.0, 10.0))


def clutter_world(argument: str, base: Path) -> World:
    """20 posts of 0.2 m diameter on 12 m x 12 m, no two nearer than 1.6 m; start in front, goal behind.

    Args:
        argument: The seed, a whole number from 0.
        base: Not used: the world is made, not read.

    Raises:
        WorldError: The seed is no such number.
    """
    if not (argument.isascii() and argument.isdigit() and len(argument) <= 18):
        raise WorldError(f"clutter:{argument}: expected a seed, a whole number from 0, as in clutter:3")
    stream = np.random.default_rng(int(argument))
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
    start, goal = Place(0.0, -0.5, _UP), Place(0.0, 14.5)
    return World(f"clutter:{argument}", posts, start=start, goal=goal, bounds=(-7.0, -2.0, 7.0, 16.0))
