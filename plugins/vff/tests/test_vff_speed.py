"""Speed as ratios within one run."""

import math
import timeit

import numpy as np
import pytest
from navloom import AvoiderInput, Context, Point2D, Pose2D, PoseEstimate, RangeScan, RobotSpec, Twist2D
from navloom_improved_vfh.adapter import ImprovedVfh
from navloom_vff.adapter import Vff
from navloom_vff.forces import repulsive_force


def numpy_repulsive_force(cells, radius, constant, least, sectors):
    """The same forces in numpy, for comparison and as an oracle."""
    distance = np.hypot(cells[:, 0], cells[:, 1])
    force = constant * cells[:, 2] / np.maximum(distance - radius, least) ** 2
    push = -(force / distance) @ cells[:, :2]
    sector = np.floor(np.arctan2(cells[:, 1], cells[:, 0]) * sectors / (2.0 * np.pi)).astype(int) % sectors
    return push, np.bincount(sector, force, sectors)


def scene():
    rng = np.random.default_rng(5)
    turn, distance = rng.uniform(-np.pi, np.pi, 60), rng.uniform(0.5, 1.6, 60)
    return np.column_stack((distance * np.cos(turn), distance * np.sin(turn), rng.integers(1, 16, 60)))


def test_forces_agree_with_numpy():
    histogram = np.zeros(72)
    push = repulsive_force(scene(), 0.47, 0.004, 0.1, np.inf, 0.0, histogram)
    wanted, by_direction = numpy_repulsive_force(scene(), 0.47, 0.004, 0.1, 72)
    np.testing.assert_allclose(push, wanted, rtol=1e-12)
    np.testing.assert_allclose(histogram, by_direction, rtol=1e-12)


@pytest.mark.benchmark
def test_forces_against_numpy(benchmark):
    cells, histogram = scene(), np.zeros(72)
    benchmark(repulsive_force, cells, 0.47, 0.004, 0.1, np.inf, 0.0, histogram)
    reference = min(timeit.repeat(lambda: numpy_repulsive_force(cells, 0.47, 0.004, 0.1, 72), number=50, repeat=5)) / 50
    assert reference > 4.0 * benchmark.stats.stats.min


def ticks(avoider_class, beams, half_angle):
    """A function that makes 100 ticks of an avoider in a slow turn among echoes at 1.0 to 1.4 m."""
    square = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
    robot = RobotSpec(square, 1.2, 0.05, 0.3, 0.5, math.radians(25.0), 0.5, 1.0)
    context = Context("main", 0.05, robot, lambda name: np.random.default_rng(0), Pose2D(0.0, 0.0, 0.0))
    avoider_class.warm_up()
    avoider = avoider_class(avoider_class.Params(), context)
    bearings = np.linspace(-1.6, 1.6, beams)
    origins, halves = np.zeros((beams, 2)), np.full(beams, half_angle)
    given = []
    for k in range(100):
        ranges = 1.2 + 0.2 * np.sin(5.0 * bearings + 0.1 * k)
        scan = RangeScan(0, origins, bearings, halves, np.zeros(beams), ranges, 0.3, 4.0)
        pose = Pose2D(0.005 * k, 0.0, 0.01 * k)
        estimate = PoseEstimate(0, pose, Twist2D(0.1, 0.0, 0.2), np.zeros((3, 3)))
        given.append(AvoiderInput(0, (scan,), estimate, Point2D(5.0, 0.0), 0.5, Twist2D(0.3, 0.0, 0.0), 1.0))
    return lambda: [avoider.avoid(avoider_input) for avoider_input in given]


@pytest.mark.benchmark
@pytest.mark.parametrize(("beams", "half_angle"), [(8, 0.26), (181, 0.0)], ids=["sonars", "laser"])
def test_a_tick_takes_no_longer_than_one_of_the_improved_vfh(benchmark, beams, half_angle):
    benchmark(ticks(Vff, beams, half_angle))
    other = min(timeit.repeat(ticks(ImprovedVfh, beams, half_angle), number=1, repeat=10))
    benchmark.extra_info["improved_vfh_over_vff"] = other / benchmark.stats.stats.min
    assert other > benchmark.stats.stats.min
