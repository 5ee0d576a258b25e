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

from navloom.geometry.actors import Actor, Body, Course, Motion, Part, Walk, parts_of
from navloom.geometry.world import Box, Obstacle, World
from navloom.messages import Bodies

__bodies_ = ["Law", "Mover", "MovingWorld", "RobotBody", "actors_of", "moves", "standing", "walks"]

Floats = NDArray[np.float64]
ARRIVED = 0.3
"""A walking actor is at a goal within this distance, m."""
TURNS = 0.05
"""A walking actor that is slower keeps its heading, m/s."""


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


class _Crowd:
    """The actors that give way: state of each, by its number.

    Args:
        actors: Those of a world on a `Walk`.

    Attributes:
        actors: The actors.
        places, velocities: (k, 2) m and m/s, map frame.
        radii, max_speeds: (k,) m and m/s.
        sees_robots: (k,) whether each gives way to robots.
    """

    def __init__(self, actors: Sequence[Actor]) -> None:
        self.actors = list(actors)
        walks = [actor.course for actor in actors if isinstance(actor.course, Walk)]
        self.places = np.array([walk.start for walk in walks], dtype=np.float64).reshape(-1, 2)
        self.velocities = np.zeros_like(self.places)
        self.radii = np.array([actor.body.radius for actor in actors])
        self.max_speeds = np.array([walk.most for walk in walks])
        self.sees_robots = np.array([walk.sees_robots for walk in walks], dtype=np.bool_)
        self._starts, self._speeds = self.places.copy(), np.array([walk.speed for walk in walks])
        self._flows = np.array([walk.flows for walk in walks], dtype=np.bool_)
        self._appear = np.array([actor.appears_at for actor in actors])
        self._counts = np.array([len(walk.goals) for walk in walks], dtype=np.int64)
        self._goals = np.zeros((len(walks), max(self._counts, default=0), 2))
        for walk, row in zip(walks, self._goals, strict=True):
            row[: len(walk.goals)] = walk.goals
        self._next, self._walked = np.zeros(len(walks), dtype=np.int64), np.zeros(len(walks))
        ahead = self._goals[:, 0] - self.places if len(walks) else self.places
        self._headings = np.arctan2(ahead[:, 1], ahead[:, 0])

    def there(self, time: float) -> NDArray[np.int64]:
        """Numbers of those that have appeared at a run time, s."""
        return np.flatnonzero(self._appear <= time)

    def preferred(self, who: NDArray[np.int64], step: float) -> Floats:
        """(k, 2) velocities towards their next goals, m/s, that do not overshoot them in a step of a duration, s."""
        goals, has_goal = self._next[who], self._next[who] < self._counts[who]
        ways = self._goals[who, np.minimum(goals, self._counts[who] - 1)] - self.places[who]
        distances = np.hypot(ways[:, 0], ways[:, 1])
        speeds = np.where(has_goal, np.minimum(self._speeds[who], distances / step), 0.0)
        return ways * (speeds / np.maximum(distances, 1e-9))[:, None]

    def go(self, who: NDArray[np.int64], velocities: Floats, step: float) -> None:
        """Walk for a step, s, at velocities, (k, 2), m/s; those that reach a goal take the next one."""
        self.velocities[who] = velocities
        self.places[who] += step * velocities
        speeds = np.hypot(velocities[:, 0], velocities[:, 1])
        self._walked[who] += step * speeds
        turns = who[speeds > TURNS]
        self._headings[turns] = np.arctan2(self.velocities[turns, 1], self.velocities[turns, 0])
        has_goal = who[self._next[who] < self._counts[who]]
        ways = self._goals[has_goal, self._next[has_goal]] - self.places[has_goal]
        self._next[has_goal[np.hypot(ways[:, 0], ways[:, 1]) < ARRIVED]] += 1
        anew = who[(self._next[who] >= self._counts[who]) & self._flows[who]]
        self.places[anew], self._next[anew] = self._starts[anew], 0

    def motions(self, who: NDArray[np.int64]) -> list[tuple[Actor, Motion]]:
        """Where they are."""
        columns = (self.places[who], self._headings[who, None], self.velocities[who], self._walked[who, None])
        rows = np.concatenate(columns, axis=1).tolist()
        return [(self.actors[k], Motion(*row)) for k, row in zip(who.tolist(), rows, strict=True)]


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
        self._crowd = _Crowd([actor for actor in actors if isinstance(actor.course, Walk)])
        self._robots, self._period, self._law = tuple(robots), period, law
        self._reach = [float(np.hypot(*robot.footprint.T).max()) for robot in robots]
        self._time = 0.0

    def advance(self, time_ns: int, robots: Sequence[Mover]) -> Bodies:
        """Everything that moves at a run time, with the robots where they were before it."""
        time = time_ns / 1e9
        there = [
            (actor, motion)
            for actor, course in self._timed
            if time >= actor.appears_at and (motion := course.at(time)) is not None
        ]
        if self._crowd.actors:
            self._walk(time, there, robots)
            there += self._crowd.motions(self._crowd.there(time))
        self._time = time
        return self._bodies(time_ns, there, robots)

    def _walk(self, time: float, there: Sequence[tuple[Actor, Motion]], robots: Sequence[Mover]) -> None:
        """Let the actors that give way walk until a run time, s."""
        crowd, who = self._crowd, self._crowd.there(self._time)
        steps = math.ceil(round((time - self._time) / self._period, 6))
        if not len(who) or self._law is None or steps <= 0:
            return
        # After a pause, as of a process that restarts, they go on from where they were: no more than a second.
        step, steps = (time - self._time) / steps, min(steps, math.ceil(1.0 / self._period))
        timed = [(m.x, m.y, m.vx, m.vy, a.body.radius) for a, m in there]
        seen = [(r.x, r.y, *r.velocity[:2], reach) for r, reach in zip(robots, self._reach, strict=True)]
        others = np.array([*timed, *seen]).reshape(-1, 5)
        count, total = len(who), len(who) + len(others)
        sees = np.zeros((total, total), dtype=np.bool_)
        sees[:count] = True
        sees[:count, total - len(seen) :] = crowd.sees_robots[who, None]
        radii = np.concatenate([crowd.radii[who], others[:, 4]])
        max_speeds = np.concatenate([crowd.max_speeds[who], np.hypot(others[:, 2], others[:, 3])])
        for _ in range(steps):
            positions = np.concatenate([crowd.places[who], others[:, :2]])
            velocities = np.concatenate([crowd.velocities[who], others[:, 2:4]])
            preferred = np.concatenate([crowd.preferred(who, step), others[:, 2:4]])
            crowd.go(who, self._law(positions, velocities, radii, preferred, max_speeds, sees)[:count], step)

    def _bodies(self, time_ns: int, there: Sequence[tuple[Actor, Motion]], robots: Sequence[Mover]) -> Bodies:
        motions = np.array([motion for _, motion in there]).reshape(-1, 6)
        alike: dict[Body, list[int]] = {}
        for number, (actor, _) in enumerate(there):
            alike.setdefault(actor.body, []).append(number)
        parts = [np.zeros((0, 9))]
        for body, numbers in alike.items():
            placed = parts_of(body, motions[numbers])
            owners = np.repeat(np.array(numbers, dtype=np.float64), placed.shape[1])
            parts.append(np.column_stack([owners, placed.reshape(-1, 8)]))
        rows = np.concatenate(parts)
        if len(alike) > 1:
            rows = rows[np.argsort(rows[:, 0], kind="stable")]
        own = [(len(there) + k, *r.part(m.x, m.y, m.heading))
               for k, (r, m) in enumerate(zip(self._robots, robots, strict=True))]  # fmt: skip
        velocities = np.zeros((len(there), 3))
        velocities[:, :2] = motions[:, 3:5]
        return Bodies(
            time_ns,
            (*[actor.name for actor, _ in there], *[robot.name for robot in self._robots]),
            np.concatenate([motions[:, :3], np.array([(m.x, m.y, m.heading) for m in robots]).reshape(-1, 3)]),
            np.concatenate([velocities, np.array([m.velocity for m in robots]).reshape(-1, 3)]),
            np.concatenate([rows, np.array(own).reshape(-1, 9)]),
            len(robots),
        )
