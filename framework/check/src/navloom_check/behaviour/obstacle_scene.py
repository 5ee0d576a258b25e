"""Small scenes: posts and walls in a world, a robot and its target."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from navloom.geometry.collision import clearance
from navloom.geometry.footprints import rectangle
from navloom.geometry.frames import transform
from navloom.geometry.grid import world_to_grid
from navloom.geometry.solids import box_corners
from navloom.geometry.world import Box, Cylinder, Obstacle, Place, World
from navloom.messages import OccupancyGrid, Pose2D
from numpy.typing import NDArray

__all__ = ["ALL_ROUND", "CELL", "HEIGHT", "MAST", "SHORT_SONARS", "SONARS", "TWO_LASERS", "WIDE_SONARS", "Mount",
           "Scene", "ends_of", "grid_of", "post", "wall"]  # fmt: skip

Floats = NDArray[np.float64]

CELL = 0.05
"""Edge of a cell of the maps, m."""

MARGIN = 1.0
"""Free floor round what the map of a scene shows, m."""
HEIGHT = 1.0
"""Height of walls and posts, and of the robot, m."""
THIN = 1e-6
"""Thickness of a wall, m."""
FEW = 8
"""Most obstacles that the description of a scene lists."""


def post(x: float, y: float, radius: float) -> Cylinder:
    """A post: centre and radius, m, map frame."""
    return Cylinder("post", x, y, radius, (0.0, HEIGHT))


def wall(x1: float, y1: float, x2: float, y2: float) -> Box:
    """A straight wall of no thickness that counts: its ends, m, map frame."""
    x, y, half = 0.5 * (x1 + x2), 0.5 * (y1 + y2), 0.5 * math.hypot(x2 - x1, y2 - y1)
    yaw = math.atan2(y2 - y1, x2 - x1)
    return Box("wall", (x - half, x + half), (y - 0.5 * THIN, y + 0.5 * THIN), (0.0, HEIGHT), yaw)


def ends_of(box: Box) -> Floats:
    """(2, 2) ends of a wall, m, map frame."""
    way = 0.5 * (box.x[1] - box.x[0]) * np.array([math.cos(box.yaw), math.sin(box.yaw)])
    return np.array([box.centre - way, box.centre + way])


@dataclass(frozen=True)
class Mount:
    """A laser, or a ring of sonars, on the robot.

    Attributes:
        name: Name of the sensor.
        x, y: Its place, m, base frame; for a ring the middle.
        middle: Bearing of its middle beam, rad.
        half_field: Half its field of view, rad.
        beams: Number of its beams over a full turn.
        half_angle: Half the opening of a beam, rad; 0 for a laser.
        rim: Radius of the ring on which its beams begin, m.
        reach: Its greatest range, m.
    """

    name: str
    x: float
    y: float
    middle: float
    half_field: float
    beams: int = 120
    half_angle: float = 0.0
    rim: float = 0.0
    reach: float = 6.0


ALL_ROUND = (Mount("laser", 0.0, 0.0, 0.0, math.pi),)
TWO_LASERS = (Mount("rear", -0.2, 0.0, math.pi, 2.0), Mount("front", 0.2, 0.0, 0.0, 2.0))
"""Two lasers, neither in the middle of the robot nor with a view all round."""
MAST = Mount("mast", -0.25, 0.15, 0.0, math.pi, 240)
"""One laser with a view all round, behind the middle of the robot and beside it."""
SONARS = (Mount("sonars", 0.0, 0.0, 0.0, math.pi, 16, math.radians(15.0), 0.1, 4.0),)
"""A ring of sonars all round, whose cones overlap, and nothing else."""
SHORT_SONARS = (replace(SONARS[0], reach=1.0),)
WIDE_SONARS = (Mount("sonars", 0.0, 0.0, 0.0, math.pi, 5, math.radians(40.0), 0.1, 4.0),)
"""Five sonars with wide cones: each is needed, and an echo may lie far from its axis."""


@dataclass(frozen=True)
class Scene:
    """A robot, its target and obstacles, in the map frame.

    Attributes:
        start: Pose of the robot at the start.
        target: Where the robot must go: x, y, m.
        obstacles: Posts and walls.
        length, width: Size of the robot's footprint, m.
        way: Corners of a way to follow, m; empty if there is none.
        lasers: Lasers on the robot, or its ring of sonars.
        map_heading: Heading of the raster of the map in the map frame, rad.
        has_earlier_map: A planner first gets a request on another map of the same size.
        backs: The robot drives backwards.
        came: Distance that the robot drove straight ahead to its start, m; 0 where it does not matter.
    """

    start: Place
    target: tuple[float, float]
    obstacles: tuple[Obstacle, ...] = ()
    length: float = 0.5
    width: float = 0.4
    way: tuple[tuple[float, float], ...] = ()
    lasers: tuple[Mount, ...] = ALL_ROUND
    map_heading: float = 0.0
    has_earlier_map: bool = False
    backs: bool = False
    came: float = 0.0

    @cached_property
    def world(self) -> World:
        """The obstacles as sensors see them."""
        return World("scene", self.obstacles)

    @property
    def walls(self) -> list[Box]:
        """The walls among the obstacles."""
        return [one for one in self.obstacles if isinstance(one, Box)]

    @cached_property
    def outline(self) -> Floats:
        """(4, 2) corners of the footprint, m, base frame."""
        return rectangle(self.length, self.width)

    def gap(self, x: float, y: float, heading: float) -> float:
        """Distance of the footprint, at a pose, from the nearest obstacle, m; 0 in contact, +inf without obstacles."""
        return clearance(self.outline, Place(x, y, heading), self.world, height=HEIGHT)[0]

    @property
    def words(self) -> str:
        """The scene as one phrase."""
        s = self.start
        parts = [
            f"robot of {self.length:g} m x {self.width:g} m at {_at(s.x, s.y)} heading {math.degrees(s.heading):.0f}°"
        ]
        parts.append(f"way of {len(self.way)} corners" if self.way else f"target {_at(*self.target)}")
        parts += map(_named, self.obstacles[:FEW])
        if self.backs:
            parts.append("driving backwards")
        if self.came:
            parts.append(f"after {self.came:g} m straight ahead")
        if self.lasers[0].half_angle:
            parts.append(f"a ring of {self.lasers[0].beams} sonars of {self.lasers[0].reach:g} m")
        elif self.lasers is not ALL_ROUND:
            parts.append("lasers at " + " and ".join(f"({laser.x:g}, {laser.y:g})" for laser in self.lasers))
        if self.map_heading:
            parts.append(f"raster turned by {math.degrees(self.map_heading):.0f}°")
        if self.has_earlier_map:
            parts.append("after a request on the mirrored map")
        more = max(0, len(self.obstacles) - FEW)
        return ", ".join(parts) + (f" and {more} more obstacles" if more else "")

    def moved(self, place: Place) -> Scene:
        """The scene turned about the origin by a heading and then moved."""
        to_map = np.array([place.x, place.y, place.heading])

        def at(x: float, y: float) -> tuple[float, float]:
            new_x, new_y = transform(to_map, np.array([x, y])).tolist()
            return new_x, new_y

        return self._through(at, math.remainder(self.start.heading + place.heading, math.tau))

    def mirrored(self) -> Scene:
        """The scene mirrored at the x axis: left becomes right."""
        return self._through(lambda x, y: (x, -y), -self.start.heading)

    def _through(self, at: Callable[[float, float], tuple[float, float]], heading: float) -> Scene:
        """The scene with each point moved by `at`, and another heading of the start."""
        return replace(
            self, start=Place(*at(self.start.x, self.start.y), heading), target=at(*self.target),
            obstacles=tuple(_moved(one, at) for one in self.obstacles), way=tuple(at(x, y) for x, y in self.way),
        )  # fmt: skip

    def smaller(self) -> Iterator[Scene]:
        """Scenes with fewer obstacles: first with half of them, then with one less."""
        kept, half = self.obstacles, len(self.obstacles) // 2
        parts = [kept[:half], kept[half:]] if half else []
        for part in (*parts, *(kept[:k] + kept[k + 1 :] for k in range(len(kept)))):
            yield replace(self, obstacles=part)


def grid_of(scene: Scene, place: Place | None = None) -> OccupancyGrid:
    """The map of a scene; a place turns and moves it as a whole."""
    ends = [(scene.start.x, scene.start.y), scene.target, *scene.way]
    for one in scene.obstacles:
        ends += box_corners(one).tolist() if isinstance(one, Box) else [
            (one.x + side * one.radius, one.y + side * one.radius) for side in (-1.0, 1.0)
        ]  # fmt: skip
    low = np.floor((np.min(ends, axis=0) - MARGIN) / CELL) * CELL
    high = low + np.ceil((np.max(ends, axis=0) + MARGIN - low) / CELL) * CELL
    drawn = world_to_grid(scene.world, CELL, (0.0, HEIGHT), (*low.tolist(), *high.tolist()))
    at = Place(0.0, 0.0) if place is None else place
    left, lower = transform(np.array([at.x, at.y, at.heading]), low).tolist()
    return OccupancyGrid(drawn.cells, CELL, Pose2D(left, lower, math.remainder(at.heading, math.tau)))


def _moved(one: Obstacle, at: Callable[[float, float], tuple[float, float]]) -> Obstacle:
    if isinstance(one, Box):
        start, end = ends_of(one).tolist()
        return wall(*at(*start), *at(*end))
    x, y = at(*one.centre)
    return replace(one, x=x, y=y)


def _named(one: Obstacle) -> str:
    if isinstance(one, Cylinder):
        return f"post of {one.radius:.2g} m at {_at(one.x, one.y)}"
    start, end = ends_of(one).tolist()
    return f"wall from {_at(*start)} to {_at(*end)}"


def _at(x: float, y: float) -> str:
    return f"({x:.2f}, {y:.2f})"
