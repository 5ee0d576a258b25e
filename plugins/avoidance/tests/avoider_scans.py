"""Inputs for tests of avoiders: the paper's robot at a pose, with its ring of sonars or a laser."""

import math

import numpy as np
from navloom import AvoiderInput, Point2D, Pose2D, PoseEstimate, RangeScan, Twist2D
from navloom.testing import context, robot
from navloom.testing import make as make_plugin

SQUARE = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
BEARINGS = np.radians([90.0, 50.0, 30.0, 10.0, -10.0, -30.0, -50.0, -90.0])
LIMIT = math.radians(25.0)
FREE = [math.inf] * 8


def make(method, footprint=SQUARE, **params):
    """An avoider on the paper's robot: 0.8 x 0.8 m, 0.5 m/s, 25 deg/s."""
    return make_plugin(
        method,
        context(robot(footprint=footprint, height=1.2, half_track=0.3, max_angular=LIMIT), role="avoider"),
        **params,
    )


def sonars(ranges):
    """A scan of sonars with one range, m, for each of BEARINGS."""
    origins = 0.4 * np.column_stack((np.cos(BEARINGS), np.sin(BEARINGS)))
    return RangeScan(0, origins, BEARINGS, np.full(8, math.radians(15.0)), np.zeros(8), np.array(ranges), 0.3, 4.0)


def laser(ranges):
    """A laser scan with ranges, m, from 1.5 rad on the right to 1.5 rad on the left."""
    n = len(ranges)
    bearings = np.linspace(-1.5, 1.5, n)
    return RangeScan(0, np.zeros((n, 2)), bearings, np.zeros(n), np.zeros(n), np.array(ranges), 0.1, 80.0)


def given(*scans, x=0.0, heading=0.0, target=(5.0, 0.0), twist=(0.0, 0.0), time=0.0, remaining=1.0, share=1.0):
    """The robot at (x, 0) with a velocity; the controller wants 0.3 m/s straight ahead."""
    estimate = PoseEstimate(0, Pose2D(x, 0.0, heading), Twist2D(twist[0], 0.0, twist[1]), np.zeros((3, 3)))
    stamp_ns, wanted = round(time * 1e9), Twist2D(0.3, 0.0, 0.0)
    return AvoiderInput(stamp_ns, scans, estimate, Point2D(*target), 0.5, wanted, remaining, share)
