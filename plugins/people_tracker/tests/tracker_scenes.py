"""Made scenes for the tracker: walls, pillars and people on legs, seen by a laser on a robot that drives and turns."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from navloom_people_tracker.params import PeopleTrackerParams
from navloom_people_tracker.tracking import Tracker
from navloom_people_tracker.tracks import Tracks
from navloom_people_tracker.views import place_beams
from numpy.typing import NDArray

Floats = NDArray[np.float64]
PERIOD = 0.1
"""Time between scans, s."""


@dataclass
class Scene:
    """A laser of a full turn on a robot, among walls, discs and people.

    Attributes:
        walls: (n, 4) x, y of both ends, m.
        discs: (n, 3) x, y, radius, m, that stand.
        people: Functions of the time, s, that give x, y, m, of each person.
        legs: Whether people are two legs that walk; otherwise discs.
        radius: Of such a disc, m.
        robot: Function of the time, s, that gives x, y, m, heading, rad.
        beams: Number of beams. sigma: Standard deviation of a range, m. reach: Largest range, m.
        scan_time: Time from the first beam to the last, s.
        drift: Error of the odometry, m/m and rad/rad.
        slip: Standard deviation of the turn that it misses, rad/√m, for a robot that drives straight on.
        seed: Of the noise.
    """

    walls: Floats = field(default_factory=lambda: np.empty((0, 4)))
    discs: Floats = field(default_factory=lambda: np.empty((0, 3)))
    people: list[Callable[[float], tuple[float, float]]] = field(default_factory=list)
    legs: bool = True
    radius: float = 0.25
    robot: Callable[[float], tuple[float, float, float]] = lambda time: (0.0, 0.0, 0.0)
    beams: int = 360
    sigma: float = 0.02
    reach: float = 15.0
    scan_time: float = 0.0
    drift: float = 0.0
    slip: float = 0.0
    seed: int = 0

    def bodies(self, time: float) -> Floats:
        """(n, 3) x, y, radius, m, of every disc at a time, s."""
        rows = [self.discs]
        for person in self.people:
            x, y = person(time)
            if not self.legs:
                rows.append(np.array([(x, y, self.radius)]))
                continue
            ahead, behind = person(time + 0.05), person(time - 0.05)
            vx, vy = (ahead[0] - behind[0]) / 0.1, (ahead[1] - behind[1]) / 0.1
            speed = math.hypot(vx, vy)
            ux, uy = (vx / speed, vy / speed) if speed > 0.05 else (1.0, 0.0)
            # A step is up to 0.6 m at a walk; the feet stand 0.2 m apart.
            swing = 0.25 * min(1.0, speed) * math.sin(math.tau * 0.9 * time)
            rows.append(np.array([(x + s * (swing * ux - 0.1 * uy), y + s * (swing * uy + 0.1 * ux), 0.06)
                                  for s in (-1.0, 1.0)]))  # fmt: skip
        return np.concatenate(rows)

    def ranges(self, time: float, pose: tuple[float, float, float], bearings: Floats) -> Floats:
        """(n,) true range of each beam, m; +inf for no echo."""
        direction = np.stack([np.cos(pose[2] + bearings), np.sin(pose[2] + bearings)], 1)
        best = np.full(len(bearings), np.inf)
        for x, y, radius in self.bodies(time):
            px, py = x - pose[0], y - pose[1]
            along = px * direction[:, 0] + py * direction[:, 1]
            across = px * direction[:, 1] - py * direction[:, 0]
            hit = along - np.sqrt(np.maximum(radius * radius - across * across, 0.0))
            best = np.where((np.abs(across) < radius) & (hit > 0.0), np.minimum(best, hit), best)
        for x0, y0, x1, y1 in self.walls:
            ex, ey, px, py = x1 - x0, y1 - y0, x0 - pose[0], y0 - pose[1]
            with np.errstate(divide="ignore", invalid="ignore"):
                cross = direction[:, 0] * ey - direction[:, 1] * ex
                along = (px * ey - py * ex) / cross
                share = (px * direction[:, 1] - py * direction[:, 0]) / cross
            best = np.where((along > 0.0) & (share >= 0.0) & (share <= 1.0), np.minimum(best, along), best)
        return np.where(best < self.reach, best, np.inf)

    def odometry(self, time: float) -> tuple[float, float, float]:
        """Where the robot believes that it is: x, y, m, heading, rad."""
        x, y, heading = (value * (1.0 + self.drift) for value in self.robot(time))
        if not self.slip:
            return x, y, heading
        steps = round(time / PERIOD)
        apart = math.dist(self.robot(0.0)[:2], self.robot(PERIOD)[:2])
        missed = self.slip * math.sqrt(apart) * np.random.default_rng(self.seed + 1).standard_normal(steps)
        turned = heading + np.append(0.0, np.cumsum(missed))
        ways = apart * np.stack([np.cos(turned[:-1]), np.sin(turned[:-1])]).sum(axis=1)
        return float(ways[0]), float(ways[1]), float(turned[-1])

    def scans(self, until: float) -> Iterator[tuple[float, Floats]]:
        """Time, s, and beams, as those of `place_beams`, of each scan."""
        rng, bearings = np.random.default_rng(self.seed), np.linspace(-math.pi, math.pi, self.beams, endpoint=False)
        for number in range(round(until / PERIOD)):
            time = number * PERIOD
            offsets = np.linspace(0.0, self.scan_time, self.beams)
            poses = np.array([self.robot(time + offset) for offset in offsets])
            if self.scan_time:
                ranges = np.concatenate([self.ranges(time + o, tuple(p), np.array([b]))
                                         for o, p, b in zip(offsets, poses, bearings, strict=True)])  # fmt: skip
            else:
                ranges = self.ranges(time, tuple(poses[0]), bearings)
            ranges = ranges + self.sigma * rng.standard_normal(self.beams)
            out = np.empty((self.beams, 5))
            believed = np.array([self.odometry(time + offset) for offset in offsets])
            place_beams(believed, np.zeros((self.beams, 2)), bearings, ranges, np.array([0.05, self.reach]), out)
            yield time, out


def tracked(
    scene: Scene, until: float, mapped: Callable[[Floats], NDArray[np.int64]] | None = None, **settings: float
) -> Iterator[tuple[float, Tracks]]:
    """Time, s, and published tracks after each scan; `mapped` tells what a map says of (n, 2) points, m."""
    tracker = Tracker(PeopleTrackerParams(**settings))
    for time, beams in scene.scans(until):
        said = np.full(len(beams), -1) if mapped is None else mapped(beams[:, 2:4])
        tracker.see(time, "laser", np.array(scene.odometry(time)), beams, math.tau / scene.beams, said)
        yield time, tracker.published(time)


def room(half: float) -> Floats:
    """The four walls of a square room around the origin; its half width, m."""
    corners = half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)])
    return np.hstack([corners[:-1], corners[1:]])


def walker(x: float, y: float, vx: float, vy: float) -> Callable[[float], tuple[float, float]]:
    """A person who walks straight on."""
    return lambda time: (x + vx * time, y + vy * time)


def wanderer(rng: np.random.Generator, half: float) -> Callable[[float], tuple[float, float]]:
    """A person who walks from place to place in a square around the origin, of this half width, m, for 40 s."""
    times, places = [0.0], [rng.uniform(-half, half, 2)]
    while times[-1] < 40.0:
        places.append(rng.uniform(-half, half, 2))
        times.append(times[-1] + float(np.hypot(*(places[-1] - places[-2]))) / rng.uniform(0.5, 1.4))
    x, y = np.array(places).T
    return lambda time: (float(np.interp(time, times, x)), float(np.interp(time, times, y)))
