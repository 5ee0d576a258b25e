"""Odometry from scans: the averaged surfaces, and the estimated pose."""

import math

import numpy as np
import pytest
from navloom import Context, LocalizerInput, Odometry, Pose2D, RangeScan, RobotSpec, Twist2D
from navloom_scan_localizer.params import ScanOdometryParams
from navloom_scan_localizer.scan_odometry.adapter import ScanOdometry
from navloom_scan_localizer.surface import LocalSurface
from navloom_scan_localizer.sweep import Sweep
from navloom_scan_localizer.unaided import hold_unseen
from navloom_scans.poses import compose, relative
from navloom_scans.readings import ordered
from scan_localizer_rooms import fan, ranges_in, room

CELL = 0.1
BEARINGS = fan(361)
ROBOT = RobotSpec(np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]), 0.6, 0.05, 0.2, 0.5, 1.0, 0.5, 1.0)


def wall_beams(rng, distance, sigma):
    """Beams of a robot at (0, 0, 0) at a wall square to the x axis: (n, 4)."""
    bearings = np.linspace(-0.8, 0.8, 161)
    ranges = distance / np.cos(bearings) + sigma * rng.standard_normal(len(bearings))
    direction = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    return np.hstack([ranges[:, None] * direction, direction])


def zero_along_x(surface, y):
    """Place along a row of the lattice where the distance changes its sign, m."""
    x0, y0, _, _, spacing = surface.field.frame
    row = surface.field.values[round((y - y0) / spacing)]
    known = np.flatnonzero(np.isfinite(row))
    k = next(k for k in known if row[k] > 0.0 >= row[k + 1])
    return x0 + spacing * (k + row[k] / (row[k] - row[k + 1]))


def test_the_mean_of_many_noisy_scans_has_its_zero_where_the_wall_is():
    rng, surface = np.random.default_rng(1), LocalSurface(0.05, 4.0, 0.2, 0.1, 1000.0)
    for _ in range(40):
        surface.add(wall_beams(rng, 2.0, 0.03), np.zeros(3))
    assert [zero_along_x(surface, y) for y in (-0.5, 0.0, 0.5)] == pytest.approx([2.0] * 3, abs=0.01)


def test_a_surface_that_beams_pass_disappears():
    surface = LocalSurface(0.05, 4.0, 0.2, 0.1, 60.0)
    for distance in (1.0, 3.0):
        for _ in range(40):
            surface.add(wall_beams(np.random.default_rng(2), distance, 0.0), np.zeros(3))
    assert zero_along_x(surface, 0.0) == pytest.approx(3.0, abs=0.01)


def test_the_lattice_follows_the_robot_and_its_contents_stay_in_place():
    surface = LocalSurface(0.05, 2.0, 0.2, 0.1, 60.0)
    surface.add(wall_beams(np.random.default_rng(3), 2.0, 0.0), np.zeros(3))
    surface.follow(1.51, -0.3)
    assert surface.field.frame[0] == pytest.approx(-1.5, abs=0.03)
    assert zero_along_x(surface, 0.0) == pytest.approx(2.0, abs=0.01)
    surface.follow(30.0, 0.0)
    assert not np.isfinite(surface.field.values).any()


def driven(seed, drift_deg=0.0, half_angle=0.0):
    """Estimated and true pose at the end of a loop of 8.8 m in a room of 6 m, with odometry that turns too far.

    Args:
        seed: Seed of the noise of the ranges, sigma 0.03 m. drift_deg: Error of odometry's heading after 1 m, degrees.
        half_angle: Half angle of the beams, rad.
    """
    rng, walls = np.random.default_rng(seed), room()
    true, odometry = np.array([3.0, 1.6, 0.0]), np.zeros(3)
    context = Context("main", 0.05, ROBOT, np.random.default_rng, Pose2D(*true))
    localizer = ScanOdometry(ScanOdometryParams(), context)
    start, halves, none = true.copy(), np.full(len(BEARINGS), half_angle), np.zeros(len(BEARINGS))
    for tick in range(441):
        stamp = 50_000_000 * tick
        if tick:
            step = np.array([0.02, 0.0, 0.02 / 1.4])
            true = compose(true, step)
            odometry = compose(odometry, step + [0.0, 0.0, math.radians(drift_deg) * 0.02])
        ranges = ranges_in(walls, CELL, true, BEARINGS) + 0.03 * rng.standard_normal(len(BEARINGS))
        scan = RangeScan(stamp, np.zeros((len(BEARINGS), 2)), BEARINGS, halves, none, ranges, 0.05, 10.0)
        seen = Odometry(stamp, Pose2D(*odometry.tolist()), Twist2D(0.4, 0.0, 0.2))
        said = localizer.localize(LocalizerInput(seen, (scan,), None))
    return said, true, compose(start, odometry)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_it_corrects_the_drift_of_the_wheels(seed):
    """A drift of 1 degree per metre: by odometry alone the loop ends 0.2 m and 9 degrees off."""
    said, true, by_wheels = driven(seed, drift_deg=1.0)
    assert math.hypot(*relative(true, by_wheels)[:2]) > 0.15
    off = relative(true, np.array([said.pose.x, said.pose.y, said.pose.heading]))
    assert math.hypot(off[0], off[1]) < 0.04 and abs(math.degrees(off[2])) < 0.8
    assert said.state == "tracking"
    assert math.hypot(off[0], off[1]) < 4.0 * math.sqrt(said.covariance[0, 0] + said.covariance[1, 1])


