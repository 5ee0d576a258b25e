"""Moves the actors of a world, and lists everything that moves: their bodies and those of the robots.

The node `world` steps it before the platforms, which read what it says. It draws no random numbers, and actors on a
`Course` know nothing of the robots: they move alike whatever the robots do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.actors import Actor, Body, Course, Part, Walk, parts_of
from navloom.geometry.crowd import Crowd
from navloom.geometry.world import Box, Obstacle, World
from navloom.messages import Bodies

__all__ = ["Law", "Mover", "MovingWorld", "RobotBody", "actors_of", "moves", "standing", "walks"]

Floats = NDArray[np.float64]


class Law(Protocol):
    """Velocities of bodies that give way to each other."""

    def __call__(
        self,
        positions: Floats,
        velocities: Floats,
        radii: Floats,
        preferred: Floats,
        max_speeds: Floats,
        sees: NDArray[np.bool_],
    ) -> Floats:
        """The new velocities of n bodies. What it gives to one that sees nobody is not used.

        Args:
            positions: (n, 2) m, map frame.
            velocities: (n, 2) m/s, map frame.
            radii: (n,) m.
            preferred: (n, 2) velocities towards their goals, m/s.
            max_speeds: (n,) m/s.
            sees: (n, n) row i: to which bodies i gives way.

        Returns:
            (n, 2) m/s.
        """


@dataclass(frozen=True, eq=False)
class RobotBody:
    """A robot as a body among others.

    Attributes:
        name: Its name.
        footprint: (n, 2) corners of its outline, m, base frame.
        height: m.
    """

    name: str
    footprint: Floats
    height: float

    def part(self, x: float, y: float, heading: float) -> Part:
        """The robot as the others' sensors meet it, map frame: the cylinder or box around its outline."""
        low, high = self.footprint.min(axis=0), self.footprint.max(axis=0)
        reach = np.hypot(*self.footprint.T)
        is_round = len(self.footprint) > 8 and reach.min() > 0.95 * reach.max()
        if is_round:
            return (x, y, float(reach.max()), 0.0, 0.0, 0.0, self.height, 0.0)
        (u, v), (half, side) = 0.5 * (low + high), 0.5 * (high - low)
        c, s = math.cos(heading), math.sin(heading)
        return (x + c * u - s * v, y + s * u + c * v, float(half), float(side), heading, 0.0, self.height, 0.0)


