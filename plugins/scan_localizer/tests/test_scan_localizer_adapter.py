"""The localizer as a plugin."""

import math

import numpy as np
import pytest
from navloom import (
    Context,
    InputError,
    LocalizerInput,
    MapUpdate,
    OccupancyGrid,
    Odometry,
    Pose2D,
    RangeScan,
    RobotSpec,
    Twist2D,
)
from navloom_scan_localizer.adapter import ScanMatching
from navloom_scan_localizer.params import ScanMatchingParams
from navloom_scans.beams import beam_points
from navloom_scans.matching import fit_pose
from pydantic import ValidationError
from scan_localizer_rooms import fan, ranges_in, room

CELL = 0.1
SQUARE = np.array([[-0.25, -0.25], [0.25, -0.25], [0.25, 0.25], [-0.25, 0.25]])
ROBOT = RobotSpec(SQUARE, 0.6, 0.05, 0.2, 0.5, 1.0, 0.5, 1.0)
START = Pose2D(3.0, 2.5, 0.3)
BEARINGS = fan(181)
STILL = Twist2D(0.0, 0.0, 0.0)


def grid_of(occupied, free=0):
    return OccupancyGrid(np.where(occupied, 100, free).astype(np.int8), CELL, Pose2D(0.0, 0.0, 0.0))


ROOM = grid_of(room())


def make(grid=ROOM, **params):
    context = Context("main", 0.05, ROBOT, np.random.default_rng, START, map=grid)
    return ScanMatching(ScanMatchingParams(**params), context)


def scan_at(place, stamp_ns=0, ranges=None, half_angle=0.0, offsets=None, range_max=10.0):
    count = len(BEARINGS)
    seen = ranges_in(room(), CELL, place, BEARINGS) if ranges is None else ranges
    times = np.zeros(count) if offsets is None else offsets
    return RangeScan(stamp_ns, np.zeros((count, 2)), BEARINGS, np.full(count, half_angle), times, seen, 0.05, range_max)


def look(localizer, *scans, pose=(0.0, 0.0, 0.0), twist=STILL, stamp_ns=0):
    return localizer.localize(LocalizerInput(Odometry(stamp_ns, Pose2D(*pose), twist), scans, None))


def test_without_scans_the_odometry_is_placed_at_the_start():
    twist = Twist2D(0.4, 0.0, 0.1)
    got = look(make(), pose=(1.0, 0.5, 0.2), twist=twist, stamp_ns=50_000_000)
    c, s = math.cos(0.3), math.sin(0.3)
    assert (got.pose.x, got.pose.y) == pytest.approx((3.0 + c - 0.5 * s, 2.5 + s + 0.5 * c))
    assert got.pose.heading == pytest.approx(0.5)
    assert (got.stamp_ns, got.twist) == (50_000_000, twist)
    assert math.sqrt(got.covariance[2, 2]) > math.radians(2.0)


def test_scans_pull_odometry_to_where_the_robot_is():
    localizer = make()
    true = (3.05, 2.46, 0.32)
    for tick in range(5):
        got = look(localizer, scan_at(true, tick * 50_000_000), stamp_ns=tick * 50_000_000)
    assert (got.pose.x, got.pose.y) == pytest.approx(true[:2], abs=0.005)
    assert got.pose.heading == pytest.approx(true[2], abs=0.003)
    assert math.sqrt(got.covariance[0, 0]) < 0.01


@pytest.mark.parametrize(
    "scan",
    [
        scan_at((3.1, 2.5, 0.3), half_angle=math.radians(15.0)),  # a sonar
        scan_at((3.1, 2.5, 0.3), ranges=np.full(181, np.inf)),
        scan_at((3.1, 2.5, 0.3), range_max=1.0, ranges=np.full(181, 1.0)),  # all beams at the limit
        scan_at((3.1, 2.5, 0.3), ranges=np.full(181, 0.05)),
    ],
)
def test_scans_without_information_leave_the_prediction(scan):
    got = look(make(), scan)
    assert (got.pose.x, got.pose.y, got.pose.heading) == pytest.approx((3.0, 2.5, 0.3), abs=0.0)


def test_a_scan_that_is_too_old_leaves_the_prediction():
    got = look(make(), scan_at((3.1, 2.5, 0.3), stamp_ns=0), stamp_ns=600_000_000)
    assert (got.pose.x, got.pose.y, got.pose.heading) == pytest.approx((3.0, 2.5, 0.3), abs=0.0)


