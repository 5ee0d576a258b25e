"""`scan_odometry` among bodies that move: their scans do not move the estimate."""

import math

import numpy as np
import pytest
from navloom import Context, LocalizerInput, Odometry, Pose2D, RangeScan, RobotSpec, Twist2D
from navloom_scan_localizer.params import ScanOdometryParams
from navloom_scan_localizer.scan_odometry.adapter import ScanOdometry
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
    """A robot that drives at a speed, m/s, for 20 s, among 6 bodies that go to and fro in a field.

    Args:
        seed: Of the bodies, the wheels' slip and the noise of the ranges, sigma 0.03 m.
        speed: m/s; it drives in curves. wall: Place of a wall along the x axis, m; None if there is none.

    Attributes:
        said: The last estimate. errors: (2,) m, of the estimate and of the wheels, at the end.
    """

    def __init__(self, seed, speed, wall=None):
        rng = np.random.default_rng(seed)
        true, wheels, start = np.zeros(3), np.zeros(3), Pose2D(0.0, 0.0, 0.0)
        localizer = ScanOdometry(ScanOdometryParams(), Context("main", PERIOD, ROBOT, np.random.default_rng, start))
        middle, turned = rng.uniform((-6.0, -4.0), (10.0, 4.0), (6, 2)), rng.uniform(0.0, math.tau, 6)
        ways, pace = np.column_stack((np.cos(turned), np.sin(turned))), rng.uniform(0.5, 2.0, 6)
        none, origins = np.zeros(len(BEARINGS)), np.zeros((len(BEARINGS), 2))
        for tick in range(400):
            turn = 0.4 * math.cos(0.8 * PERIOD * tick) * bool(speed)
            step = PERIOD * np.array([speed, 0.0, turn])
            left, right = SLIP * math.sqrt(speed * PERIOD) * rng.standard_normal(2)
            true = compose(true, step)
            wheels = compose(wheels, step + [0.5 * (left + right), 0.0, 0.5 * (right - left) / HALF_TRACK])
            discs = middle + ways * (3.0 - abs((pace * PERIOD * tick) % 12.0 - 6.0))[:, None]
            # The field repeats itself each 16 m, so that there are bodies ahead as long as it drives.
            discs[:, 0] += 16.0 * np.round((true[0] + 2.0 - discs[:, 0]) / 16.0)
            if wall is not None:
                discs[:, 1] = np.minimum(discs[:, 1], wall - RADIUS - 0.1)
            ranges = np.maximum(0.0, ranges_to(true, discs, wall) + 0.03 * rng.standard_normal(len(BEARINGS)))
            stamp = round(1e9 * PERIOD * (tick + 1))
            scan = RangeScan(stamp, origins, BEARINGS, none, none, ranges, 0.05, 10.0)
            seen = Odometry(stamp, Pose2D(*wheels.tolist()), Twist2D(speed, 0.0, turn))
            self.said = localizer.localize(LocalizerInput(seen, (scan,), None))
        pose = np.array([self.said.pose.x, self.said.pose.y, self.said.pose.heading])
        self.errors = np.array([math.hypot(*relative(true, found)[:2]) for found in (pose, wheels)])


def root_mean_square(drives):
    """(2,) error of the estimate and of the wheels, m."""
    return np.sqrt(np.mean([drive.errors**2 for drive in drives], axis=0))


def test_bodies_do_not_move_a_robot_that_stands():
    """The wheels do not turn; 1 cm is a third of the noise of a range. It was up to 10 m, or `lost`."""
    drives = [Drive(seed, 0.0) for seed in range(4)]
    assert max(drive.errors[0] for drive in drives) < 0.01
    assert {drive.said.state for drive in drives} == {"tracking"}


@pytest.mark.parametrize("speed", [1.0, 2.0])
def test_in_a_field_where_everything_moves_the_pose_is_that_of_the_wheels(speed):
    drives = [Drive(seed, speed) for seed in range(4)]
    for drive in drives:
        assert drive.errors[0] == pytest.approx(drive.errors[1], abs=0.05)
        # Honest: within three standard deviations.
        spread = drive.said.covariance
        assert drive.errors[0] < 3.0 * math.sqrt(spread[0, 0] + spread[1, 1])


@pytest.mark.parametrize("speed", [1.0, 2.0])
def test_a_wall_among_moving_bodies_is_matched(speed):
    """It shows the heading, not the way along it: less than two thirds of the error of the wheels."""
    found, by_wheels = root_mean_square([Drive(seed, speed, wall=4.0) for seed in range(6)])
    assert found < 0.67 * by_wheels
