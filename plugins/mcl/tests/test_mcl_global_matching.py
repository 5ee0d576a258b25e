"""`global_matching`: found from nowhere, wrong starts, carried robots, look-alikes, other maps; the same bits twice."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom import ANYWHERE, Context, LocalizerInput, OccupancyGrid, Odometry, Pose2D, RangeScan, RobotSpec, Twist2D
from navloom_mcl.finding import Finder
from navloom_mcl.global_matching.adapter import GlobalMatching
from navloom_mcl.global_matching.params import GlobalMatchingParams
from navloom_mcl.global_matching.watch import Watch
from navloom_scan_localizer.adapter import ScanMatching
from navloom_scan_localizer.judging import Judge
from navloom_scan_localizer.params import ScanMatchingParams
from navloom_scan_localizer.tracking import PoseTracker, Settings
from navloom_scans.anywhere import MapSearch
from navloom_scans.field import distance_field
from navloom_scans.poses import compose
from scan_localizer_rooms import beams_of, fan, flat, ranges_in

PERIOD, CELL = 0.1, 0.1
SEEN, RANGE = fan(181), 12.0
CORNERS = np.array([[0.25, 0.25], [-0.25, 0.25], [-0.25, -0.25], [0.25, -0.25]])
ROBOT = RobotSpec(CORNERS, 0.6, 0.1, 0.2, 0.6, 1.0, 1.0, 1.0)


def cabins():
    """Two rooms that look the same, with doors to one corridor that is closed to the left and has a niche there."""
    walls = np.ones((80, 120), dtype=np.bool_)
    walls[60:78, 2:118] = False
    for left in (10, 62):
        walls[2:58, left : left + 46] = False
        walls[20:30, left : left + 12] = True
        walls[58:60, left + 20 : left + 30] = False
    walls[78:80, 4:14] = False
    return walls


def grid_of(walls):
    return OccupancyGrid(np.where(walls, 100, 0).astype(np.int8), CELL, Pose2D(0.0, 0.0, 0.0))


class Drive:
    """A robot in a raster world, with its localizer: by default at a place that it does not know."""

    def __init__(self, walls, place, start=None, sigma=None, localizer=GlobalMatching, known=None, **params):
        self.walls, self.place, self.odometry, self.tick = walls, np.array(place), np.zeros(3), 0
        sigma = ANYWHERE if start is None and sigma is None else sigma
        begin = Pose2D(*(start or (0.0, 0.0, 0.0)))
        self.random = np.random.default_rng(1)
        made = {GlobalMatching: GlobalMatchingParams, ScanMatching: ScanMatchingParams}[localizer](**params)
        grid = grid_of(walls if known is None else known)
        context = Context("main", PERIOD, ROBOT, np.random.default_rng, begin, map=grid, start_sigma=sigma)
        self.localizer, self.said = localizer(made, context), []

    def go(self, seconds, v=0.0, w=0.0, known=None):
        """Drive with a speed, m/s, and a turn rate, rad/s; the state of each tick."""
        step = np.array([v * PERIOD, 0.0, w * PERIOD])
        for _ in range(round(seconds / PERIOD)):
            self.place, self.odometry = compose(self.place, step), compose(self.odometry, step)
            ranges = ranges_in(self.walls, CELL, self.place, SEEN, RANGE)
            ranges = np.minimum(ranges + self.random.normal(0.0, 0.01, len(SEEN)), RANGE)
            stamp, flat = round(1e9 * PERIOD * self.tick), np.zeros(len(SEEN))
            scan = RangeScan(stamp, np.zeros((len(SEEN), 2)), SEEN, flat, flat, ranges, 0.05, RANGE)
            odometry = Odometry(stamp, Pose2D(*self.odometry.tolist()), Twist2D(v, 0.0, w))
            self.said.append(self.localizer.localize(LocalizerInput(odometry, (scan,), None, ("laser",), known=known)))
            self.tick += 1
        return [said.state for said in self.said[-round(seconds / PERIOD) :]]

    @property
    def error(self):
        """Error of the newest pose, m."""
        pose = self.said[-1].pose
        return math.dist((pose.x, pose.y), self.place[:2])

    @property
    def is_covered(self):
        """Whether the true position is within three standard deviations."""
        pose, covariance = self.said[-1].pose, self.said[-1].covariance[:2, :2]
        off = np.array([pose.x, pose.y]) - self.place[:2]
        return float(off @ np.linalg.solve(covariance, off)) < 9.0


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    GlobalMatching.warm_up()


@pytest.mark.parametrize("place", [(2.0, 2.5, 0.3), (6.5, 2.0, -2.0), (3.0, 5.0, 1.6)])
def test_a_robot_that_knows_nothing_is_found_while_it_turns_round(place):
    drive = Drive(flat(), place)
    assert drive.go(0.1) == ["searching"]
    assert drive.go(8.0, w=0.8)[-1] == "tracking"
    assert drive.error < 0.03


def test_in_one_of_two_equal_rooms_it_searches_until_it_has_left_the_room():
    drive = Drive(cabins(), (3.5, 2.0, 0.5 * math.pi))
    states = drive.go(12.0, w=math.tau / 6.0)
    assert set(states) == {"searching"} and "2 places fit" in drive.said[-1].reason
    places = drive.localizer.hypotheses()
    assert sorted(places.poses[:, 0].round(1).tolist()) == pytest.approx([3.5, 8.7], abs=0.1)
    assert places.weights == pytest.approx([0.5, 0.5], abs=0.3) and drive.is_covered
    drive.go(5.0, v=0.9)  # through the door
    drive.go(8.0, w=1.0)
    assert drive.said[-1].state == "tracking" and drive.error < 0.05


def test_a_start_wrong_by_a_metre_and_thirty_degrees_is_found_out():
    drive = Drive(flat(), (2.0, 2.5, 0.3), start=(2.8, 3.1, 0.3 + math.radians(30.0)))
    drive.go(3.0)
    drive.go(8.0, w=0.8)
    assert drive.said[-1].state == "tracking" and drive.error < 0.03


def test_a_guess_is_searched_round():
    hall = np.ones((40, 60), dtype=np.bool_)
    hall[1:-1, 1:-1] = False  # it looks the same turned by half a turn
    drive = Drive(hall, (2.0, 2.5, 0.3), start=(2.4, 2.2, 0.5), sigma=(0.5, 0.3))
    drive.go(8.0, w=0.8)
    assert drive.said[-1].state == "tracking" and drive.error < 0.03


def test_a_carried_robot_is_noticed_and_found_again():
    drive = Drive(flat(), (2.0, 2.5, 0.3), start=(2.0, 2.5, 0.3))
    assert set(drive.go(4.0, v=0.3, w=0.2)) == {"tracking"}
    drive.place = np.array([6.5, 3.5, 2.5])
    assert "searching" in drive.go(1.0)
    assert drive.go(8.0, w=0.8)[-1] == "tracking" and drive.error < 0.03


def test_with_a_known_start_it_is_scan_matching():
    drives = [
        Drive(flat(), (2.0, 2.5, 0.3), start=(2.0, 2.5, 0.3), localizer=kind) for kind in (GlobalMatching, ScanMatching)
    ]
    for drive in drives:
        drive.go(6.0, v=0.3, w=0.2)
    assert all(
        a.pose == b.pose and np.array_equal(a.covariance, b.covariance)
        for a, b in zip(*(d.said for d in drives), strict=True)
    )


def test_a_tracked_pose_is_corrected_by_two_centimetres_a_tick():
    drive = Drive(flat(), (2.0, 2.5, 0.3), start=(2.0, 2.5, 0.3))
    drive.go(3.0, v=0.2, w=0.2)
    drive.place = compose(drive.place, np.array([0.15, 0.0, 0.0]))  # the wheels have slipped
    before = len(drive.said)
    drive.go(2.0, v=0.2, w=0.2)
    assert {said.state for said in drive.said[before:]} == {"tracking"} and drive.error < 0.02
    for a, b in zip(drive.said[before:], drive.said[before + 1 :], strict=False):
        assert math.dist((a.pose.x, a.pose.y), (b.pose.x, b.pose.y)) < 0.02 + 0.02 + 1e-6


def test_odometry_that_turns_wrong_during_a_search_makes_no_other_place_better():
    hall = np.ones((40, 60), dtype=np.bool_)
    hall[1:-1, 1:-1] = False  # it looks the same turned by half a turn
    pose, field = np.array([2.0, 2.5, 0.3]), distance_field(hall, CELL, (0.0, 0.0, 0.0), 1.0)
    tracker = PoseTracker(Settings(), field, pose)
    judge, finder = Judge(tracker), Finder(MapSearch(field, ~hall), 10)
    watch = Watch(finder, 100)
    judge.trust()
    watch.suspect()
    beams = beams_of(ranges_in(hall, CELL, pose, SEEN, RANGE), SEEN)
    assert not watch.step(judge, tracker, 0.0, beams, len(beams))
    # The scans have corrected the pose since: it has not turned.
    tracker.odometry[2] += math.radians(6.0)
    answers = [watch.step(judge, tracker, 0.1, None, 0) for _ in range(5000)]
    assert not finder.is_busy and not any(answers)


def test_search_forgets_the_pose_and_place_sets_it():
    drive = Drive(flat(), (2.0, 2.5, 0.3), start=(2.0, 2.5, 0.3))
    drive.go(1.0)
    drive.localizer.search()
    assert drive.go(0.1) == ["searching"]
    drive.localizer.place(Pose2D(*drive.place.tolist()))
    assert drive.go(1.0)[-1] == "tracking" and drive.error < 0.02


def test_another_map_is_matched_from_the_next_tick_on():
    moved = np.roll(flat(), 3, axis=1)  # the same flat, 0.3 m further along x
    drive = Drive(flat(), (2.0, 2.5, 0.3), start=(2.0, 2.5, 0.3))
    drive.go(2.0)
    drive.go(6.0, w=0.8, known=grid_of(moved))
    assert drive.said[-1].state == "tracking"
    assert drive.said[-1].pose.x - drive.place[0] == pytest.approx(0.3, abs=0.02)


def test_on_the_map_of_another_building_it_is_lost_after_its_time():
    other = np.ones((60, 80), dtype=np.bool_)
    other[25:35, 5:75] = False
    drive = Drive(flat(), (2.0, 2.5, 0.3), known=other, give_up_after=5.0)
    states = drive.go(10.0, w=0.8)
    assert "tracking" not in states and states[-1] == "lost"


def test_two_runs_are_equal_bit_for_bit():
    said = []
    for _ in range(2):
        drive = Drive(cabins(), (3.5, 2.0, 1.5))
        drive.go(6.0, v=0.3, w=0.8)
        said.append([(a.pose, a.covariance.tobytes(), a.state, a.reason) for a in drive.said])
    assert said[0] == said[1]
