"""Speed as ratios within one run."""

import math
import timeit

import numpy as np
import pytest
from navloom import (
    Context,
    ControllerInput,
    Point2D,
    Pose2D,
    PoseEstimate,
    Reference,
    RobotSpec,
    Trajectory,
    Twist2D,
)
from navloom_lyapunov_tracker.adapter import LyapunovTracker
from navloom_trackers.adapter import FierroLewis, Graceful, Kanayama, PurePursuit, Ramsete, RegulatedPurePursuit

TRACKERS = (FierroLewis, Graceful, Kanayama, PurePursuit, Ramsete, RegulatedPurePursuit)


def tick(cls):
    """A function that makes one tick on a trajectory of 100 m."""
    square = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
    robot = RobotSpec(square, 1.2, 0.05, 0.3, 0.5, math.radians(25.0), 0.5, 1.0)
    context = Context("main", 0.05, robot, lambda name: np.random.default_rng(0), Pose2D(0.0, 0.0, 0.0))
    s = np.linspace(0.0, 100.0, 5001)
    samples = np.column_stack((s, s, 0.0 * s, 0.0 * s, 0.0 * s, 0.0 * s + 0.3))
    reference = Reference(1, 50.0, 50.0, Pose2D(50.0, 0.0, 0.0), 0.3, 0.1, 0.05, Point2D(51.0, 0.0),
                          np.array([[50.0, 0.0], [51.0, 0.0]]), 0.4)  # fmt: skip
    estimate = PoseEstimate(0, Pose2D(50.0, 0.05, 0.1), Twist2D(0.3, 0.0, 0.1), np.zeros((3, 3)))
    tracker, given = cls(cls.Params(), context), ControllerInput(0, Trajectory(1, samples), reference, estimate)
    return lambda: tracker.control(given)


@pytest.mark.benchmark
@pytest.mark.parametrize("cls", TRACKERS, ids=lambda cls: cls.name)
def test_a_tick_takes_less_than_ten_of_the_lyapunov_tracker(benchmark, cls):
    benchmark(tick(cls))
    other = min(timeit.repeat(tick(LyapunovTracker), number=1000, repeat=10)) / 1000
    benchmark.extra_info["over_lyapunov_tracker"] = benchmark.stats.stats.min / other
    assert benchmark.stats.stats.min < 10.0 * other
