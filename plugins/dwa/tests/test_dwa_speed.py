"""Speed as ratios within one run."""

import math
import time

import numpy as np
import pytest
from navloom import AvoiderInput, Context, Point2D, Pose2D, PoseEstimate, RangeScan, RobotSpec, Twist2D
from navloom_avoidance.clearance import footprint_edges, outside_distance
from navloom_dwa.adapter import Dwa
from navloom_dwa.contact import enlarged_corners, first_contacts

FOOTPRINT = np.array([[0.21, 0.165], [-0.21, 0.165], [-0.21, -0.165], [0.21, -0.165]])
TICK = 0.05


def scans(beams):
    """100 ticks of a Jackal that drives among posts, with a laser of 270 degrees."""
    bearings, rng = np.linspace(-0.75 * math.pi, 0.75 * math.pi, beams), np.random.default_rng(1)
    posts = rng.uniform(-5.0, 5.0, (60, 2))
    posts = posts[np.hypot(posts[:, 0], posts[:, 1]) > 0.7]
    given = []
    for k in range(100):
        x, heading = 0.02 * k, 0.01 * k
        ranges = np.full(beams, np.inf)
        for px, py in posts:
            distance = math.hypot(px - x, py)
            off = (bearings - math.atan2(py, px - x) + heading + math.pi) % (2.0 * math.pi) - math.pi
            hit = np.abs(off) < math.asin(min(1.0, 0.1 / distance))
            ranges[hit] = np.minimum(ranges[hit], max(0.05, distance - 0.1))
        scan = RangeScan(0, np.zeros((beams, 2)), bearings, np.zeros(beams), np.zeros(beams), ranges, 0.05, 30.0)
        estimate = PoseEstimate(0, Pose2D(x, 0.0, heading), Twist2D(1.0, 0.0, 0.2), np.zeros((3, 3)))
        stamp = round(k * TICK * 1e9)
        given.append(AvoiderInput(stamp, (scan,), estimate, Point2D(8.0, 0.0), 0.2, Twist2D(1.0, 0.0, 0.0), 0.0))
    return given


@pytest.mark.benchmark
def test_four_times_the_beams_cost_less_than_half_as_much_again(benchmark):
    """Measured in CPU time and in turns, as the machine may be shared."""
    Dwa.warm_up()
    robot = RobotSpec(FOOTPRINT, 0.5, 0.098, 0.19, 2.0, 2.0, 2.0, 3.0)
    context = Context("main", TICK, robot, lambda name: np.random.default_rng(0), Pose2D(0.0, 0.0, 0.0))
    avoider = Dwa(Dwa.Params(), context)
    drives = {beams: scans(beams) for beams in (181, 720)}
    benchmark(lambda: [avoider.avoid(one) for one in drives[720]])
    least = dict.fromkeys(drives, math.inf)
    for _ in range(10):
        for beams, given in drives.items():
            avoider.reset()
            begin = time.process_time()
            for one in given:
                avoider.avoid(one)
            least[beams] = min(least[beams], (time.process_time() - begin) / len(given))
    benchmark.extra_info |= {f"cpu_us_at_{beams}_beams": 1e6 * spent for beams, spent in least.items()}
    assert least[720] < 1.5 * least[181]


@pytest.mark.benchmark
def test_rejecting_by_annulus_and_distance_is_faster_than_asking_every_point(benchmark):
    edges, radius = footprint_edges(FOOTPRINT), float(np.hypot(*FOOTPRINT[0]))
    rng = np.random.default_rng(5)
    angle, distance = rng.uniform(-math.pi, math.pi, 300), rng.uniform(0.5, 4.0, 300)
    points = np.column_stack((distance * np.cos(angle), distance * np.sin(angle), np.full(300, 0.05)))
    gaps = np.array([outside_distance(edges, x, y) for x, y, _ in points])
    points, gaps = points[np.argsort(gaps)], np.sort(gaps)
    arcs = np.array([[math.cos(a), math.sin(a) / radius, 0.0, 1.0] for a in np.linspace(-1.57, 1.57, 41)])
    times = np.zeros(41)
    benchmark(first_contacts, points, gaps, enlarged_corners(edges, 0.05), edges, radius, False, 0.05, arcs, 4.0, times)
    begin = time.process_time()
    for _ in range(20):  # a margin too great by 9 m lets every point through both rejections
        first_contacts(points, gaps, enlarged_corners(edges, 9.0), edges, radius, False, 9.0, arcs, 4.0, times)
    every = (time.process_time() - begin) / 20
    assert every > 2.0 * benchmark.stats.stats.min
