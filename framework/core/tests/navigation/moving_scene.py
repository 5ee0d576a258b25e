"""A robot with a laser, checked by the gate's monitor, among walls and discs that move."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from navloom.messages import Odometry, Pose2D, RangeScan, Twist2D
from navloom.navigation.collision_monitor import CollisionMonitor, MonitorLimits, Verdict
from navloom.navigation.monitor_rollout import distance_to_outline
from numpy.typing import NDArray

__all__ = ["Disc", "Scene", "ray_ranges"]

Floats = NDArray[np.float64]

FINE = 0.01
"""Step of the motion, s."""


@dataclass(frozen=True)
class Disc:
    """A disc whose centre, m, is a function of the time, s."""

    at: Callable[[float], tuple[float, float]]
    radius: float


def ray_ranges(x: float, y: float, bearings: Floats, discs: list[tuple[float, float, float]], walls: Floats) -> Floats:
    """(n,) distance along rays from a place to discs (x, y, radius) and walls (k, 4) from x, y to x, y, m."""
    ux, uy = np.cos(bearings), np.sin(bearings)
    found = np.full(len(bearings), math.inf)
    for cx, cy, radius in discs:
        along, aside = ux * (cx - x) + uy * (cy - y), ux * (cy - y) - uy * (cx - x)
        with np.errstate(invalid="ignore"):
            far = along - np.sqrt(radius * radius - aside * aside)
        found = np.fmin(found, np.where(far > 0.0, far, math.inf))
    for ax, ay, bx, by in walls:
        ex, ey = bx - ax, by - ay
        with np.errstate(divide="ignore", invalid="ignore"):
            across = ux * ey - uy * ex
            far = ((ax - x) * ey - (ay - y) * ex) / across
            part = ((ax - x) * uy - (ay - y) * ux) / across
        found = np.fmin(found, np.where((far > 0.0) & (part >= 0.0) & (part <= 1.0), far, math.inf))
    return found


@dataclass
class Scene:
    """A robot with motor lag and dead time that a laser of 360° leads.

    Attributes:
        limits: Of the monitor.
        discs: What moves, or stands.
        walls: (k, 4) from x, y to x, y, m.
        beams, every: Of the laser, and ticks between two scans.
        sigma: Of its ranges, m.
        slip: Error of the odometry's way and, rad per m, of its heading.
    """

    limits: MonitorLimits
    discs: list[Disc]
    walls: Floats = field(default_factory=lambda: np.empty((0, 4)))
    beams: int = 360
    every: int = 1
    sigma: float = 0.03
    slip: tuple[float, float] = (0.0, 0.0)
    pose: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    guess: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    twist: list[float] = field(default_factory=lambda: [0.0, 0.0])
    tick: int = 0
    speed: float = 0.0
    turn: float = 0.0
    verdicts: list[Verdict] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.monitor = CollisionMonitor(self.limits)
        self.noise = np.random.default_rng(5)
        self.given = deque([(0.0, 0.0)] * (1 + round(self.limits.robot.dead_time / FINE)))
        self.bearings = (np.arange(self.beams) + 0.5) * (math.tau / self.beams) - math.pi

    @property
    def time(self) -> float:
        """Run time, s."""
        return self.tick * self.limits.period

    def step(self, vx: float, wz: float = 0.0) -> Verdict:
        """Run one tick: odometry, scan, verdict, and the wheels for a period."""
        stamp, robot, period = round(self.time * 1e9), self.limits.robot, self.limits.period
        x, y, heading = self.guess
        moving = Twist2D(self.twist[0], 0.0, self.twist[1])
        self.monitor.move(Odometry(stamp, Pose2D(x, y, math.remainder(heading, math.tau)), moving))
        if self.tick % self.every == 0:
            self.monitor.look("laser", self.scan(stamp))
        step = (robot.max_acceleration if abs(vx) > abs(self.speed) else robot.max_deceleration) * period
        wanted = min(max(vx, self.speed - step), self.speed + step)
        verdict = self.monitor.judge(Twist2D(wanted, 0.0, wz), self.speed, self.time)
        self.monitor.give(self.time, verdict.twist)
        self.speed, self.turn = verdict.twist.vx, verdict.twist.wz
        self.verdicts.append(verdict)
        for _ in range(round(period / FINE)):
            self._drive(verdict.twist)
        self.tick += 1
        return verdict

    def _drive(self, twist: Twist2D) -> None:
        robot = self.limits.robot
        self.given.append((twist.vx, twist.wz))
        acts = self.given.popleft()
        blend = 1.0 - math.exp(-FINE / robot.motor_lag) if robot.motor_lag else 1.0
        for k in range(2):
            self.twist[k] += blend * (acts[k] - self.twist[k])
        v, w = self.twist
        for place, way, turn in ((self.pose, v, w), (self.guess, v * (1.0 + self.slip[0]), w + self.slip[1] * v)):
            middle = place[2] + 0.5 * turn * FINE
            place[0] += way * FINE * math.cos(middle)
            place[1] += way * FINE * math.sin(middle)
            place[2] += turn * FINE

    def scan(self, stamp: int) -> RangeScan:
        """What the laser sees now, with noise."""
        x, y, heading = self.pose
        discs = [(*disc.at(self.time), disc.radius) for disc in self.discs]
        ranges = ray_ranges(x, y, self.bearings + heading, discs, self.walls)
        ranges = np.maximum(ranges + self.sigma * self.noise.standard_normal(len(ranges)), 0.05)
        ranges[ranges >= 10.0] = math.inf
        nothing = np.zeros(len(ranges))
        return RangeScan(stamp, np.zeros((len(ranges), 2)), self.bearings, nothing, nothing, ranges, 0.05, 10.0)

    def gap(self) -> float:
        """Distance between the true footprint and the nearest disc, m; where one touches, 0 or less."""
        x, y, heading = self.pose
        cos, sin = math.cos(heading), math.sin(heading)
        gaps = []
        for disc in self.discs:
            dx, dy = disc.at(self.time)[0] - x, disc.at(self.time)[1] - y
            gap = distance_to_outline(cos * dx + sin * dy, cos * dy - sin * dx, self.limits.robot.footprint)
            gaps.append(float(gap) - disc.radius)
        return min(gaps)
