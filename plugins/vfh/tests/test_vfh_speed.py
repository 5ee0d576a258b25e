"""Speed as ratios within one run."""

import math
import timeit

import numpy as np
import pytest
from navloom import AvoiderInput, Context, Point2D, Pose2D, PoseEstimate, RangeScan, RobotSpec, Twist2D
from navloom_improved_vfh.adapter import ImprovedVfh
from navloom_vfh.adapter import Vfh, VfhPlus, VfhStar
from navloom_vfh.histogram import polar_histogram

SENSORS = pytest.mark.parametrize(("beams", "half_angle"), [(8, 0.26), (181, 0.0)], ids=["sonars", "laser"])
PERIOD = 0.05


def numpy_histogram(cells, radius, reach, sectors):
    """VFH+'s primary histogram in numpy, for comparison and as an oracle."""
    distance, bearing = np.hypot(cells[:, 0], cells[:, 1]), np.arctan2(cells[:, 1], cells[:, 0])
    magnitude = np.where(distance < reach, (cells[:, 2] / 15.0) ** 2 * (1.0 - (distance / reach) ** 2), 0.0)
    gamma = np.arcsin(np.minimum(1.0, radius / distance))
    centres = (np.arange(sectors) + 0.5) * 2.0 * np.pi / sectors
    off = np.abs((centres[None, :] - bearing[:, None] + np.pi) % (2.0 * np.pi) - np.pi)
    return (magnitude[:, None] * (off <= gamma[:, None])).sum(axis=0)


def scene():
    rng = np.random.default_rng(5)
    turn, distance = rng.uniform(-np.pi, np.pi, 60), rng.uniform(0.5, 1.6, 60)
    return np.column_stack((distance * np.cos(turn), distance * np.sin(turn), rng.integers(1, 16, 60)))


def histogram(cells, density):
    polar_histogram(cells, (0.0, 0.0), 0.0, 0.47, 1.3, math.inf, True, density)


def test_histogram_agrees_with_numpy():
    density = np.zeros(72)
    histogram(scene(), density)
    np.testing.assert_allclose(density, numpy_histogram(scene(), 0.47, 1.3, 72), atol=1e-12)


@pytest.mark.benchmark
def test_histogram_against_numpy(benchmark):
    cells, density = scene(), np.zeros(72)
    benchmark(histogram, cells, density)
    reference = min(timeit.repeat(lambda: numpy_histogram(cells, 0.47, 1.3, 72), number=50, repeat=5)) / 50
    assert reference > 4.0 * benchmark.stats.stats.min


def ticks(avoider_class, beams, half_angle):
    """A function that makes 100 ticks of an avoider in a slow turn among echoes at 1.0 to 1.4 m."""
    square = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
    robot = RobotSpec(square, 1.2, 0.05, 0.3, 0.5, math.radians(25.0), 0.5, 1.0)
    context = Context("main", PERIOD, robot, lambda name: np.random.default_rng(0), Pose2D(0.0, 0.0, 0.0))
    avoider_class.warm_up()
    avoider = avoider_class(avoider_class.Params(), context)
    bearings = np.linspace(-1.6, 1.6, beams)
    origins, halves = np.zeros((beams, 2)), np.full(beams, half_angle)
    given = []
    for k in range(100):
        ranges = 1.2 + 0.2 * np.sin(5.0 * bearings + 0.1 * k)
        scan = RangeScan(0, origins, bearings, halves, np.zeros(beams), ranges, 0.3, 4.0)
        estimate = PoseEstimate(0, Pose2D(0.005 * k, 0.0, 0.01 * k), Twist2D(0.1, 0.0, 0.2), np.zeros((3, 3)))
        given.append(AvoiderInput(0, (scan,), estimate, Point2D(5.0, 0.0), 0.5, Twist2D(0.3, 0.0, 0.0), 1.0))
    return lambda: [avoider.avoid(avoider_input) for avoider_input in given]


@pytest.mark.benchmark
@SENSORS
@pytest.mark.parametrize(
    ("method", "most"), [(Vfh, 2.0), (VfhPlus, 2.0), (VfhStar, 4.0)], ids=["vfh", "vfh_plus", "vfh_star"]
)
def test_a_tick_takes_less_than_so_many_of_the_improved_vfh(benchmark, method, most, beams, half_angle):
    """Whatever the scan: the tree of VFH* is bounded."""
    benchmark(ticks(method, beams, half_angle))
    other = min(timeit.repeat(ticks(ImprovedVfh, beams, half_angle), number=1, repeat=10))
    benchmark.extra_info["over_improved_vfh"] = benchmark.stats.stats.min / other
    assert benchmark.stats.stats.min < most * other
