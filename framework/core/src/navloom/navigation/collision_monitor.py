"""The gate's collision monitor: the last check of a command before it reaches the wheels.

It uses range scans, odometry and the commands that it let pass. It scales forward and turn speed of a command down
together, to the largest share after which the robot can still stop without touching anything (`monitor_rollout`). If
no share is free, the robot brakes along its current curvature, which the previous check found free.

While the localizer tracks, the map is a second limit, where no echo shows its surfaces (`monitor_map`). It only ever
slows the robot.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.frames import compose, inverse, transform
from navloom.messages import OccupancyGrid, Odometry, Point2D, Pose2D, PoseEstimate, RangeScan, Twist2D
from navloom.navigation import monitor_map
from navloom.navigation.braking import braked
from navloom.navigation.monitor_echoes import KEEP, MOST_DRIFT, NO_POINTS, SensorEchoes
from navloom.navigation.monitor_known_space import SeenSpace
from navloom.navigation.monitor_map import NO_SURFACES, shown_aside, surfaces_without_echo
from navloom.navigation.monitor_rollout import (
    MOST_POSES,
    distance_to_outline,
    first_touch,
    margins,
    stopping_way,
    within,
)
from navloom.navigation.odometry_frame import OdometryFrame
from navloom.roles import RobotSpec

__all__ = ["CollisionMonitor", "MonitorLimits", "Verdict", "warm_up"]

Floats = NDArray[np.float64]
Kind = Literal["", "obstacle", "unseen"]
Planar = tuple[float, float, float]
"""A velocity: forward, m/s, turn rate, rad/s, to the left, m/s."""
Touch = tuple[Kind, Point2D, float]
"""What the robot would touch: kind, place in the base frame, m, and distance from the footprint, m."""

UNSEEN_MEMORY = 5.0
"""Travelled distance for which space that was seen or occupied by the robot counts as known, m."""
# Faster than any robot that this monitor is for, so that only a restart exceeds them.
JUMP, FASTEST = 0.3, 5.0
"""Odometry that jumps farther than JUMP, m, plus FASTEST, m/s, times the elapsed time: the platform restarted."""
TURN, FASTEST_TURN = 0.5, 10.0
"""The same for its heading, rad and rad/s."""
SILENT = 1.0
"""A longer gap in the odometry, s, also counts as a restart: the robot may have been moved meanwhile."""
BACK = 1.0
"""An odometry stamp that goes back by more than this, s, also counts as a restart."""
HALVINGS = 5
"""Bisection steps of the search for the largest share."""
LEAST_SHARE = 0.05
"""Smallest share of a command that is driven; below it the robot stops, unless it drives at CREEPING or faster."""
CREEPING, STILL = 0.02, 0.002
"""Speed that is driven even if the share is below LEAST_SHARE, and speed of the footprint below which the robot stops,
m/s: what counts as rounding in one tick adds up to a contact within a minute."""
SLIDING, SLOPE = 0.05, 0.02
"""Speed, m/s, up to which a robot may slide along what is within its margin, and the slope at which it may come nearer.

