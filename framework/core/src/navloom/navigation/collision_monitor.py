"""The gate's collision monitor: the last check of a command before it reaches the wheels.

It uses range scans, odometry and the commands that it let pass. It scales forward and turn speed of a command down
together, to the largest share after which the robot can still stop without touching anything (`monitor_rollout`). If
no share is free, the robot brakes along its current curvature, which the previous check found free.

While the localizer tracks, the map is a second limit, where no echo shows its surfaces (`monitor_map`). It only ever
slows the robot.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.frames import compose, inverse, transform
from navloom.messages import OccupancyGrid, Odometry, Point2D, Pose2D, PoseEstimate, RangeScan, Twist2D
from navloom.navigation import monitor_map
from navloom.navigation.braking import braked
from navloom.navigation.monitor_echoes import KEEP, MOST_DRIFT, NO_POINTS, NOTHING_MOVES, SensorEchoes
from navloom.navigation.monitor_known_space import SeenSpace
from navloom.navigation.monitor_map import NO_SURFACES, shown_aside, surfaces_without_echo
from navloom.navigation.monitor_rollout import (
    ESCAPE,
    HEADWAY,
    MOST_POSES,
    STANDS,
    distance_to_outline,
    escapes,
    first_meeting,
    first_touch,
    margins,
    stopping_way,
    ways_on,
    within,
)
from navloom.navigation.monitor_verdict import MonitorLimits, Planar, Surroundings, Touch, Verdict, scaled
from navloom.navigation.odometry_frame import OdometryFrame
from navloom.navigation.odometry_track import OdometryTrack
from navloom.roles import RobotSpec

__all__ = ["CollisionMonitor", "MonitorLimits", "Verdict", "warm_up"]

Floats = NDArray[np.float64]

UNSEEN_MEMORY = 5.0
"""Travelled distance for which space that was seen or occupied by the robot counts as known, m."""
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
        self._times, self._alone_times = np.empty(MOST_POSES), np.empty(MOST_POSES)
        self.forget()

    def forget(self) -> None:
        """Forget all scans, odometry and commands, as after a restart of the platform."""
        self._seen = SeenSpace(self._outline, UNSEEN_MEMORY, KEEP)
        self._sensors: dict[str, SensorEchoes] = {}
        self._track = OdometryTrack()
        self._waiting: list[tuple[str, RangeScan]] = []
        self._given: deque[tuple[float, float, float, float]] = deque()
        self._is_free = True
        self._met_at = math.inf  # when the way last rolled out meets what moves, s
        self._estimate: PoseEstimate | None = None
        self._frame = OdometryFrame()
        self._grid: OccupancyGrid | None = None

    def move(self, odometry: Odometry) -> None:
        """Take the newest odometry."""
        if self._track.begins_again(odometry, self.limits.period):
            self.forget()
        if not self._track.add(odometry):
            return
        if self._steers and abs(odometry.twist.vx) > STEERED:
            self._motor[7] = math.atan(self._motor[5] * odometry.twist.wz / odometry.twist.vx)
        if self._is_free:  # else a robot stopped for unseen space would mark it as known bit by bit while it slides
            self._seen.stand(np.array(self._track.poses[-1]), self._track.ways[-1])
        waiting, self._waiting = self._waiting, []
        for name, scan in waiting:
            self.look(name, scan)

    def locate(self, estimate: PoseEstimate | None, grid: OccupancyGrid | None) -> None:
        """Take the newest pose and map; None before the first.

        A robot that is elsewhere than odometry led it was carried: what it remembers out of view is void.
        """
        is_old = self._estimate is estimate
        self._estimate, self._grid = estimate, grid
        if is_old or estimate is None or estimate.state != "tracking" or not self._track.stamps:
            return
        time = estimate.stamp_ns * 1e-9
        odometry = self._track.poses[self._track.last_before(time, 1e-6)]
        if self._frame.jumps(time, estimate.pose, odometry):
            self._seen = SeenSpace(self._outline, UNSEEN_MEMORY, KEEP)
            for sensor in self._sensors.values():
                sensor.forget_unseen()

    def look(self, name: str, scan: RangeScan) -> bool:
        """Take a scan; False if it is not newer than the last, or must wait for the odometry of its time."""
        time, sensor = scan.stamp_ns * 1e-9, self._sensors.get(name)
        if sensor is None:
            sensor = SensorEchoes(self.limits.sigma, self._outline, self.limits.approach_speed)
            self._sensors[name] = sensor
        if sensor.scans and time <= sensor.scans[0][0]:
            return False
        if not self._track.stamps or time > self._track.stamps[-1]:
            # Extrapolated odometry would move the echoes by what the wheels do meanwhile.
            self._waiting.append((name, scan))
            return False
        poses = self._track.at(time + scan.time_offsets)
        origins, bearings, halves, ranges = scan.origins, scan.bearings, scan.half_angles, scan.ranges
        limits = np.array([scan.range_min, scan.range_max])
        way = self._track.ways[self._track.last_before(time)]
        self._seen.look(poses, (origins, bearings, halves, ranges), limits, np.array([time, way]))
        if halves.size and halves.max() > 0.0:
            sensor.look_by_sonars(time, scan, poses, self._moved_since(sensor, poses))
        else:
            sensor.look_by_laser(time, scan, poses if len(poses) else np.array(self._track.poses[-1:]))
        return True

    def _moved_since(self, sensor: SensorEchoes, poses: Floats) -> float:
        """Upper bound of the motion of any point of the robot from a sensor's previous scan to the last pose, m."""
        if not sensor.scans:
            return 0.0
        x, y, heading = self._track.at(np.array([sensor.scans[0][0]]))[0]
        here = poses[-1]
        return float(math.hypot(here[0] - x, here[1] - y) + self._radius * abs(here[2] - heading))

    def give(self, time: float, twist: Twist2D) -> None:
        """Record a command that went to the wheels at a run time, s."""
        self._given.append((time, twist.vx, twist.wz, twist.vy))
        # Too slow to measure the angle by its turn: then the wheels are taken to be where they were told.
        if self._steers and twist.vx != 0.0 and abs(self._track.twist[0]) <= STEERED:
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
        if not self._track.stamps or (pace == 0.0 and twist.wz == 0.0 and speed == 0.0):
            return Verdict(twist)
        age = max(0.0, time - self._track.stamps[-1])
        command = (twist.vx, twist.wz, twist.vy)
        in_flight = np.array([(at - self._track.stamps[-1], *sent) for at, *sent in self._given]).reshape(-1, 4)
        robot, period = self.limits.robot, self.limits.period
        accelerates = abs(pace) - abs(speed) > 0.5 * robot.max_acceleration * period
        here = Surroundings(in_flight, age, self._near(twist, age), self._moving(), accelerates)
        touched = self._touch(command, here)
        if touched is None:
            return Verdict(twist)
        met_at = self._met_at
        if met_at < math.inf and self._flees(command, here):
            return Verdict(twist)
        lowest = 0.0
        if pace != 0.0 and pace * speed > 0.0:
            # A share below what the brakes reach within a period could not be driven: the roll-out would be too kind.
            lowest = abs(self._slower(speed)) / abs(pace)
        low, high = min(lowest, 1.0), 1.0
        if self._touch(scaled(command, low), here) is not None:
            # What would meet a robot that brakes, too, and sooner, is no reason to brake.
            is_moving = self._met_at < math.inf and met_at < math.inf
            if is_moving and self._meets_later(command, self._met_at, here):
                return Verdict(twist)
            return self._brake(speed, here, touched)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            hit = self._touch(scaled(command, middle), here)
            if hit is None:
                low = middle
            else:
                high, touched = middle, hit
        speed = low * abs(pace)
        # A robot that creeps by a few percent of its command reaches nothing, and the goal would see no stop.
        if (low < LEAST_SHARE and speed < CREEPING) or speed + self._radius * low * abs(twist.wz) < STILL:
            return Verdict(Twist2D(0.0, 0.0, 0.0), 0.0, *touched)
        return Verdict(Twist2D(low * twist.vx, low * twist.vy, low * twist.wz), low, *touched)

    def _brake(self, speed: float, here: Surroundings, touched: Touch) -> Verdict:
        """Brake along the current curvature; if that touches something too, command zero at once."""
        _, v, w, side = self._given[-1] if self._given else (0.0, 0.0, 0.0, 0.0)
        pace = math.hypot(v, side) if side else v
        if speed != 0.0 and pace != 0.0:
            # The curvature of the last command that passed: the check then found braking along it free.
            slower = self._slower(speed)
            turn = w * slower / pace
            v, side = (v * slower / pace, side * slower / pace) if side else (slower, 0.0)
            if self._touch((v, turn, side), here) is None:
                return Verdict(Twist2D(v, side, turn), 0.0, *touched)
        return Verdict(Twist2D(0.0, 0.0, 0.0), 0.0, *touched)

    def _slower(self, speed: float) -> float:
        """A speed, m/s, after braking for one period."""
        return braked(speed, self.limits.robot.max_deceleration * self.limits.period)

    def _touch(self, command: Planar, here: Surroundings) -> Touch | None:
        """What the robot would touch first if it followed a command for one period and then braked."""
        wanted, points, (v, w, side) = np.array(command), here.points, command
        self._met_at = math.inf
        rolled = self._roll(wanted, here)
        wide = margins(points, v, w, side, self.limits.margin)
        slope = SLOPE if math.hypot(v, side) <= SLIDING else 0.0
        hit = first_touch(self._rolled, rolled, self._outline, points, wide, slope)
        if hit < 0:  # measured speed is noisy: each tick, it may seem to lead away by more than the command approaches
            wide[~within(points, self._outline, wide)] = -math.inf
            still, none = np.zeros(3), here.in_flight[:0]
            count = stopping_way(still, none, 0.0, wanted, self._motor, self._radius, self._alone, self._alone_times)
            hit = first_touch(self._alone, count, self._outline, points, wide, slope)
        if hit < 0 and len(here.moving):
            points, hit = here.moving, self._meets(wanted, here, rolled)
        if hit >= 0:
            x, y = float(points[hit, 0]), float(points[hit, 1])
            return "obstacle", Point2D(x, y), max(0.0, float(distance_to_outline(x, y, self._outline)))
        return self._enters_unseen(rolled)

    def _roll(self, command: Floats, here: Surroundings) -> int:
        """Roll out the stopping way of a command; the number of its poses."""
        given, age = here.in_flight, here.age
        args = self._motor, self._radius, self._rolled, self._times
        return int(stopping_way(self._track.twist, given, age, command, *args))

    def _enters_unseen(self, rolled: int) -> Touch | None:
        """Space that no sensor has seen on the stopping way."""
        if self.ignores_unseen:
            return None
        base = np.array(self._track.poses[-1])
        place = self._seen.first_unseen(self._rolled, rolled, base, self._track.stamps[-1], self._track.ways[-1])
        if place < 0:
            return None
        x, y, _ = self._rolled[place]
        return "unseen", Point2D(float(x), float(y)), float(math.hypot(x, y))

    def _meets(self, command: Floats, here: Surroundings, rolled: int) -> int:
        """Row of the moving point that the robot would meet on its stopping way; -1 for none.

        It does not stop a robot that escapes by going on: within ESCAPE it meets nothing, and has that point behind it.
        """
        moving, (v, w, side) = here.moving, command
        wide = margins(moving, v, w, side, self.limits.margin)
        hit, _, when = first_meeting(
            self._rolled, self._times, rolled, HEADWAY, self._outline, self._radius, moving, wide, True
        )
        self._met_at = when
        if hit < 0:
            return -1
        return -1 if self._gets_away(command, here, wide, hit) else int(hit)

    def _gets_away(self, command: Floats, here: Surroundings, wide: Floats, hit: int, may_brake: bool = True) -> bool:
        """Whether the robot escapes a moving point, a row, by going on in one of `ways_on`."""
        body = self._outline, self._radius, here.moving, wide, hit, may_brake
        return any(escapes(self._alone, self._alone_times, count, *body) for count in self._goes_on(command, here))

    def _goes_on(self, command: Floats, here: Surroundings) -> Iterator[int]:
        """Roll out one of `ways_on` after the other; yields the number of poses of each up to ESCAPE."""
        for way in ways_on(command, here.accelerates, self.limits.robot, self.limits.period):
            given = np.column_stack([here.age + self.limits.period * np.arange(len(way)), way])
            count = stopping_way(
                self._track.twist, np.concatenate([here.in_flight, given]), here.age + ESCAPE, command, self._motor,
                self._radius, self._alone, self._alone_times,
            )  # fmt: skip
            yield int(np.searchsorted(self._alone_times[:count], ESCAPE, side="right"))

    def _flees(self, twist: Planar, here: Surroundings) -> bool:
        """Whether what goes on as it does would hit the robot if it stopped now, and does not if it goes on."""
        command, moving = np.array(twist), here.moving
        wide = margins(moving, *twist, self.limits.margin)
        rolled = self._roll(np.zeros(3), here)
        body = self._outline, self._radius, moving, wide
        hit = first_meeting(self._rolled, self._times, rolled, STANDS, *body, False)[0]
        if hit < 0 or self._enters_unseen(self._roll(command, here)) is not None:
            return False
        return self._gets_away(command, here, wide, hit, may_brake=False)

    def _meets_later(self, twist: Planar, braking: float, here: Surroundings) -> bool:
        """Whether a robot that goes on meets what moves by more than HEADWAY later than if it braked, at a time, s."""
        command, moving = np.array(twist), here.moving
        if self._enters_unseen(self._roll(command, here)) is not None:
            return False
        wide = margins(moving, *twist, self.limits.margin)
        met = (
            first_meeting(self._alone, self._alone_times, count, 0.0, self._outline, self._radius, moving, wide, True)[
                2
            ]
            for count in self._goes_on(command, here)
        )
        return any(when > braking + HEADWAY for when in met)

    def _reach(self, twist: Twist2D, age: float) -> float:
        """How far from the base the robot may come until it has stopped, m."""
        robot, limits = self.limits.robot, self.limits
        measured = self._track.twist
        v = max(math.hypot(twist.vx, twist.vy), math.hypot(measured[0], measured[2]))
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
        if not self._track.stamps[0] <= time or time < self._track.stamps[-1] - OLD_POSE:
            return NO_SURFACES
        if time < self._track.stamps[-1]:
            moved = compose(inverse(self._track.at(np.array([time]))[0]), self._track.poses[-1])
            base = Pose2D(*compose((base.x, base.y, base.heading), moved).tolist())
        found = surfaces_without_echo(grid, base, reach, echoes)
        if not len(found):
            return found
        is_shown = self._covers(found)
        # Coarse cells about a thin post would otherwise stop a robot beside an object whose echoes it sees.
        is_shown[is_shown] = shown_aside(found[is_shown], echoes, grid.resolution)
        return found[~is_shown]

    def _covers(self, points: Floats) -> NDArray[np.bool_]:
        """(k,) which points (k, 2), m, base frame of the newest odometry, lie in a direction that a laser looks at."""
        placed = transform(self._track.poses[-1], points)
        found = np.zeros(len(points), np.bool_)
        for sensor in self._sensors.values():
            found |= sensor.covers(placed)
        return found

    def _near(self, twist: Twist2D, age: float) -> Floats:
        """(k, 3) obstacle points in reach, base frame of the newest odometry, and how far they may reach beyond, m."""
        reach = self._reach(twist, age)
        near = [sensor.near(self._track.poses[-1], reach) for sensor in self._sensors.values()]
        seen = np.concatenate(near) if near else NO_POINTS
        mapped = self._surfaces(reach, seen[:, :2])
        return np.concatenate([seen, np.column_stack([mapped, np.zeros(len(mapped))])]) if len(mapped) else seen

    def _moving(self) -> Floats:
        """(k, 7) obstacles that move, base frame of the newest odometry, as `first_meeting` takes them."""
        pose, time = self._track.poses[-1], self._track.stamps[-1]
        found = [sensor.moving_from(pose, time) for sensor in self._sensors.values() if len(sensor.moving)]
        return np.concatenate(found) if found else NOTHING_MOVES