def test_with_cones_alone_the_odometry_is_followed():
    said, _, by_wheels = driven(1, drift_deg=1.0, half_angle=0.2)
    assert (said.pose.x, said.pose.y) == pytest.approx(by_wheels[:2].tolist())


def test_a_robot_whose_place_is_too_uncertain_is_lost():
    context = Context("main", 0.05, ROBOT, np.random.default_rng, Pose2D(0.0, 0.0, 0.0))
    localizer = ScanOdometry(ScanOdometryParams(lost_sigma=0.2), context)
    far = Odometry(10**9, Pose2D(100.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0))
    said = localizer.localize(LocalizerInput(far, (), None))
    assert said.state == "lost" and "more than 0.2 m" in said.reason
    localizer.reset()
    still = Odometry(0, Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0))
    assert localizer.localize(LocalizerInput(still, (), None)).state == "tracking"


def test_only_neighbouring_echoes_where_space_was_free_are_a_body_that_moves():
    """The wall stands 3 m ahead; then there are echoes 1.5 m ahead, at first less than 0.15 m wide: a post."""
    surface, wall = LocalSurface(0.05, 4.0, 0.2, 0.1, 60.0), wall_beams(np.random.default_rng(4), 3.0, 0.0)
    surface.look(wall, len(wall), np.zeros(3), 1.0)
    assert not surface.has_moving(wall, np.zeros(3), 1.05)
    for width, is_body in ((8, False), (40, True)):
        near = wall.copy()
        near[60 : 60 + width, :2] *= 0.5
        assert surface.has_moving(near, np.zeros(3), 1.05) is is_body
    # Space is no longer free 10 s later: a thing may have been put there.
    assert not surface.has_moving(near, np.zeros(3), 12.0)


@pytest.mark.parametrize(("stood", "is_body"), [(0.9, True), (1.1, False)])
def test_what_has_stood_for_a_second_where_space_was_free_does_not_move(stood: float, is_body: bool):
    surface, wall = LocalSurface(0.05, 4.0, 0.2, 0.1, 60.0), wall_beams(np.random.default_rng(4), 3.0, 0.0)
    surface.look(wall, len(wall), np.zeros(3), 1.0)
    near = wall.copy()
    near[60:100, :2] *= 0.5
    for time in (1.05, 1.05 + stood):
        surface.look(near, len(near), np.zeros(3), time)
    assert surface.has_moving(near, np.zeros(3), 1.05 + stood) is is_body


def test_a_long_wall_is_settled_at_once():
    """7 m of a wall 2 m ahead, and then its middle 2 m alone, which may be bodies."""
    wall = wall_beams(np.random.default_rng(5), 2.0, 0.0)
    assert np.ptp(wall[:, 1]) > 4.0
    for seen, settles in ((wall, True), (wall[np.abs(wall[:, 1]) < 1.0], False)):
        surface = LocalSurface(0.05, 4.0, 0.2, 0.1, 60.0)
        surface.add(seen, np.zeros(3))
        surface.look(seen, len(seen), np.zeros(3), 1.0)
        assert np.isfinite(surface.settled().values).any() == settles


def test_a_surface_settles_when_it_has_been_seen_for_a_second_and_not_looked_through():
    surface, wall = LocalSurface(0.05, 4.0, 0.2, 0.1, 60.0), wall_beams(np.random.default_rng(5), 1.0, 0.0)
    surface.add(wall, np.zeros(3))
    for time, settles in ((1.0, False), (1.9, False), (2.1, True)):
        surface.look(wall, len(wall), np.zeros(3), time)
        assert np.isfinite(surface.settled().values).any() == settles
    farther = wall.copy()
    farther[:, :2] *= 1.8
    surface.look(farther, len(farther), np.zeros(3), 2.2)
    assert not np.isfinite(surface.settled().values).any()