A robot 2 cm beside a wall has noisy echoes within its margin. Without the slope, the drift of its wheels would hold it.
"""
OLD_POSE = 1.0
"""Age of a pose, s, from which on the map does not count: odometry alone drifts."""
STEERED = 0.05
"""Least measured speed, m/s, that tells the angle of steered wheels by the turn."""


@dataclass(frozen=True)
class MonitorLimits:
    """The robot and sensor model of the monitor.

    Attributes:
        robot: Its footprint, how it brakes, and its delays.
        period: Control tick, s.
        sigma: Standard deviation of a range, m.
        margin: Distance from the footprint that counts as touching, m.
    """

    robot: RobotSpec
    period: float
    sigma: float
    margin: float = 0.01


class Verdict(NamedTuple):
    """The monitor's decision on a command.

    Attributes:
        twist: The velocity that may be driven.
        share: Its share of the command; 1 if the command passes unchanged.
        kind: What limits it: nothing, an obstacle, or space that no sensor has seen.
        place: Place of the obstacle or unseen space in the base frame, m; None for nothing.
        distance: Distance from the footprint to it, m.
    """

    twist: Twist2D
    share: float = 1.0
    kind: Kind = ""
    place: Point2D | None = None
    distance: float | None = None

    @property
    def is_stopped(self) -> bool:
        """Whether the robot is stopped because something is in the way."""
        return bool(self.kind) and self.twist.vx == 0.0 and self.twist.vy == 0.0 and self.twist.wz == 0.0


class CollisionMonitor:
    """Checks commands against scans and odometry.

    Args:
        limits: The robot and sensor model.

    Attributes:
        ignores_unseen: An operator lets the robot enter space that no sensor has seen.
    """

    def __init__(self, limits: MonitorLimits) -> None:
        self.limits, robot = limits, limits.robot
        self.ignores_unseen = False
        self._outline = np.ascontiguousarray(robot.footprint, dtype=np.float64)
        self._radius = float(np.hypot(self._outline[:, 0], self._outline[:, 1]).max())
        # Infinity times a time of 0 would be NaN in the kernel.
        turning = min(robot.max_angular_acceleration, 1e6)
        motor = [limits.period, robot.max_deceleration, turning, robot.motor_lag, robot.dead_time]
        self._steers = robot.drive == "ackermann"
        if self._steers:
            motor += [robot.wheelbase, min(robot.max_steering_rate, 1e6), 0.0]
        self._motor = np.array(motor)
        self._rolled, self._alone = np.empty((MOST_POSES, 3)), np.empty((MOST_POSES, 3))
        self.forget()

    def forget(self) -> None:
        """Forget all scans, odometry and commands, as after a restart of the platform."""
        self._seen = SeenSpace(self._outline, UNSEEN_MEMORY, KEEP)
        self._sensors: dict[str, SensorEchoes] = {}
        self._stamps: list[float] = []
        self._poses: list[tuple[float, float, float]] = []
        self._twist = np.zeros(3)
        self._ways: list[float] = []
        self._waiting: list[tuple[str, RangeScan]] = []
        self._given: deque[tuple[float, float, float, float]] = deque()
        self._is_free = True
        self._estimate: PoseEstimate | None = None
        self._frame = OdometryFrame()
        self._grid: OccupancyGrid | None = None

    def move(self, odometry: Odometry) -> None:
        """Take the newest odometry."""
        pose, time = odometry.pose, odometry.stamp_ns * 1e-9
        if self._stamps and self._begins_again(pose, time):
            self.forget()
        # The same odometry comes again in ticks without a newer one.
        if self._stamps and time <= self._stamps[-1]:
            return
        heading, way = pose.heading, 0.0
        if self._poses:
            x, y, last = self._poses[-1]
            # Unwrapped, because headings are interpolated between two stamps.
            heading = last + math.remainder(heading - last, math.tau)
            way = self._ways[-1] + math.hypot(pose.x - x, pose.y - y)
        self._stamps.append(time)
        self._poses.append((pose.x, pose.y, heading))
        self._ways.append(way)
        self._twist[:] = odometry.twist.vx, odometry.twist.wz, odometry.twist.vy
        if self._steers and abs(odometry.twist.vx) > STEERED:
            self._motor[7] = math.atan(self._motor[5] * odometry.twist.wz / odometry.twist.vx)
        # Half at once, since deleting from the front of a list costs its whole length.
        if len(self._stamps) > 512:
            del self._stamps[:256], self._poses[:256], self._ways[:256]
        if self._is_free:  # else a robot stopped for unseen space would mark it as known bit by bit while it slides
            self._seen.stand(np.array(self._poses[-1]), way)
        waiting, self._waiting = self._waiting, []
        for name, scan in waiting:
            self.look(name, scan)

    def locate(self, estimate: PoseEstimate | None, grid: OccupancyGrid | None) -> None:
        """Take the newest pose and map; None before the first.

        A robot that is elsewhere than odometry led it was carried: what it remembers out of view is void.
        """
        is_old = self._estimate is estimate
        self._estimate, self._grid = estimate, grid
        if is_old or estimate is None or estimate.state != "tracking" or not self._stamps:
            return
        time = estimate.stamp_ns * 1e-9
        odometry = self._poses[max(0, bisect_right(self._stamps, time + 1e-6) - 1)]
        if self._frame.jumps(time, estimate.pose, odometry):
            self._seen = SeenSpace(self._outline, UNSEEN_MEMORY, KEEP)
            for sensor in self._sensors.values():
                sensor.forget_unseen()

    def _begins_again(self, pose: Pose2D, time: float) -> bool:
        """Whether the platform restarted: the odometry was silent, jumps, or its clock went back by more than BACK."""
        x, y, heading = self._poses[-1]
        passed = time - self._stamps[-1]
        jumps = math.hypot(pose.x - x, pose.y - y) > JUMP + FASTEST * abs(passed) or (
            abs(math.remainder(pose.heading - heading, math.tau)) > TURN + FASTEST_TURN * abs(passed)
        )
        return passed < -BACK or passed > max(SILENT, 5.0 * self.limits.period) or (passed > 0.0 and jumps)

    def look(self, name: str, scan: RangeScan) -> bool:
        """Take a scan; False if it is not newer than the last, or must wait for the odometry of its time."""
        time, made = scan.stamp_ns * 1e-9, SensorEchoes(self.limits.sigma, self._outline)
        sensor = self._sensors.setdefault(name, made)
        if sensor.scans and time <= sensor.scans[0][0]:
            return False
        if not self._stamps or time > self._stamps[-1]:
            # Extrapolated odometry would move the echoes by what the wheels do meanwhile.
            self._waiting.append((name, scan))
            return False
        poses = self._poses_at(time + scan.time_offsets)
        origins, bearings, halves, ranges = scan.origins, scan.bearings, scan.half_angles, scan.ranges
        limits = np.array([scan.range_min, scan.range_max])
        way = self._ways[bisect_right(self._stamps, time) - 1]
        self._seen.look(poses, (origins, bearings, halves, ranges), limits, np.array([time, way]))
        if halves.size and halves.max() > 0.0:
            sensor.look_by_sonars(time, scan, poses, self._moved_since(sensor, poses))
        else:
            sensor.look_by_laser(time, scan, poses if len(poses) else np.array(self._poses[-1:]))
        return True

    def _moved_since(self, sensor: SensorEchoes, poses: Floats) -> float:
        """Upper bound of the motion of any point of the robot from a sensor's previous scan to the last pose, m."""
        if not sensor.scans:
            return 0.0
        x, y, heading = self._poses_at(np.array([sensor.scans[0][0]]))[0]
        here = poses[-1]
        return float(math.hypot(here[0] - x, here[1] - y) + self._radius * abs(here[2] - heading))

    def _poses_at(self, times: Floats) -> Floats:
        """(n, 3) poses of the base, odometry frame, at times, s; extrapolated by twist after the newest odometry."""
        newest = self._stamps[-1]
        if len(times) and times.min() == times.max() and times[0] in self._stamps[-4:]:
            pose = self._poses[len(self._stamps) - 1 - self._stamps[::-1].index(times[0])]
            return np.tile(np.array(pose), (len(times), 1))
        start = max(0, bisect_right(self._stamps, float(times.min()) if len(times) else newest) - 1)
        stamps, poses = np.array(self._stamps[start:]), np.array(self._poses[start:])
        inside = np.clip(times, stamps[0], newest)
        found = np.stack([np.interp(inside, stamps, poses[:, k]) for k in range(3)], axis=1)
        # Beams at the end of a scan may be later than the newest odometry.
        late = np.maximum(times - newest, 0.0)
        found[:, 0] += late * self._twist[0] * np.cos(found[:, 2])
        found[:, 1] += late * self._twist[0] * np.sin(found[:, 2])
        if self._twist[2]:
            found[:, 0] -= late * self._twist[2] * np.sin(found[:, 2])
            found[:, 1] += late * self._twist[2] * np.cos(found[:, 2])
        found[:, 2] += late * self._twist[1]
        return found

    def give(self, time: float, twist: Twist2D) -> None:
        """Record a command that went to the wheels at a run time, s."""
        self._given.append((time, twist.vx, twist.wz, twist.vy))
        # Too slow to measure the angle by its turn: then the wheels are taken to be where they were told.
        if self._steers and twist.vx != 0.0 and abs(self._twist[0]) <= STEERED:
            self._motor[7] = math.atan(self._motor[5] * twist.wz / twist.vx)
        while len(self._given) > 1 and self._given[1][0] < time - self.limits.robot.dead_time - KEEP:
            self._given.popleft()

    def judge(self, twist: Twist2D, speed: float, time: float) -> Verdict:
        """The largest share of a command after which the robot can stop without touching anything.

        Args:
            twist: The command, within the robot's limits.
            speed: Speed of the previous command, m/s, negative backwards: it falls by no more than the deceleration
                allows.
            time: Run time, s.
        """
        verdict = self._judge(twist, speed, time)
        self._is_free = verdict.kind != "unseen"
        return verdict

    def _judge(self, twist: Twist2D, speed: float, time: float) -> Verdict:
        pace = math.hypot(twist.vx, twist.vy) if twist.vy else twist.vx
        if not self._stamps or (pace == 0.0 and twist.wz == 0.0 and speed == 0.0):
            return Verdict(twist)
        age = max(0.0, time - self._stamps[-1])
        command = (twist.vx, twist.wz, twist.vy)
        in_flight = np.array([(at - self._stamps[-1], *sent) for at, *sent in self._given]).reshape(-1, 4)
        points = self._near(twist, age)
        touched = self._touch(command, in_flight, age, points)
        if touched is None:
            return Verdict(twist)
        lowest = 0.0
        if pace != 0.0 and pace * speed > 0.0:
            # A share below what the brakes reach within a period could not be driven: the roll-out would be too kind.
            lowest = abs(self._slower(speed)) / abs(pace)
        low, high = min(lowest, 1.0), 1.0
        if self._touch(_scaled(command, low), in_flight, age, points) is not None:
            return self._brake(speed, in_flight, age, points, touched)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            hit = self._touch(_scaled(command, middle), in_flight, age, points)
            if hit is None:
                low = middle
            else:
                high, touched = middle, hit
        speed = low * abs(pace)
        # A robot that creeps by a few percent of its command reaches nothing, and the goal would see no stop.
        if (low < LEAST_SHARE and speed < CREEPING) or speed + self._radius * low * abs(twist.wz) < STILL:
            return Verdict(Twist2D(0.0, 0.0, 0.0), 0.0, *touched)
        return Verdict(Twist2D(low * twist.vx, low * twist.vy, low * twist.wz), low, *touched)

    def _brake(self, speed: float, in_flight: Floats, age: float, points: Floats, touched: Touch) -> Verdict:
        """Brake along the current curvature; if that touches something too, command zero at once."""
        _, v, w, side = self._given[-1] if self._given else (0.0, 0.0, 0.0, 0.0)
        pace = math.hypot(v, side) if side else v
        if speed != 0.0 and pace != 0.0:
            # The curvature of the last command that passed: the check then found braking along it free.
            slower = self._slower(speed)
            turn = w * slower / pace
            v, side = (v * slower / pace, side * slower / pace) if side else (slower, 0.0)
            if self._touch((v, turn, side), in_flight, age, points) is None:
                return Verdict(Twist2D(v, side, turn), 0.0, *touched)
        return Verdict(Twist2D(0.0, 0.0, 0.0), 0.0, *touched)

    def _slower(self, speed: float) -> float:
        """A speed, m/s, after braking for one period."""
        return braked(speed, self.limits.robot.max_deceleration * self.limits.period)

    def _touch(self, command: Planar, in_flight: Floats, age: float, points: Floats) -> Touch | None:
        """What the robot would touch first if it followed a command for one period and then braked."""
        wanted, (v, w, side) = np.array(command), command
        rolled = stopping_way(self._twist, in_flight, age, wanted, self._motor, self._radius, self._rolled)
        wide = margins(points, v, w, side, self.limits.margin)
        slope = SLOPE if math.hypot(v, side) <= SLIDING else 0.0
        hit = first_touch(self._rolled, rolled, self._outline, points, wide, slope)
        if hit < 0:  # measured speed is noisy: each tick, it may seem to lead away by more than the command approaches
            wide[~within(points, self._outline, wide)] = -math.inf
            still, none = np.zeros(3), in_flight[:0]
            count = stopping_way(still, none, 0.0, wanted, self._motor, self._radius, self._alone)
            hit = first_touch(self._alone, count, self._outline, points, wide, slope)
        if hit >= 0:
            x, y = float(points[hit, 0]), float(points[hit, 1])
            return "obstacle", Point2D(x, y), max(0.0, float(distance_to_outline(x, y, self._outline)))
        if not self.ignores_unseen:
            base = np.array(self._poses[-1])
            place = self._seen.first_unseen(self._rolled, rolled, base, self._stamps[-1], self._ways[-1])
            if place >= 0:
                x, y, _ = self._rolled[place]
                return "unseen", Point2D(float(x), float(y)), float(math.hypot(x, y))
        return None

    def _reach(self, twist: Twist2D, age: float) -> float:
        """How far from the base the robot may come until it has stopped, m."""
        robot, limits = self.limits.robot, self.limits
        v = max(math.hypot(twist.vx, twist.vy), math.hypot(self._twist[0], self._twist[2]))
        v = max(v, *(math.hypot(v, side) for _, v, _, side in self._given), 0.0)
        # Generous by 0.1 s: a point too many costs time only, one too few is an obstacle that is not seen.
        lag = 5.0 * robot.motor_lag
        time = age + robot.dead_time + limits.period + lag + 0.5 * v / robot.max_deceleration + 0.1
        return self._radius + limits.margin + MOST_DRIFT + v * time

    def _surfaces(self, reach: float, echoes: Floats) -> Floats:
        """(k, 2) points of mapped surfaces in reach that no echo shows, m, base frame of the newest odometry.

        None while the localizer does not track, and before its first pose after a restart of the platform.
        """
        estimate, grid = self._estimate, self._grid
        if estimate is None or grid is None or estimate.state != "tracking":
            return NO_SURFACES
        time, base = estimate.stamp_ns * 1e-9, estimate.pose
        # A pose from before a restart of the platform is of another odometry frame.
        if not self._stamps[0] <= time or time < self._stamps[-1] - OLD_POSE:
            return NO_SURFACES
        if time < self._stamps[-1]:
            moved = compose(inverse(self._poses_at(np.array([time]))[0]), self._poses[-1])
            base = Pose2D(*compose((base.x, base.y, base.heading), moved).tolist())
        found = surfaces_without_echo(grid, base, reach, echoes)
        is_shown = self._covers(found)
        # Coarse cells about a thin post would otherwise stop a robot beside an object whose echoes it sees.
        is_shown[is_shown] = shown_aside(found[is_shown], echoes, grid.resolution)
        return found[~is_shown]

    def _covers(self, points: Floats) -> NDArray[np.bool_]:
        """(k,) which points (k, 2), m, base frame of the newest odometry, lie in a direction that a laser looks at."""
        placed = transform(self._poses[-1], points)
        found = np.zeros(len(points), np.bool_)
        for sensor in self._sensors.values():
            found |= sensor.covers(placed)
        return found

    def _near(self, twist: Twist2D, age: float) -> Floats:
        """(k, 3) obstacle points in reach, base frame of the newest odometry, and how far they may reach beyond, m."""
        reach = self._reach(twist, age)
        x, y, heading = self._poses[-1]
        cos, sin = math.cos(heading), math.sin(heading)
        near = []
        for sensor in self._sensors.values():
            dx, dy = sensor.obstacles[:, 0] - x, sensor.obstacles[:, 1] - y
            kept = dx * dx + dy * dy <= reach * reach
            dx, dy = dx[kept], dy[kept]
            beyond = sensor.obstacles[kept, 2]
            near.append(np.stack([cos * dx + sin * dy, cos * dy - sin * dx, beyond], axis=1))
        seen = np.concatenate(near) if near else NO_POINTS
        mapped = self._surfaces(reach, seen[:, :2])
        return np.concatenate([seen, np.column_stack([mapped, np.zeros(len(mapped))])])


def _scaled(command: Planar, share: float) -> Planar:
    return share * command[0], share * command[1], share * command[2]


def warm_up() -> None:
    """Compile the kernels for the array types of messages."""
    monitor_map.warm_up()
    two, one, wide = np.zeros((2, 2)), np.ones(2), np.full(2, 0.1)
    for array in (two, one, wide):
        array.flags.writeable = False
    square = np.array([(0.3, 0.3), (-0.3, 0.3), (-0.3, -0.3), (0.3, -0.3)])
    robot = RobotSpec(square, 1.0, 0.05, 0.2, 0.5, 1.0, 0.5, 1.0)
    monitor = CollisionMonitor(MonitorLimits(robot, 0.05, 0.03))
    still = Odometry(0, Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0))
    monitor.move(still)
    for halves in (np.zeros(2), wide):
        halves.flags.writeable = False
        # Each kind of sensor under a name of its own: a second scan of one stamp would be left out.
        monitor.look(f"{halves[0]}", RangeScan(0, two, one, halves, np.zeros(2), one, 0.1, 4.0))
    monitor.give(0.0, still.twist)
    monitor.judge(Twist2D(0.5, 0.0, 0.1), 0.0, 0.0)
