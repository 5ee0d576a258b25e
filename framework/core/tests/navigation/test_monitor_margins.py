"""The gate's monitor keeps what a sensor cannot see between two beams, or no longer sees, from long bodies."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom.messages import Odometry, Pose2D, RangeScan, Twist2D
from navloom.navigation.collision_monitor import CollisionMonitor, MonitorLimits, Verdict
from navloom.navigation.monitor_rollout import distance_to_outline, margins
from navloom.testing import robot

LONG = np.array([(1.1, 0.3), (-0.3, 0.3), (-0.3, -0.3), (1.1, -0.3)])
TAIL = np.array([(0.3, 0.3), (-1.1, 0.3), (-1.1, -0.3), (0.3, -0.3)])
TICK = 50_000_000


class Robot:
    """A robot whose pose is set, with a laser of 270°; points are seen by the nearest beam."""

    def __init__(self, outline: np.ndarray, points: np.ndarray, spacing_deg: float = 1.0, sigma: float = 0.005) -> None:
        limits = MonitorLimits(
            robot(footprint=outline, max_deceleration=0.5, max_angular_acceleration=1.0, motor_lag=0.1, dead_time=0.05),
            0.05,
            sigma,
        )
        self.monitor, self.points = CollisionMonitor(limits), points
        self.bearings = np.radians(np.arange(-135.0, 135.0 + 0.5 * spacing_deg, spacing_deg))
        self.stamp = 0
        self.pose = np.zeros(3)

    def rest(self, twist: tuple[float, float] = (0.0, 0.0), ticks: int = 3) -> None:
        """Take some scans at the pose, with a measured velocity."""
        for _ in range(ticks):
            self.stamp += TICK
            self.monitor.move(Odometry(self.stamp, Pose2D(*self.pose), Twist2D(twist[0], 0.0, twist[1])))
            dx, dy = self.points[:, 0] - self.pose[0], self.points[:, 1] - self.pose[1]
            bearing = np.arctan2(dy, dx) - self.pose[2]
            rows = np.round((bearing - self.bearings[0]) / (self.bearings[1] - self.bearings[0])).astype(int)
            inside = (rows >= 0) & (rows < len(self.bearings))
            ranges = np.full(len(self.bearings), math.inf)
            np.minimum.at(ranges, rows[inside], np.hypot(dx, dy)[inside])
            none = np.zeros(len(ranges))
            self.monitor.look(
                "l", RangeScan(self.stamp, np.zeros((len(none), 2)), self.bearings, none, none, ranges, 0, 9.0)
            )

    def go(self, x: float, turn: float = 0.0) -> None:
        """Drive straight to x, m, then turn on the spot, rad, in steps of 1 cm and 0.01 rad."""
        while self.pose[0] < x - 1e-9:
            self.pose[0] += 0.01
            self.rest(ticks=1)
        for _ in range(round(abs(turn) / 0.01)):
            self.pose[2] += math.copysign(0.01, turn)
            self.rest(ticks=1)

    def judge(self, v: float, w: float = 0.0) -> Verdict:
        self.monitor.ignores_unseen = True
        return self.monitor.judge(Twist2D(v, 0.0, w), 0.0, self.stamp * 1e-9)


def test_a_margin_covers_the_gap_between_beams_or_the_speed_of_the_body_beside_the_point() -> None:
    """The tip at (-1.1, 0.3) moves with hypot(0.06, 0.22) m/s at 0.2 rad/s; 0.1 s of it, and 1 cm."""
    points = np.array([(-1.1, 0.3, 0.0), (-1.1, 0.3, 0.024), (-1.1, 0.3, 0.04), (1.0, 0.0, 0.0)])
    tip = 0.01 + 0.1 * math.hypot(0.06, 0.22)
    assert margins(points, 0.0, -0.2, 0.0, 0.01) == pytest.approx([tip, tip, math.hypot(0.01, 0.04), 0.03])
    assert margins(points, 0.0, 0.0, 0.0, 0.01) == pytest.approx([0.01, 0.026, math.hypot(0.01, 0.04), 0.01])
    assert margins(points, 0.5, 0.0, 0.0, 0.01) == pytest.approx([0.04, 0.04, math.hypot(0.01, 0.04), 0.04]), (
        "3 cm at most"
    )


def test_the_speed_beside_a_point_is_that_of_driving_and_turning() -> None:
    """At (0.7, -0.5), 0.1 m/s and 0.2 rad/s move the body by (0.1 + 0.1, 0.14) m/s; with -0.2 rad/s by (0, -0.14)."""
    point = np.array([(0.7, -0.5, 0.0)])
    assert margins(point, 0.1, 0.2, 0.0, 0.02) == pytest.approx([0.02 + 0.1 * math.hypot(0.2, 0.14)])
    assert margins(point, 0.1, -0.2, 0.0, 0.02) == pytest.approx([0.02 + 0.014])
    assert margins(point, -0.1, -0.2, 0.0, 0.02) == pytest.approx([0.02 + 0.1 * math.hypot(0.2, 0.14)])


@pytest.mark.parametrize("v", [0.05, 0.3])
def test_a_robot_2_cm_beside_a_wall_drives_along_it(v: float) -> None:
    """Beams of 1 degree: beside the front corner, 0.35 m away, 0.9 cm may lie beyond an echo, and 1 cm is its error."""
    wall = np.stack([np.arange(-1.0, 3.0, 0.002), np.full(2000, 0.27)], axis=1)
    robot = Robot(np.array([(0.25, 0.25), (-0.25, 0.25), (-0.25, -0.25), (0.25, -0.25)]), wall)
    robot.rest()
    for _ in range(30):
        assert robot.judge(v).twist.vx >= 0.04
        robot.go(robot.pose[0] + 0.01)


def test_a_better_laser_has_no_smaller_margin() -> None:
    """A wall that ends 2 cm beside the body, 1 m ahead of its front: at 0.5 m/s the margin is 4 cm."""
    wall = np.stack([np.full(60, 1.15), np.linspace(0.32, 0.9, 60)], axis=1)
    for sigma in (0.03, 0.005):
        robot = Robot(LONG, wall, spacing_deg=0.25, sigma=sigma)
        robot.rest()
        assert robot.judge(0.5).kind == "obstacle"


def test_the_edge_of_a_post_may_be_hidden_between_two_beams() -> None:
    """A post 2.2 cm beside the way and 1.2 m ahead: beams of 1° are 2.1 cm apart there, beams of 0.25° 0.5 cm."""
    post = np.array([(1.135, 0.322), (1.135, 0.3222)])
    wide, dense = (Robot(LONG, post, spacing_deg=spacing) for spacing in (1.0, 0.25))
    for driven in (wide, dense):
        driven.rest()
    assert wide.judge(0.05).kind == "obstacle"
    assert dense.judge(0.05).share == 1.0


def test_a_stopped_robot_does_not_creep_by_the_noise_of_its_odometry() -> None:
    """A wall within the margin: measured motion away from it must not make room for a command towards it."""
    wall = np.stack([np.full(200, 1.105), np.linspace(-1.0, 1.0, 200)], axis=1)
    robot = Robot(LONG, wall)
    robot.rest((-0.02, 0.0))
    assert robot.judge(0.01).is_stopped
    assert robot.judge(-0.05).share == 1.0


def test_the_margin_grows_for_an_echo_that_the_laser_no_longer_sees() -> None:
    """A post beside the tail: 5.5 cm per metre that the robot drove since no beam points at it, and per m to the post.

    The beam of 135° passes the post at x = 0.65 m, and its echoes are 0.5 s old half a metre later: then the post is
    0.45 m beside and 0.45 m behind the laser, and in the end, 0.55 m on, 1 m behind: 0.87 m away in between.
    """
    post = np.array([(0.2, 0.45), (0.2, 0.452)])
    robot = Robot(TAIL, post, spacing_deg=0.25)
    robot.rest()
    robot.go(1.2)
    gap = distance_to_outline(0.2 - 1.2, 0.45, TAIL)
    held = robot.monitor._near(Twist2D(0.0, 0.0, 0.0), 0.0)
    assert gap == pytest.approx(0.15)
    assert held[:, :2] == pytest.approx(np.array([[-1.0, 0.45]]), abs=0.01)
    assert held[0, 2] == pytest.approx(0.055 * 0.55 * 0.87, abs=0.008)


def unseen(distance: float, *motions: tuple[float, float]) -> float:
    """How far what lies ahead may reach beyond its echo after a robot drove, m, or turned, rad, without seeing it."""
    limits = MonitorLimits(robot(footprint=TAIL, max_deceleration=0.5), 0.05, 0.005)
    monitor, bearings, two = CollisionMonitor(limits), np.array([0.0, 0.005]), np.zeros(2)
    x, heading, stamp = 0.0, 0.0, 0
    for k, (way, turn) in enumerate(((0.0, 0.0), *motions)):
        x, heading, stamp = x + way, heading + turn, 800_000_000 * k
        monitor.move(Odometry(stamp, Pose2D(0.0, x, heading), Twist2D(0.0, 0.0, 0.0)))
        looked, ranges = (bearings, distance) if k == 0 else (bearings + math.pi, math.inf)
        monitor.look("l", RangeScan(stamp, np.zeros((2, 2)), looked, two, two, np.full(2, ranges), 0.05, 9.0))
    return float(monitor._near(Twist2D(0.0, 0.0, 0.0), 0.0)[-1, 2])


def test_what_is_unseen_is_misplaced_by_the_heading_error_of_the_way_since() -> None:
    """0.3 rad since the last scan with an echo that counts: as 0.15 m of way. 1.5 of 1257 directions lie beyond."""
    beyond = 1.5 * math.tau / 1257 * 0.8
    still = unseen(0.8, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
    assert still == pytest.approx(beyond, abs=1e-6)
    turned = unseen(0.8, (0.0, 0.0), (0.0, 0.0), (0.0, 0.3))
    assert turned == pytest.approx(beyond + 0.055 * 0.15 * 0.8, abs=1e-6)
    assert unseen(0.8, (0.0, 0.0), (0.0, 0.0), (0.0, -0.3)) == pytest.approx(turned)
    driven = unseen(0.8, (0.0, 0.0), (0.0, 0.0), (0.4, 0.0))
    assert driven == pytest.approx(beyond + 0.055 * 0.4 * math.hypot(0.8, 0.4), abs=1e-4)
    assert unseen(0.8, *[(0.0, 0.0)] * 2, *[(0.0, 1.0), (0.0, -1.0)] * 4) == 0.08, "8 cm at most"