def test_when_a_body_moves_the_surfaces_that_stand_still_stay():
    """A wall that has stood for a second, and one beside it that was seen just now."""
    surface, wall = LocalSurface(0.05, 4.0, 0.2, 0.1, 60.0), wall_beams(np.random.default_rng(5), 1.0, 0.0)
    old, new = wall[np.abs(wall[:, 1] - 0.5) < 0.4], wall[np.abs(wall[:, 1] + 0.5) < 0.4]
    for seen, time in ((old, 1.0), (old, 2.1), (new, 2.2)):
        surface.add(seen, np.zeros(3))
        surface.look(seen, len(seen), np.zeros(3), time)
    surface.settled()
    surface.forget_unsettled()
    sides = surface.field.frame[1] + 0.05 * np.flatnonzero(np.isfinite(surface.field.values).any(axis=1))
    assert len(sides)
    assert sides.min() > 0.0


# --- a small robot: 360 beams over a revolution, 7.5 revolutions a second ---------------------------------------------

REVOLUTION = 2.0 / 15.0
AROUND = np.arange(360) * math.tau / 360.0
NOTHING = np.full(360, np.inf)


def track(legs, start=(3.0, 2.5, 0.3)):
    """(n, 3) true poses, 1/120 of a revolution apart, of legs of constant speed, m/s, turn rate, rad/s, and time, s."""
    step, poses = REVOLUTION / 120.0, [np.array(start)]
    for v, w, time in legs:
        for _ in range(round(time / step)):
            poses.append(compose(poses[-1], np.array([v * step, 0.0, w * step])))
    return np.array(poses)


