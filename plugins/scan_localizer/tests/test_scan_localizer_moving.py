"""`scan_odometry` among bodies that move: their scans do not move the estimate."""

import math

import numpy as np
import pytest
from navloom import Context, LocalizerInput, Odometry, Pose2D, RangeScan, RobotSpec, Twist2D
from navloom_scan_localizer.adapter import ScanOdometry
from navloom_scan_localizer.params import ScanOdometryParams
from navloom_scans.poses import compose, relative
from scan_localizer_rooms import fan

ROBOT = RobotSpec(np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]), 0.6, 0.05, 0.2, 0.5, 1.0, 0.5, 1.0)
BEARINGS, PERIOD, HALF_TRACK, SLIP, RADIUS = fan(361), 0.05, 0.19, 0.01, 0.5
"""Bearings of the laser, rad; tick, s; of the robot, m; spread of a wheel's way after 1 m, m; of a body, m."""


def ranges_to(pose, discs, wall):
    """Ranges, (361,) m, from a pose, (3,), to discs, (k, 2) m, and to a wall along y = `wall` m, if there is one."""
    ways = np.column_stack((np.cos(pose[2] + BEARINGS), np.sin(pose[2] + BEARINGS)))
    away = discs - pose[:2]
    along, across = ways @ away.T, ways[:, :1] * away[:, 1] - ways[:, 1:] * away[:, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        near = np.where((along > 0.0) & (abs(across) < RADIUS), along - np.sqrt(RADIUS**2 - across**2), np.inf)
        to_wall = np.inf if wall is None else (wall - pose[1]) / ways[:, 1]
    near[near < 0.2] = np.inf  # it drives through bodies
    return np.minimum(near.min(axis=1), np.where(to_wall > 0.0, to_wall, np.inf))


class Drive:
    """A robot that drives at a speed, m/s, for 20 s, among 6 discs that go to and fro in a field.

    Attributes:
        errors: (n, 2) error of the estimate and of the wheels, m. headings: The same of the heading, rad.
        said: The last estimate. off: (3,) its error, x, y, m, heading, rad, base frame.
    """

    def __init__(self, seed, speed, wall=None, speeds=(0.5, 2.0)):
        rng = np.random.default_rng(seed)
        true, wheels, errors, headings = np.zeros(3), np.zeros(3), [], []
        localizer = ScanOdometry(ScanOdometryParams(), Context("main", PERIOD, ROBOT, np.random.default_rng, Pose2D(0.0, 0.0, 0.0)))
        middle, turned = rng.uniform((-6.0, -4.0), (10.0, 4.0), (6, 2)), rng.uniform(0.0, math.tau, 6)
        ways, pace = np.column_stack((np.cos(turned), np.sin(turned))), rng.uniform(*speeds, 6)
        for tick in range(400):
            step = np.array([speed * PERIOD, 0.0, 0.4 * PERIOD * math.cos(0.8 * PERIOD * tick) * bool(speed)])
            true = compose(true, step)
            left, right = SLIP * math.sqrt(speed * PERIOD) * rng.standard_normal(2)
            wheels = compose(wheels, step + [0.5 * (left + right), 0.0, 0.5 * (right - left) / HALF_TRACK])
            discs = middle + ways * (3.0 - abs((pace * PERIOD * tick) % 12.0 - 6.0))[:, None]
            # The field repeats itself each 16 m, so that there are bodies ahead as long as it drives.
            discs[:, 0] += 16.0 * np.round((true[0] + 2.0 - discs[:, 0]) / 16.0)
            if wall is not None:
                discs[:, 1] = np.minimum(discs[:, 1], wall - RADIUS - 0.1)
            ranges = np.maximum(0.0, ranges_to(true, discs, wall) + 0.03 * rng.standard_normal(len(BEARINGS)))
            none, stamp = np.zeros(len(BEARINGS)), round(1e9 * PERIOD * (tick + 1))
            scan = RangeScan(stamp, np.zeros((len(BEARINGS), 2)), BEARINGS, none, none, ranges, 0.05, 10.0)
            twist = Twist2D(speed, 0.0, step[2] / PERIOD)
            self.said = localizer.localize(LocalizerInput(Odometry(stamp, Pose2D(*wheels.tolist()), twist), (scan,), None))
            pose = np.array([self.said.pose.x, self.said.pose.y, self.said.pose.heading])
            self.off = relative(true, pose)
            errors.append([math.hypot(*relative(true, one)[:2]) for one in (pose, wheels)])
            headings.append([abs(relative(true, one)[2]) for one in (pose, wheels)])
        self.errors, self.headings = np.array(errors), np.array(headings)