def warm_up() -> None:
    """Compile the kernels for the array types of messages."""
    monitor_map.warm_up()
    two, one, wide = np.zeros((2, 2)), np.ones(2), np.full(2, 0.1)
    for array in (two, one, wide):
        array.flags.writeable = False
    square = np.array([(0.3, 0.3), (-0.3, 0.3), (-0.3, -0.3), (0.3, -0.3)])
    robot = RobotSpec(square, 1.0, 0.05, 0.2, 0.5, 1.0, 0.5, 1.0)
    monitor = CollisionMonitor(MonitorLimits(robot, 0.05, 0.03, approach_speed=1.0))
    still = Odometry(0, Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0))
    monitor.move(still)
    for halves in (np.zeros(2), wide):
        halves.flags.writeable = False
        # Each kind of sensor under a name of its own: a second scan of one stamp would be left out.
        monitor.look(f"{halves[0]}", RangeScan(0, two, one, halves, np.zeros(2), one, 0.1, 4.0))
    monitor.give(0.0, still.twist)
    monitor.judge(Twist2D(0.5, 0.0, 0.1), 0.0, 0.0)
    comes = Surroundings(np.zeros((0, 4)), 0.0, NO_POINTS, np.array([(1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0)]), True)
    monitor.ignores_unseen = True
    monitor._flees((0.5, 0.1, 0.0), comes)