def test_beams_taken_at_different_times_are_put_together():
    # Turning at 1 rad/s, the first beam 0.2 s before the last; each sees the room from the place of the robot then.
    offsets = np.linspace(-0.2, 0.0, len(BEARINGS))
    ranges = np.array(
        [ranges_in(room(), CELL, (3.0, 2.5, 0.3 + t), np.array([b]))[0] for t, b in zip(offsets, BEARINGS, strict=True)]
    )
    twist = Twist2D(0.0, 0.0, 1.0)
    got = look(make(), scan_at(None, ranges=ranges, offsets=offsets), twist=twist)
    assert got.pose.heading == pytest.approx(0.3, abs=1e-3)
    blurred = look(make(), scan_at(None, ranges=ranges), twist=twist)
    assert abs(blurred.pose.heading - 0.3) > math.radians(1.5)


def test_a_beam_is_moved_along_the_arc():
    # At 1 m/s and π/2 rad/s one second before the odometry: a quarter circle of radius 2/π.
    beams, one = np.empty((1, 4)), np.zeros(1)
    motion = np.array([1.0, 0.0, 0.5 * math.pi, -1.0])
    assert beam_points(np.zeros((1, 2)), one, one, one, np.ones(1), np.array([0.0, 9.0, 0.0]), motion, beams) == 1
    radius = 2.0 / math.pi
    # Seen from the base now, it then stood at (-r, r) and looked to the right; the beam ends 1 m further to the right.
    assert beams[0] == pytest.approx([-radius, radius - 1.0, 0.0, -1.0], abs=1e-12)


def test_the_same_input_gives_the_same_answer():
    def run():
        localizer = make()
        return [look(localizer, scan_at((3.04, 2.5, 0.3)), stamp_ns=k * 50_000_000) for k in range(4)]

    for a, b in zip(run(), run(), strict=True):
        assert a.pose == b.pose
        assert np.array_equal(a.covariance, b.covariance)


def test_reset_forgets_and_configure_does_not():
    localizer = make()
    for _ in range(4):
        moved = look(localizer, scan_at((3.05, 2.5, 0.3)))
    localizer.configure(ScanMatchingParams(robust_scale=0.1))
    assert look(localizer).pose == moved.pose
    localizer.reset()
    assert look(localizer).pose == START


def test_unknown_cells_are_walls_only_if_configured():
    grid = OccupancyGrid(np.where(room(), -1, 0).astype(np.int8), CELL, Pose2D(0.0, 0.0, 0.0))
    scan = scan_at((3.03, 2.5, 0.3))
    assert look(make(grid), scan).pose.x == 3.0
    assert look(make(grid, unknown_is_wall=True), scan).pose.x == pytest.approx(3.03, abs=0.005)


@pytest.mark.parametrize(
    ("grid", "text"),
    [(None, "got no map"), (OccupancyGrid(np.zeros((0, 5), np.int8), CELL, START), "expected 1 to")],
)
def test_a_map_it_cannot_use_is_an_input_error(grid, text):
    with pytest.raises(InputError, match=text):
        make(grid)


@pytest.mark.parametrize("params", [{"sigma": 0.0}, {"robust_scale": -1.0}, {"least_inliers": 2}, {"speed": 1.0}])
def test_parameters_out_of_bounds_are_refused(params):
    with pytest.raises(ValidationError):
        ScanMatchingParams(**params)


def test_the_defaults_are_those_of_the_pure_module():
    from navloom_scan_localizer.tracking import Settings

    assert ScanMatchingParams().settings() == Settings()


def test_after_warm_up_nothing_is_compiled():
    ScanMatching.warm_up()
    kernels = (beam_points, fit_pose)
    before = [len(kernel.signatures) for kernel in kernels]
    look(make(), scan_at((3.0, 2.5, 0.3)), scan_at((3.0, 2.5, 0.3)))
    assert [len(kernel.signatures) for kernel in kernels] == before


def test_it_matches_the_known_map_that_replaces_its_contexts_and_no_other():
    moved = OccupancyGrid(ROOM.cells, CELL, Pose2D(0.1, 0.0, 0.0))
    odometry = Odometry(0, Pose2D(0.0, 0.0, 0.0), STILL)
    scan, mapped = scan_at((3.0, 2.5, 0.3)), MapUpdate(0, moved, np.empty((0, 4)), ())
    for known, map, x in ((None, None, 3.0), (None, mapped, 3.0), (ROOM, mapped, 3.0), (moved, None, 3.1)):
        localizer = make()
        for _ in range(5):
            got = localizer.localize(LocalizerInput(odometry, (scan,), map, known=known))
        assert got.pose.x == pytest.approx(x, abs=0.02)
