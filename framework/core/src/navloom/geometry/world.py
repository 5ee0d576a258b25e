"""Worlds: the ground truth through which a simulator moves a robot. Of the plugins, only a Platform sees it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.actors import Actor

__all__ = ["Box", "Cylinder", "Material", "Obstacle", "Place", "Raster", "World", "position_at", "read_only"]

A = TypeVar("A", bound=np.generic)
Interval = tuple[float, float]
Waypoint = tuple[float, float, float]
"""Time, s, and the position x, y, m, of an obstacle's centre at that time, in the map frame."""
Material = Literal["solid", "glass"]
"""What an obstacle is made of. Light passes glass: a laser sees what is behind it, a sonar the glass itself."""


def read_only(array: NDArray[A]) -> NDArray[A]:
    """The array itself if it is read-only, otherwise a read-only copy."""
    if not array.flags.writeable:
        return array
    held = array.copy()
    held.flags.writeable = False
    return held


@dataclass(frozen=True)
class Place:
    """A pose in the map frame: x, y, m; heading, rad, counter-clockwise from the x axis."""

    x: float
    y: float
    heading: float = 0.0


@dataclass(frozen=True)
class Box:
    """An upright box, rotated by `yaw` about its centre.

    Attributes:
        name: Its name in messages and errors.
        x, y: Extent before the rotation, m, in the map frame.
        z: Extent above the floor, m.
        yaw: Rotation about the box's centre, rad.
        appears_at: Run time at which it appears, s; 0 for the start.
        appears_after_sweep: It appears when the first stop-and-scan sweep has ended (then `appears_at` is ignored).
        waypoints: Position of its centre over time; linear in between, constant before the first and after the last.
        loops: The waypoints repeat, with the last one's time as the period.
        is_mapped: A map of the world shows it, if it exists from the start and never moves.
        material: What it is made of.
    """

    name: str
    x: Interval
    y: Interval
    z: Interval = (0.0, 2.4)
    yaw: float = 0.0
    appears_at: float = 0.0
    appears_after_sweep: bool = False
    waypoints: tuple[Waypoint, ...] = ()
    loops: bool = False
    is_mapped: bool = True
    material: Material = "solid"

    @property
    def centre(self) -> tuple[float, float]:
        """Centre of the box as written, m, in the map frame."""
        return 0.5 * (self.x[0] + self.x[1]), 0.5 * (self.y[0] + self.y[1])


@dataclass(frozen=True)
class Cylinder:
    """A vertical cylinder. Attributes that are not listed are as for `Box`.

    Attributes:
        name: Its name in messages and errors.
        x, y: Centre, m, in the map frame.
        radius: Radius, m.
    """

    name: str
    x: float
    y: float
    radius: float
    z: Interval = (0.0, 2.4)
    appears_at: float = 0.0
    appears_after_sweep: bool = False
    waypoints: tuple[Waypoint, ...] = ()
    loops: bool = False
    is_mapped: bool = True
    material: Material = "solid"

    @property
    def centre(self) -> tuple[float, float]:
        """Centre as written, m, in the map frame."""
        return self.x, self.y


Obstacle = Box | Cylinder


@dataclass(frozen=True, eq=False)
class Raster:
    """A map of a building as ground truth.

    Attributes:
        name: Its name in messages and errors.
        occupied: (rows, cols) bool, read-only; row 0 is the lowest y, column 0 the lowest x, in the raster's own frame.
        resolution: Edge of a cell, m.
        origin: Pose of the lower left corner of cell (0, 0) in the map frame.
        z: Height interval of its walls, m.
        unknown: (rows, cols) bool, read-only: cells of `occupied` that no sensor has seen; None if there is none.
    """

    name: str
    occupied: NDArray[np.bool_]
    resolution: float
    origin: Place = field(default_factory=lambda: Place(0.0, 0.0))
    z: Interval = (0.0, 2.4)
    unknown: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "occupied", read_only(self.occupied))
        if self.unknown is not None:
            object.__setattr__(self, "unknown", read_only(self.unknown))


@dataclass(frozen=True, eq=False)
class World:
    """The ground truth around a robot.

    Attributes:
        name: The reference that it was resolved from.
        obstacles: Boxes and cylinders.
        raster: A building's map, or None.
        start, goal: Start and goal given with the world, or None.
        bounds: Lowest x, lowest y, highest x, highest y, m, in the map frame: the relevant part of the plane, and the
            extent of a map of the world.
        goal_tolerance, time_limit: Tolerance and time limit given with the world, m and s, or None.
        reference_length: Length of the path from start to goal given with the world, m, to which scores refer, or None.
        actors: What moves by itself; obstacles with way points move too.
        tasks: Start and goal of each robot of a fleet, one robot after the other.
    """

    name: str
    obstacles: tuple[Obstacle, ...] = ()
    raster: Raster | None = None
    start: Place | None = None
    goal: Place | None = None
    bounds: tuple[float, float, float, float] = (-10.0, -10.0, 10.0, 10.0)
    goal_tolerance: float | None = None
    time_limit: float | None = None
    reference_length: float | None = None
    actors: tuple[Actor, ...] = ()
    tasks: tuple[tuple[Place, Place], ...] = ()


def position_at(waypoints: Sequence[Waypoint], loops: bool, time: float) -> tuple[float, float]:
    """Centre of a moving obstacle at a run time, s: linear between waypoints, constant outside unless it loops."""
    first, last = waypoints[0], waypoints[-1]
    if loops and last[0] > 0.0:
        time = math.fmod(time, last[0])
    if time <= first[0]:
        return first[1], first[2]
    for (t0, x0, y0), (t1, x1, y1) in pairwise(waypoints):
        if time <= t1:
            share = (time - t0) / (t1 - t0)
            return x0 + share * (x1 - x0), y0 + share * (y1 - y0)
    return last[1], last[2]
