"""The gate's monitor: the robot stops before what its sensors see, whatever the command."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from limits import with_robot
from navloom.geometry.footprints import rectangle
from navloom.messages import Odometry, Pose2D, RangeScan, Twist2D
from navloom.navigation.collision_monitor import CollisionMonitor, MonitorLimits, Verdict
from navloom.navigation.monitor_rollout import distance_to_outline
from navloom.testing import robot

PERIOD = 0.05
LIMITS = MonitorLimits(robot(0.6, 0.4), PERIOD, 0.03)
SLOW_MOTORS = with_robot(LIMITS, motor_lag=0.2, dead_time=0.1)
BEARINGS = np.radians(np.arange(-135.0, 135.5, 1.0))


@dataclass
class Drive:
    """A robot with motor lag and dead time among points that a laser sees.

    Attributes:
        obstacles: (n, 2) m, map frame; dense enough that a laser of 1° sees a wall.
        sees: Whether scans are taken.
        every: Ticks between two scans.
    """

    limits: MonitorLimits
    obstacles: np.ndarray
    lag: float = 0.0
    dead_time: float = 0.0
    sigma: float = 0.0
    every: int = 1
    until: int = 10**9
    pose: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    twist: list[float] = field(default_factory=lambda: [0.0, 0.0])
    tick: int = 0
    speed: float = 0.0
    last: Verdict | None = None

    def __post_init__(self) -> None:
        self.monitor = CollisionMonitor(self.limits)
        self.noise = np.random.default_rng(5)
        self.given: deque[tuple[float, float]] = deque([(0.0, 0.0)] * (1 + round(self.dead_time / 0.005)))

    def step(self, vx: float, wz: float = 0.0) -> Verdict:
        """Run one tick: odometry, scan, verdict, and the wheels for a period."""
        stamp = round(self.tick * PERIOD * 1e9)
        x, y, heading = self.pose
        wrapped = math.remainder(heading, math.tau)
        self.monitor.move(Odometry(stamp, Pose2D(x, y, wrapped), Twist2D(self.twist[0], 0.0, self.twist[1])))
        if self.tick % self.every == 0 and self.tick <= self.until:
            self.monitor.look("laser", self.scan(stamp))
        step = 0.025 if abs(vx) > abs(self.speed) else 0.05
        wanted = min(max(vx, self.speed - step), self.speed + step)
        verdict = self.monitor.judge(Twist2D(wanted, 0.0, wz), self.speed, stamp * 1e-9)
        self.monitor.give(stamp * 1e-9, verdict.twist)
        self.speed, self.last = verdict.twist.vx, verdict
        for _ in range(10):
            self.given.append((verdict.twist.vx, verdict.twist.wz))
            while len(self.given) > 1 + round(self.dead_time / 0.005):
                self.given.popleft()
            blend = 1.0 - math.exp(-0.005 / self.lag) if self.lag else 1.0
            for k in range(2):
                self.twist[k] += blend * (self.given[0][k] - self.twist[k])
            self.pose[2] += 0.5 * self.twist[1] * 0.005
            self.pose[0] += self.twist[0] * 0.005 * math.cos(self.pose[2])
            self.pose[1] += self.twist[0] * 0.005 * math.sin(self.pose[2])
            self.pose[2] += 0.5 * self.twist[1] * 0.005
        self.tick += 1
        return verdict

    def scan(self, stamp: int) -> RangeScan:
        x, y, heading = self.pose
        dx, dy = self.obstacles[:, 0] - x, self.obstacles[:, 1] - y
        bearing = (np.arctan2(dy, dx) - heading + math.pi) % math.tau - math.pi
        rows = np.round((bearing - BEARINGS[0]) / math.radians(1.0)).astype(int)
        ranges = np.full(len(BEARINGS), math.inf)
        inside = (rows >= 0) & (rows < len(ranges))
        np.minimum.at(ranges, rows[inside], np.hypot(dx, dy)[inside])
        noisy = np.maximum(ranges + self.sigma * self.noise.standard_normal(len(ranges)), 0.05)
        nothing = np.zeros(len(ranges))
        return RangeScan(stamp, np.zeros((len(ranges), 2)), BEARINGS, nothing, nothing, noisy, 0.05, 10.0)

    @property
    def gap(self) -> float:
        """Distance between the true footprint and the nearest obstacle, m; negative where they overlap."""
        x, y, heading = self.pose
        cos, sin = math.cos(heading), math.sin(heading)
        outline = rectangle(0.6, 0.4)
        return min(
            float(distance_to_outline(cos * dx + sin * dy, cos * dy - sin * dx, outline))
            for dx, dy in self.obstacles - np.array([x, y])
        )


def wall(x: float, angle: float = 0.0) -> np.ndarray:
    """Points 1 cm apart of a wall through (x, 0), turned by an angle, rad, from square to the x axis."""
    along = np.arange(-4.0, 4.0, 0.01)
    return np.stack([x - along * math.sin(angle), along * math.cos(angle)], axis=1)


def drive_on(drive: Drive, vx: float, wz: float = 0.0, seconds: float = 12.0) -> float:
    """Drive until the robot has been stopped for a second or the time is over; gives the smallest gap, m."""
    least, still = math.inf, 0
    for _ in range(round(seconds / PERIOD)):
        drive.step(vx, wz)
        least = min(least, drive.gap)
        still = still + 1 if max(map(abs, drive.twist)) < 1e-3 else 0
        if drive.tick > 40 and still >= 20:
            break
    return least


@pytest.mark.parametrize("angle", [0, 20, 40, 60, 80])
@pytest.mark.parametrize("motors", [LIMITS, SLOW_MOTORS], ids=["ideal", "slow"])
def test_it_stops_before_a_wall_at_any_angle(angle: int, motors: MonitorLimits) -> None:
    drive = Drive(motors, wall(3.0, math.radians(angle)), motors.robot.motor_lag, motors.robot.dead_time)
    assert 0.0 < drive_on(drive, 0.5) < 0.06
    assert drive.last is not None and drive.last.kind == "obstacle"


def test_it_accounts_for_the_lag_of_motors() -> None:
    """A roll-out without lag and dead time would brake too late."""
    drive = Drive(SLOW_MOTORS, wall(3.0), SLOW_MOTORS.robot.motor_lag, SLOW_MOTORS.robot.dead_time)
    assert drive_on(drive, 1.0) > 0.0


def test_it_checks_the_whole_footprint() -> None:
    """A post that only the outer 5 % of the footprint would touch."""
    post = np.array([[2.0, 0.19], [2.0, 0.195]])
    drive = Drive(LIMITS, post)
    assert 0.0 < drive_on(drive, 0.5) < 0.06


def test_it_moves_echoes_by_the_odometry() -> None:
    """After its first scans the sensor is silent; its echoes come nearer as the robot drives."""
    drive = Drive(LIMITS, wall(0.62), until=3)
    drive.monitor.ignores_unseen = True  # a silent sensor would stop the robot too
    assert drive_on(drive, 1.0) > 0.0
    assert drive.last is not None and drive.last.kind == "obstacle"


def test_a_command_with_a_free_way_passes_unchanged() -> None:
    drive = Drive(LIMITS, wall(20.0))
    for _ in range(100):
        assert drive.step(0.5).share == 1.0


def test_driving_away_from_what_is_too_near_is_free() -> None:
    drive = Drive(LIMITS, wall(0.302))
    drive.step(0.0)
    drive.step(0.0)
    assert drive.step(0.3).is_stopped
    assert drive.step(-0.05).share == 1.0


def test_a_gap_of_5_cm_a_side_is_passed_with_a_noisy_laser() -> None:
    sides = [np.stack([np.arange(1.5, 3.5, 0.01), np.full(200, y)], axis=1) for y in (-0.25, 0.25)]
    ends = [np.stack([np.full(200, 1.5), y * np.arange(0.25, 2.25, 0.01)], axis=1) for y in (-1.0, 1.0)]
    drive = Drive(replace(LIMITS, sigma=0.03), np.concatenate([*sides, *ends]), sigma=0.03)
    while drive.pose[0] < 4.0 and drive.tick < 800:
        drive.step(0.5)
    assert drive.pose[0] >= 4.0 and drive.tick * PERIOD < 20.0


def test_a_fast_robot_keeps_further_from_what_it_passes() -> None:
    """A post 2.5 cm beside the way: a robot at 0.05 m/s keeps its speed, one at 0.5 m/s or more slows down.

    The margin is 2 cm at 0.05 m/s, 1.5 gaps of 7 mm between beams at 0.4 m being more than 5 mm, and 4 cm at 0.5 m/s.
    """
    post = np.array([[1.0, 0.225], [1.0, 0.226]])
    slow, fast = Drive(LIMITS, post), Drive(LIMITS, post)
    assert min(slow.step(0.05).share for _ in range(600)) == 1.0
    passing = []
    while fast.pose[0] < 2.0:
        fast.step(0.5)
        if 0.7 < fast.pose[0] < 1.2:
            passing.append(fast.twist[0])
    assert min(passing) < 0.25


def test_an_echo_outside_the_field_of_view_counts_until_it_is_measured_again() -> None:
    """A post 0.5 m away on the left is straight behind after a turn by 115°, where no beam of the laser points."""
    drive = Drive(LIMITS, np.array([[0.21, 0.45], [0.21, 0.452]]))
    for _ in range(80):
        drive.step(0.0, -0.5)
    for _ in range(40):
        drive.step(0.0)
    assert not np.isfinite(drive.scan(0).ranges).any()
    drive.monitor.ignores_unseen = True
    assert drive_on(drive, -0.2) > 0.0
    assert drive.last is not None and drive.last.kind == "obstacle"


def test_it_backs_up_along_its_own_way_and_no_further() -> None:
    """No sensor looks back: the space it came through is known, that behind its start is not."""
    drive = Drive(LIMITS, wall(20.0))
    while drive.pose[0] < 1.0:
        drive.step(0.3)
    for _ in range(400):
        drive.step(-0.2)
    assert -0.3 < drive.pose[0] < 0.05
    assert drive.last is not None and drive.last.kind == "unseen"


def test_a_single_outlier_does_not_stop_the_robot() -> None:
    drive = Drive(LIMITS, wall(20.0))
    for _ in range(30):
        drive.step(0.5)
    scan = drive.scan
    drive.scan = lambda stamp: replace(scan(stamp), ranges=np.where(np.arange(271) == 135, 0.4, scan(stamp).ranges))  # type: ignore[method-assign]
    assert drive.step(0.5).share == 1.0
    assert drive.step(0.5).share < 1.0  # an outlier that repeats counts


def test_a_restarted_platform_elsewhere_does_not_count_as_in_unseen_space() -> None:
    """A restarted platform counts its odometry from 0, so the known space of before does not apply."""
    drive = Drive(LIMITS, wall(20.0))
    while drive.pose[0] < 2.0:
        drive.step(0.5)
    drive.pose, drive.twist, drive.speed = [-8.0, 3.0, 1.0], [0.0, 0.0], 0.0
    assert [drive.step(0.2, 0.3).kind for _ in range(5)] == [""] * 5


def test_odometry_that_turns_faster_than_a_robot_can_also_shows_a_restart() -> None:
    """Seen space lies in the odometry frame; with another heading, it would be on another side of the robot."""
    drive = Drive(LIMITS, wall(20.0))
    drive.step(0.0)
    drive.monitor.move(Odometry(round(PERIOD * 1e9), Pose2D(0.0, 0.0, math.pi / 2), Twist2D(0.0, 0.0, 0.0)))
    assert drive.monitor.judge(Twist2D(1.0, 0.0, 0.0), 1.0, PERIOD).kind == "unseen"


# --- a ring of sonars, blind behind and nearer than range_min ---------------------------------------------------------

SIDE, RANGE_MIN, RANGE_MAX = 0.8, 0.3, 4.0
SQUARE = MonitorLimits(robot(SIDE, SIDE), PERIOD, 0.03)
CORNERS = rectangle(SIDE, SIDE)
RING = np.radians([90.0, 50.0, 30.0, 10.0, -10.0, -30.0, -50.0, -90.0])
ORIGINS = np.array([(0.2, 0.4), (0.38, 0.4), (0.4, 0.25), (0.4, 0.08), (0.4, -0.08), (0.4, -0.25), (0.38, -0.4),
                    (0.2, -0.4)])  # fmt: skip
HALF = math.radians(15.0)
RAYS = np.linspace(-HALF, HALF, 31)


@dataclass
class SonarDrive(Drive):
    """A square robot with eight sonars on its front and sides, between walls along the x axis.

    Attributes:
        obstacles: (n,) y of the walls, m.
    """

    def scan(self, stamp: int) -> RangeScan:
        _, y, heading = self.pose
        heights = y + ORIGINS @ np.array([math.sin(heading), math.cos(heading)])
        sines = np.sin(heading + RING[:, None] + RAYS)
        ranges = np.full(8, math.inf)
        for wall_y in self.obstacles:
            with np.errstate(divide="ignore", over="ignore"):
                reach = (wall_y - heights[:, None]) / sines
            ranges = np.minimum(ranges, np.where(reach > 0.0, reach, math.inf).min(axis=1))
        ranges = np.where(ranges < RANGE_MAX, np.maximum(ranges, RANGE_MIN), math.inf)
        return RangeScan(stamp, ORIGINS, RING, np.full(8, HALF), np.zeros(8), ranges, RANGE_MIN, RANGE_MAX)

    @property
    def gap(self) -> float:
        _, y, heading = self.pose
        corners = y + CORNERS @ np.array([math.sin(heading), math.cos(heading)])
        return min(float((np.sign(wall_y) * (wall_y - corners)).min()) for wall_y in self.obstacles)


def least(drive: SonarDrive, vx: float, wz: float, seconds: float) -> float:
    """Smallest gap during a drive of some s, m."""
    gaps = []
    for _ in range(round(seconds / PERIOD)):
        drive.step(vx, wz)
        gaps.append(drive.gap)
    return min(gaps)


@pytest.mark.parametrize("side", [1, -1], ids=["left", "right"])
@pytest.mark.parametrize("gap", [0.03, 0.06, 0.1, 0.15])
def test_a_robot_near_a_wall_does_not_turn_its_corner_into_it(gap: float, side: int) -> None:
    drive = SonarDrive(SQUARE, np.array([side * 0.9]))
    least(drive, 0.3, side * 0.2, 1.5)  # towards the wall, at an angle
    while drive.gap > gap + 0.02 and drive.tick < 400:
        drive.step(0.2, -side * 0.5 if abs(drive.pose[2]) > 0.15 else 0.0)
    drive.pose[2] = 0.0  # along the wall, as after a drift that the odometry shows
    drive.pose[1] = side * (0.5 - gap)
    least(drive, 0.2, 0.0, 3.0)
    assert drive.gap == pytest.approx(gap, abs=0.03)
    for turn in (1.0, -1.0):
        assert least(drive, 0.0, turn, 3.0) > 0.0


def test_it_drives_along_walls_nearer_than_its_sonars_measure() -> None:
    drive = SonarDrive(SQUARE, np.array([0.5, -0.55]))
    least(drive, 0.4, 0.0, 10.0)
    assert drive.pose[0] > 3.0


def test_it_does_not_slide_into_a_wall_that_is_nearer_than_its_sonars_measure_and_backs_away_from_it() -> None:
    drive = SonarDrive(SQUARE, np.array([0.6]))
    assert least(drive, 0.3, 0.05, 8.0) > 0.0
    assert drive.gap < 0.1
    assert least(drive, -0.2, 0.0, 4.0) > 0.0
    assert drive.gap > 0.15


def test_it_turns_away_from_a_wall_that_it_drove_along() -> None:
    drive = SonarDrive(SQUARE, np.array([0.55]))
    least(drive, 0.3, 0.0, 4.0)
    assert least(drive, 0.3, -0.15, 6.0) > 0.0
    assert drive.gap > 0.3
