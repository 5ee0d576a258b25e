"""Moves the actors of a world, and lists everything that moves: their bodies and those of the robots.

The node `world` steps it before the platforms, which read what it says. It draws no random numbers, and actors on a
`Course` know nothing of the robots: they move alike whatever the robots do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
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


@dataclass(eq=False)
class _Walker:
    """State of an actor that walks: place, velocity, heading, distance walked, and number of its next goal."""

    walk: Walk
    place: Floats
    velocity: Floats = field(default_factory=lambda: np.zeros(2))
    heading: float = 0.0
    walked: float = 0.0
    goal: int = 0

    @classmethod
    def at_start(cls, walk: Walk) -> _Walker:
        made = cls(walk, np.array(walk.start))
        made.heading = math.atan2(*(np.array(walk.goals[0]) - made.place)[::-1].tolist()) if walk.goals else 0.0
        return made

    def preferred(self, step: float) -> Floats:
        """Velocity towards the next goal, m/s; so that a step of this duration, s, does not overshoot it."""
        if self.goal >= len(self.walk.goals):
            return np.zeros(2)
        way = np.array(self.walk.goals[self.goal]) - self.place
        distance = float(np.hypot(*way))
        return way / distance * min(self.walk.speed, distance / step) if distance > 1e-9 else np.zeros(2)

    def go(self, velocity: Floats, step: float) -> None:
        """Walk for a step, s, at a velocity, and take the next goal if this one is reached."""
        self.velocity, self.place = velocity, self.place + step * velocity
        speed = float(np.hypot(*velocity))
        self.walked += step * speed
        if speed > 0.05:
            self.heading = math.atan2(velocity[1], velocity[0])
        goals = self.walk.goals
        if self.goal < len(goals) and np.hypot(*(np.array(goals[self.goal]) - self.place)) < ARRIVED:
            self.goal += 1
            if self.goal == len(goals) and self.walk.flows:
                self.place, self.goal = np.array(self.walk.start), 0

    def motion(self) -> Motion:
        """Where it is."""
        (x, y), (vx, vy) = self.place.tolist(), self.velocity.tolist()
        return Motion(x, y, self.heading, vx, vy, self.walked)


class MovingWorld:
    """The actors of a world over time.

    Args:
        world: The world.
        robots: The robots in it.
        period: Longest step of a walking actor, s.
        law: How walking actors give way; None where no actor walks.
    """

    def __init__(self, world: World, robots: Sequence[RobotBody], period: float, law: Law | None = None) -> None:
        self._actors, self._robots, self._period = actors_of(world), tuple(robots), period
        self._walkers = {
            actor.name: _Walker.at_start(w) for actor in self._actors if isinstance(w := actor.course, Walk)
        }
        self._law = law
        self._time = 0.0

    def advance(self, time_ns: int, robots: Sequence[Mover]) -> Bodies:
        """Everything that moves at a run time, with the robots where they were before it."""
        time = time_ns / 1e9
        there: list[tuple[Actor, Motion]] = []
        for actor in self._actors:
            if isinstance(actor.course, Course) and time >= actor.appears_at:
                motion = actor.course.at(time)
                if motion is not None:
                    there.append((actor, motion))
        self._walk(time, there, robots)
        there += [
            (actor, self._walkers[actor.name].motion())
            for actor in self._actors
            if actor.name in self._walkers and time >= actor.appears_at
        ]
        self._time = time
        return self._bodies(time_ns, there, robots)

    def _walk(self, time: float, there: Sequence[tuple[Actor, Motion]], robots: Sequence[Mover]) -> None:
        """Let the walking actors that are there walk until a run time, s."""
        walking = [a for a in self._actors if a.name in self._walkers and self._time >= a.appears_at]
        steps = math.ceil(round((time - self._time) / self._period, 6))
        if not walking or self._law is None or steps <= 0:
            return
        # After a pause, as of a process that restarts, the actors go on from where they were: no more than a second.
        step = min((time - self._time) / steps, 1.0)
        walkers = [self._walkers[actor.name] for actor in walking]
        others = np.array([(m.x, m.y, m.vx, m.vy, a.body.radius) for a, m in there]).reshape(-1, 5)
        reach = [float(np.hypot(*robot.footprint.T).max()) for robot in self._robots]
        rows = [(r.x, r.y, *r.velocity[:2], radius) for r, radius in zip(robots, reach, strict=True)]
        seen = np.array(rows).reshape(-1, 5)
        others = np.concatenate([others, seen])
        count, total = len(walkers), len(walkers) + len(others)
        sees = np.zeros((total, total), dtype=np.bool_)
        sees[:count] = True
        sees[:count, total - len(seen) :] = np.array([w.walk.sees_robots for w in walkers])[:, None]
        max_speeds = np.concatenate([[w.walk.most for w in walkers], np.hypot(*others[:, 2:4].T)])
        for _ in range(min(steps, math.ceil(1.0 / self._period))):
            own = np.array([(*w.place, *w.velocity, a.body.radius) for w, a in zip(walkers, walking, strict=True)])
            bodies = np.concatenate([own, others])
            preferred = np.concatenate([[w.preferred(step) for w in walkers], others[:, 2:4]])
            positions, velocities, radii = bodies[:, :2].copy(), bodies[:, 2:4].copy(), bodies[:, 4].copy()
            chosen = self._law(positions, velocities, radii, preferred, max_speeds, sees)
            for walker, velocity in zip(walkers, chosen[:count], strict=True):
                walker.go(velocity, step)

    def _bodies(self, time_ns: int, there: Sequence[tuple[Actor, Motion]], robots: Sequence[Mover]) -> Bodies:
        names, poses, velocities, parts = [], [], [], []
        for number, (actor, motion) in enumerate(there):
            names.append(actor.name)
            poses.append(motion[:3])
            velocities.append((motion.vx, motion.vy, 0.0))
            parts += [(number, *part) for part in parts_of(actor.body, motion)]
        for number, (robot, at) in enumerate(zip(self._robots, robots, strict=True), start=len(names)):
            names.append(robot.name)
            poses.append((at.x, at.y, at.heading))
            velocities.append(at.velocity)
            parts.append((number, *robot.part(at.x, at.y, at.heading)))
        return Bodies(
            time_ns,
            tuple(names),
            np.array(poses, dtype=np.float64).reshape(-1, 3),
            np.array(velocities, dtype=np.float64).reshape(-1, 3),
            np.array(parts, dtype=np.float64).reshape(-1, 9),
            len(robots),
        )