class SmallRobot:
    """`scan_odometry` on a robot whose laser sees 3.5 m, sigma 0.015 m.

    Args:
        way: See `track`. wheels: Ratio of odometry's turns to the true ones; 0 if there is no odometry.
        is_reversed: The driver gives the times of the beams the other way round.
        walls: (rows, columns) occupied cells; None for a room of 6 m.
        is_blind: Takes the number of a scan; the scan is then without an echo.
    """

    def __init__(self, way, wheels=1.03, is_reversed=False, is_blind=lambda number: False, walls=None):
        self.rng, self.walls, self.said = np.random.default_rng(7), room() if walls is None else walls, []
        self.localizer = ScanOdometry(
            ScanOdometryParams(), Context("main", 0.05, ROBOT, np.random.default_rng, Pose2D(*way[0].tolist()))
        )
        odometry, nowhere, times = np.zeros(3), np.zeros((360, 2)), np.arange(360) * REVOLUTION / 360.0
        for number, begin in enumerate(range(0, len(way) - 120, 120)):
            poses = way[begin + np.arange(360) // 3]
            ranges = [ranges_in(self.walls, CELL, pose, [way], 3.5)[0] for pose, way in zip(poses, AROUND, strict=True)]
            ranges = NOTHING if is_blind(number) else np.array(ranges) + 0.015 * self.rng.standard_normal(360)
            step = relative(way[begin], way[begin + 120])
            odometry = compose(odometry, np.array([step[0], step[1], wheels * step[2]]) * bool(wheels))
            stamp = round(1e9 * (1.0 + REVOLUTION * number))
            rates = (step[0] / REVOLUTION, 0.0, wheels * step[2] / REVOLUTION) if wheels else (0.0, 0.0, 0.0)
            seen = Odometry(stamp + round(1e9 * REVOLUTION), Pose2D(*odometry.tolist()), Twist2D(*rates))
            given = times[::-1] if is_reversed else times
            scan = RangeScan(stamp, nowhere, AROUND, np.zeros(360), given.copy(), ranges, 0.12, 3.5)
            self.said.append(self.localizer.localize(LocalizerInput(seen, (scan,), None)))
            self.true = way[begin + 120]
        pose = self.said[-1].pose
        off = relative(self.true, np.array([pose.x, pose.y, pose.heading]))
        self.away, self.turned_deg = math.hypot(off[0], off[1]), abs(math.degrees(off[2]))


LOOP = [(0.0, 0.0, 1.0), *[(0.3, 0.0, 3.0), (0.0, 1.0, 0.5 * math.pi)] * 4, (0.0, 0.0, 0.5)]
"""A square of 3.6 m with turns in place, one revolution in all."""


@pytest.mark.parametrize("is_reversed", [False, True])
def test_times_of_beams_the_other_way_round_do_not_turn_the_pose(is_reversed):
    """The bar: 1 % of the 3.6 m, and 1 degree for the revolution."""
    robot = SmallRobot(track(LOOP), is_reversed=is_reversed)
    assert robot.away < 0.036 and robot.turned_deg < 1.0


@pytest.mark.parametrize("is_reversed", [False, True])
def test_without_odometry_the_scans_alone_are_followed(is_reversed):
    """Along a corridor of 3 m by 12 m with pillars at its walls, and a turn at its end; the bar is 1 % of 7 m."""
    walls = room(30, 120)
    for column in (20, 45, 70, 95):
        walls[1:4, column : column + 4] = walls[-6:-1, column + 9 : column + 13] = True
    way = track([(0.0, 0.0, 1.0), (0.4, 0.0, 12.5), (0.0, 1.0, math.pi), (0.4, 0.0, 5.0)], np.array([2.0, 1.5, 0.0]))
    robot = SmallRobot(way, wheels=0.0, is_reversed=is_reversed, walls=walls)
    assert robot.away < 0.07 and robot.turned_deg < 1.0
    assert robot.said[-1].state == "tracking"


def test_without_odometry_the_velocity_is_that_of_the_scans():
    robot = SmallRobot(track([(0.0, 0.0, 1.0), (0.3, 0.0, 2.0)]), wheels=0.0)
    assert robot.said[-1].twist.vx == pytest.approx(0.3, abs=0.05)


def test_a_robot_that_stands_is_held_by_its_wheels():
    """A fit alone scatters by about 2 mm."""
    robot = SmallRobot(track([(0.0, 0.0, 6.0)]))
    assert robot.away < 0.002 and robot.said[-1].twist == Twist2D(0.0, 0.0, 0.0)


def test_without_odometry_a_robot_that_saw_nothing_for_long_stays_lost():
    """The heading spreads by 30 degrees a root second, so that 2 s are too long."""
    robot = SmallRobot(track([(0.3, 0.0, 8.0)]), wheels=0.0, is_blind=lambda number: 15 <= number < 35)
    assert robot.said[14].state == "tracking" and robot.said[-1].state == "lost"
    assert "the heading has a standard deviation of" in robot.said[34].reason


def test_the_order_is_that_of_the_least_cost_once_it_leads_clearly():
    sweep = Sweep()
    for _ in range(2):
        assert sweep.order == 1.0
        sweep.compare(lambda order: {1.0: 4.0, 0.0: 3.0, -1.0: 1.0}[order])
    assert sweep.order == -1.0
    assert ordered(np.array([0.0, 0.02, 0.1]), -1.0) == pytest.approx([0.1, 0.08, 0.0])


def test_a_scan_says_nothing_along_a_bare_corridor():
    """Walls along x: information 100 across, 1 along; the prior's is 10 everywhere."""
    prior, pose = np.zeros(3), np.array([0.3, 0.2, 0.1])
    found, covariance = hold_unseen(pose, np.diag([1 / 11, 1 / 110, 1 / 110]), prior, np.eye(3) / 10)
    assert found == pytest.approx([0.0, 0.2, 0.1])
    assert covariance.diagonal() == pytest.approx([1 / 10, 1 / 110, 1 / 110])


def test_a_settled_surface_keeps_its_place_when_the_lattice_follows_the_robot():
    surface, wall = LocalSurface(0.05, 4.0, 0.2, 0.1, 60.0), wall_beams(np.random.default_rng(5), 1.0, 0.0)
    surface.add(wall, np.zeros(3))
    places = []
    for time, x in ((1.0, 0.0), (2.1, 0.0), (2.1, 2.5)):
        surface.look(wall, len(wall), np.zeros(3), time)
        surface.follow(x, 0.0)
        found = surface.settled()
        places.append(found.frame[0] + 0.05 * np.flatnonzero(np.isfinite(found.values).any(axis=0)))
    assert len(places[0]) == 0 and len(places[1]) > 2
    np.testing.assert_allclose(places[2], places[1], atol=1e-9)


def test_settled_surfaces_in_use_keep_their_place_when_the_lattice_follows_the_robot():
    """A wall at x = 1 m; the lattice, whose slack is 0.5 m, moves by 0.6 m while the last field is in use."""
    surface = LocalSurface(0.05, 1.0, 0.2, 0.2, 10.0)
    beams = np.array([[1.0, 0.05 * k, 1.0, 0.0] for k in range(-8, 9)])
    for time in (0.0, 0.6, 1.2):
        surface.add(beams, np.zeros(3))
        surface.look(beams, len(beams), np.zeros(3), time)
    field = surface.settled()
    surface.follow(0.6, 0.0)
    row, column = round((0.0 - field.frame[1]) / 0.05), round((1.0 - field.frame[0]) / 0.05)
    assert field.values[row, column] == pytest.approx(0.0, abs=1e-3)