@dataclass(frozen=True)
class Mover:
    """Where a robot is: x, y, m, and heading, rad, map frame; forward, left, m/s, and turn rate, rad/s, base frame."""

    x: float
    y: float
    heading: float
    vx: float = 0.0
    vy: float = 0.0
    wz: float = 0.0

    @property
    def velocity(self) -> tuple[float, float, float]:
        """Velocity x, y, m/s, map frame, and turn rate, rad/s."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        return c * self.vx - s * self.vy, s * self.vx + c * self.vy, self.wz


def moves(world: World) -> bool:
    """Whether anything in a world moves by itself."""
    return bool(world.actors) or any(obstacle.waypoints for obstacle in world.obstacles)


def walks(world: World) -> bool:
    """Whether actors of a world give way, for which a law is needed."""
    return any(isinstance(actor.course, Walk) for actor in world.actors)


def standing(world: World) -> World:
    """The part of a world that does not move by itself."""
    if not moves(world):
        return world
    return replace(world, obstacles=tuple(o for o in world.obstacles if not o.waypoints), actors=())


def actors_of(world: World) -> tuple[Actor, ...]:
    """Everything that moves by itself: obstacles with way points, then the actors."""
    return (*(_actor(obstacle) for obstacle in world.obstacles if obstacle.waypoints), *world.actors)


def _actor(obstacle: Obstacle) -> Actor:
    is_glass, yaw = obstacle.material == "glass", 0.0
    if isinstance(obstacle, Box):
        length, width = obstacle.x[1] - obstacle.x[0], obstacle.y[1] - obstacle.y[0]
        body, yaw = Body("box", length, width, obstacle.z, is_glass), obstacle.yaw
    else:
        body = Body("disc", 2.0 * obstacle.radius, 2.0 * obstacle.radius, obstacle.z, is_glass)
    course = Course(obstacle.waypoints, loops=obstacle.loops, heading=yaw)
    return Actor(obstacle.name, course, body, obstacle.appears_at)


class MovingWorld:
    """The actors of a world over time.

    Args:
        world: The world.
        robots: The robots in it.
        period: Longest step of a walking actor, s.
        law: How walking actors give way; None where no actor walks.
    """

    def __init__(self, world: World, robots: Sequence[RobotBody], period: float, law: Law | None = None) -> None:
        actors = actors_of(world)
        self._timed = [(actor, actor.course) for actor in actors if isinstance(actor.course, Course)]
        walking = [actor for actor in actors if isinstance(actor.course, Walk)]
        self._crowd = Crowd(walking)
        # An actor's number is its place among those on a course, and then those that walk.
        self._actors = [*[actor for actor, _ in self._timed], *walking]
        kinds: dict[Body, int] = {}
        self._kinds = np.array([kinds.setdefault(actor.body, len(kinds)) for actor in self._actors], dtype=np.int64)
        self._shapes = list(kinds)
        self._radii = np.array([actor.body.radius for actor in self._actors])
        self._robots, self._period, self._law = tuple(robots), period, law
        self._reach = [float(np.hypot(*robot.footprint.T).max()) for robot in robots]
        self._time = 0.0
        self._named: tuple[list[int], tuple[str, ...]] = ([], tuple(robot.name for robot in robots))

    def advance(self, time_ns: int, robots: Sequence[Mover]) -> Bodies:
        """Everything that moves at a run time, with the robots where they were before it."""
        time = time_ns / 1e9
        found = [
            (number, motion)
            for number, (actor, course) in enumerate(self._timed)
            if time >= actor.appears_at and (motion := course.at(time)) is not None
        ]
        numbers = np.array([number for number, _ in found], dtype=np.int64)
        motions = np.array([motion for _, motion in found]).reshape(-1, 6)
        if self._crowd.is_there.size:
            others = self._others(numbers, motions, robots)
            self._walk(time, others)
            self._crowd.enter(time, others)
            who = np.flatnonzero(self._crowd.is_there)
            numbers = np.concatenate([numbers, who + len(self._timed)])
            motions = np.concatenate([motions, self._crowd.motions(who)])
        self._time = time
        return self._bodies(time_ns, numbers, motions, robots)

    def _others(self, numbers: NDArray[np.int64], motions: Floats, robots: Sequence[Mover]) -> Floats:
        """(m, 5) x, y, m, velocity, m/s, map frame, and radius, m, of actors on a course, then of the robots."""
        timed = np.column_stack([motions[:, [0, 1, 3, 4]], self._radii[numbers]])
        seen = [(r.x, r.y, *r.velocity[:2], reach) for r, reach in zip(robots, self._reach, strict=True)]
        return np.concatenate([timed, np.array(seen).reshape(-1, 5)])

    def _walk(self, time: float, others: Floats) -> None:
        """Let the actors that give way walk until a run time, s, among others that do not; see `_others`."""
        crowd = self._crowd
        steps = math.ceil(round((time - self._time) / self._period, 6))
        if self._law is None or steps <= 0:
            return
        # After a pause, as of a process that restarts, they go on from where they were: no more than a second.
        step, steps = (time - self._time) / steps, min(steps, math.ceil(1.0 / self._period))
        for _ in range(steps):
            who = np.flatnonzero(crowd.is_there)
            count, total = len(who), len(who) + len(others)
            if not count:
                return
            sees = np.zeros((total, total), dtype=np.bool_)
            sees[:count] = True
            sees[:count, total - len(self._robots) :] = crowd.sees_robots[who, None]
            state = np.empty((total, 8))
            state[count:, :4], state[count:, 4:6], state[count:, 6] = others[:, :4], others[:, 2:4], others[:, 4]
            state[count:, 7] = np.hypot(others[:, 2], others[:, 3])
            state[:count, :2], state[:count, 2:4] = crowd.places[who], crowd.velocities[who]
            state[:count, 4:6] = crowd.preferred(who, step)
            state[:count, 6], state[:count, 7] = crowd.radii[who], crowd.max_speeds[who]
            given = (state[:, :2], state[:, 2:4], state[:, 6], state[:, 4:6], state[:, 7])
            crowd.go(who, self._law(*given, sees)[:count], step)

    def _bodies(self, time_ns: int, numbers: NDArray[np.int64], motions: Floats, robots: Sequence[Mover]) -> Bodies:
        kinds, count = self._kinds[numbers], len(numbers)
        parts = [np.zeros((0, 9))]
        for kind in np.unique(kinds).tolist():
            rows = np.flatnonzero(kinds == kind)
            placed = parts_of(self._shapes[kind], motions[rows])
            parts.append(np.column_stack([np.repeat(rows, placed.shape[1]), placed.reshape(-1, 8)]))
        found = np.concatenate(parts)
        if len(parts) > 2:
            found = found[np.argsort(found[:, 0], kind="stable")]
        own = [(count + k, *r.part(m.x, m.y, m.heading))
               for k, (r, m) in enumerate(zip(self._robots, robots, strict=True))]  # fmt: skip
        poses, velocities = np.empty((count + len(robots), 3)), np.zeros((count + len(robots), 3))
        poses[:count], velocities[:count, :2] = motions[:, :3], motions[:, 3:5]
        poses[count:] = np.array([(m.x, m.y, m.heading) for m in robots]).reshape(-1, 3)
        velocities[count:] = np.array([m.velocity for m in robots]).reshape(-1, 3)
        found = np.concatenate([found, np.array(own).reshape(-1, 9)])
        return Bodies(time_ns, self._names(numbers.tolist()), poses, velocities, found, len(robots))

    def _names(self, numbers: list[int]) -> tuple[str, ...]:
        """The names of actors, then of the robots: the same tuple as long as the same actors are there."""
        if numbers != self._named[0]:
            names = (*[self._actors[k].name for k in numbers], *[robot.name for robot in self._robots])
            self._named = (numbers, names)
        return self._named[1]
