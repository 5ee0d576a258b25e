"""Worlds in which people and things move on scripted courses: one question to a method each."""

from __future__ import annotations

import math

from navloom.geometry.actors import Actor, Body, Course
from navloom.geometry.world import Box, Place, World
from navloom.worlds.actor_tables import way_points

__all__ = ["blocked_door", "child_behind_box", "crossing", "door_opens", "group", "oncoming", "overtaking"]

_UP = 0.5 * math.pi
_PERSON = Body("legs", 0.44, 0.44, (0.0, 1.75))
_CHILD = Body("legs", 0.3, 0.3, (0.0, 1.1))
_WALL = (0.0, 2.4)


def _hall(width: float, length: float = 11.0) -> tuple[Box, ...]:
    """Two walls, `width` m apart, beside the straight line from (0, 0) to (0, 9)."""
    half = 0.5 * width
    return (
        Box("left wall", (-half - 0.2, -half), (-2.0, length)),
        Box("right wall", (half, half + 0.2), (-2.0, length)),
    )


def _ends(width: float) -> tuple[Box, ...]:
    """The walls that close a hall at both ends, so that its door is the only way."""
    half = 0.5 * width + 0.2
    return (Box("near wall", (-half, half), (-2.2, -2.0)), Box("far wall", (-half, half), (11.0, 11.2)))


def _world(name: str, width: float, obstacles: tuple[Box, ...], *actors: Actor) -> World:
    return World(
        name,
        (*_hall(width), *obstacles),
        start=Place(0.0, 0.0, _UP),
        goal=Place(0.0, 9.0),
        bounds=(-0.5 * width - 0.4, -2.0, 0.5 * width + 0.4, 11.0),
        actors=actors,
    )


def _walker(name: str, places: list[tuple[float, float]], speed: float, loops: bool = False) -> Actor:
    pieces = len(places) if loops else len(places) - 1
    points = way_points(places, [speed] * pieces, [0.0] * len(places), loops)
    return Actor(name, Course(points, loops=loops, leaves=not loops), _PERSON)


def crossing() -> World:
    """Three people cross a hall of 8 m, back and forth at 0.8 to 1.2 m/s, and see nobody."""
    people = [
        _walker(f"person {k + 1}", [(-side, y), (side, y)], speed, loops=True)
        for k, (side, y, speed) in enumerate([(3.0, 3.0, 0.8), (-3.0, 5.0, 1.0), (3.0, 7.0, 1.2)])
    ]
    return _world("crossing", 8.0, (), *people)


def oncoming() -> World:
    """A person walks along a corridor of 2.4 m towards the robot, at 0.8 m/s, 0.2 m beside its way."""
    return _world("oncoming", 2.4, (), _walker("person", [(0.2, 10.5), (0.2, -1.8)], 0.8))


def overtaking() -> World:
    """A person walks ahead of the robot through a corridor of 2.4 m, at 0.12 m/s, and can be passed."""
    return _world("overtaking", 2.4, (), _walker("person", [(-0.4, 1.5), (-0.4, 10.0)], 0.12))


def blocked_door() -> World:
    """A person rests in a door of 1.2 m for 20 s, and then walks away through it."""
    wall = (Box("door wall left", (-3.0, -0.6), (4.0, 4.2)), Box("door wall right", (0.6, 3.0), (4.0, 4.2)))
    places = [(0.0, 4.1), (0.0, 5.6), (2.4, 8.0), (2.4, 10.5)]
    points = way_points(places, [1.0, 1.0, 1.0], [20.0, 0.0, 0.0, 0.0])
    return _world("blocked_door", 6.0, (*wall, *_ends(6.0)), Actor("person", Course(points, leaves=True), _PERSON))


def group() -> World:
    """Three people walk abreast towards the robot at 0.7 m/s; between two of them there is no room."""
    people = [_walker(f"person {k + 1}", [(x, 10.5), (x, -1.8)], 0.7) for k, x in enumerate((-0.7, 0.0, 0.7))]
    return _world("group", 6.0, (), *people)


def child_behind_box() -> World:
    """A child runs out from behind a box beside the robot's way, at 1.5 m/s, every 8 s, and back."""
    box = Box("box", (0.7, 1.5), (3.6, 4.4), (0.0, 1.3))
    places, waits = [(1.1, 4.8), (-1.4, 4.8)], [4.0, 0.4]
    points = way_points(places, [1.5, 1.5], waits, loops=True)
    return _world("child_behind_box", 4.0, (box,), Actor("child", Course(points, loops=True), _CHILD))


def door_opens() -> World:
    """A wall across the way, with a sliding door of 1.4 m that opens after 15 s; no map shows the door."""
    wall = (Box("door wall left", (-3.0, -0.7), (4.0, 4.2)), Box("door wall right", (0.7, 3.0), (4.0, 4.2)))
    door = Course(((15.0, 0.0, 4.1), (17.0, -1.45, 4.1)), heading=0.0)
    return _world("door_opens", 6.0, (*wall, *_ends(6.0)), Actor("door", door, Body("box", 1.5, 0.1, _WALL)))
