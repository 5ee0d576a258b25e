"""The localizer: from nowhere to tracking, guesses, carried robots, look-alikes, other maps; the same bits twice."""

from __future__ import annotations

import hashlib
import math
import os
from pathlib import Path

import numpy as np
import pytest
from navloom import (
    ANYWHERE,
    Context,
    InputError,
    LocalizerInput,
    OccupancyGrid,
    Odometry,
    Pose2D,
    RangeScan,
    RobotSpec,
    Twist2D,
)
from navloom_maps.rosmap import load_raster
from navloom_mcl.adapter import Mcl
from navloom_mcl.params import MclParams
from scan_localizer_rooms import fan, flat, ranges_in
from scipy.ndimage import distance_transform_edt

PERIOD = 0.05
SEEN, RANGE = fan(181), 12.0
CORNERS = np.array([[0.25, 0.25], [-0.25, 0.25], [-0.25, -0.25], [0.25, -0.25]])
NOWHERE = Pose2D(0.0, 0.0, 0.0)
MAP = Path(os.environ.get("NAVLOOM_DATA", "")) / "rosmaps" / "aws_small_house.yaml"
ROBOT = RobotSpec(CORNERS, 0.6, 0.1, 0.2, 0.6, 1.0, 1.0, 1.0)


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    Mcl.warm_up()


def grid_of(walls, cell=0.1, origin=(0.0, 0.0)):
    return OccupancyGrid(np.where(walls, 100, 0).astype(np.int8), cell, Pose2D(*origin, 0.0))


class Drive:
    """A robot in a raster world, and its localizer."""

    def __init__(self, walls, place, start=NOWHERE, sigma=ANYWHERE, cell=0.1, seed=0, known=None, **params):
        self.walls, self.cell, self.place = walls, cell, np.array(place)
        self.odometry, self.ticks, self.stream = np.zeros(3), 0, np.random.default_rng([seed, 1])
        streams = {}
        self.context = Context(
            "localizer", PERIOD, ROBOT, lambda name: streams.setdefault(name, np.random.default_rng([seed, 2])), start,
            map=grid_of(walls if known is None else known, cell), start_sigma=sigma,
        )  # fmt: skip
        self.localizer, self.hash, self.states = Mcl(MclParams(**params), self.context), hashlib.sha256(), []

    def step(self, v, w, known=None):
        """One tick at a speed, m/s, and a turn rate, rad/s; the estimate."""
        for pose in (self.place, self.odometry):
            middle = pose[2] + 0.5 * w * PERIOD
            pose += (v * PERIOD * math.cos(middle), v * PERIOD * math.sin(middle), w * PERIOD)
            pose[2] = math.remainder(pose[2], math.tau)
        stamp_ns, scans = self.ticks * 50_000_000, ()
        if self.ticks % 2 == 0:
            ranges = ranges_in(self.walls, self.cell, self.place, SEEN, RANGE) + self.stream.normal(
                0.0, 0.01, len(SEEN)
            )
            flat = np.zeros(len(SEEN))
            scans = (
                RangeScan(stamp_ns, np.zeros((len(SEEN), 2)), SEEN, flat, flat, np.minimum(ranges, RANGE), 0.05, RANGE),
            )
        self.ticks += 1
        odometry = Odometry(stamp_ns, Pose2D(*self.odometry), Twist2D(v, 0.0, w))
        self.answer = self.localizer.localize(
            LocalizerInput(odometry, scans, None, ("laser",) * len(scans), known=known)
        )
        self.states.append(self.answer.state)
        for part in (self.answer.pose, self.answer.covariance.tobytes(), self.answer.state, self.answer.reason):
            self.hash.update(repr(part).encode())
        return self.answer

    def turn(self, seconds, w=0.6, v=0.0):
        for _ in range(round(seconds / PERIOD)):
            self.step(v, w)

    @property
    def off(self):
        """Error of the pose, m and rad."""
        pose = self.answer.pose
        return math.dist((pose.x, pose.y), self.place[:2]), abs(math.remainder(pose.heading - self.place[2], math.tau))


def test_a_robot_that_knows_nothing_is_found_by_turning_round():
    drive = Drive(flat(), (2.0, 2.5, 0.3), search_work=1000)
    assert drive.step(0.0, 0.0).state == "searching"
    # Anywhere in 8 m, in any heading.
    assert np.diag(drive.answer.covariance) == pytest.approx([64.0, 64.0, math.pi**2], rel=0.01)
    drive.turn(7.0)
    assert drive.answer.state == "tracking"
    assert drive.off[0] < 0.03
    assert drive.off[1] < math.radians(1.0)


def test_a_found_place_is_not_trusted_before_it_has_fitted_along_a_way():
    drive = Drive(flat(), (2.0, 2.5, 0.3))
    for _ in range(100):
        drive.step(0.0, 0.0)
    # It is there, but a robot that has not moved has seen one view only.
    assert drive.off[0] < 0.05
    assert drive.answer.state == "searching"
    assert "one place fits, along 0.0 m of 1 m" in drive.answer.reason


def test_a_known_start_is_tracked_from_the_first_scan():
    drive = Drive(flat(), (2.0, 2.5, 0.3), Pose2D(2.0, 2.5, 0.3), None)
    drive.turn(3.0, 0.5, 0.2)
    assert set(drive.states) == {"tracking"}
    assert drive.off[0] < 0.03


def test_a_guess_is_searched_round():
    # The hall looks the same turned by half a turn; the guess says which way.
    hall = np.ones((40, 60), dtype=np.bool_)
    hall[1:-1, 1:-1] = False
    drive = Drive(hall, (2.0, 2.5, 0.3), Pose2D(2.5, 2.2, 0.6), (0.5, 0.3))
    drive.turn(7.0)
    assert drive.answer.state == "tracking"
    assert drive.off[0] < 0.05


def test_a_hall_that_looks_the_same_leaves_two_places():
    hall = np.ones((40, 60), dtype=np.bool_)
    hall[1:-1, 1:-1] = False
    drive = Drive(hall, (2.0, 2.5, 0.3))
    drive.turn(8.0)
    places = drive.localizer.hypotheses()
    assert "tracking" not in drive.states
    assert "2 places fit" in drive.answer.reason
    assert places.weights[:2] == pytest.approx([0.5, 0.5], abs=0.35)
    assert places.poses[0, :2] + places.poses[1, :2] == pytest.approx([6.0, 4.0], abs=0.1)
    # The covariance spans both: the other one is some metres and half a turn away.
    assert drive.answer.covariance[2, 2] > 0.15 * math.pi**2


def test_while_it_tracks_its_pose_is_the_only_hypothesis():
    drive = Drive(flat(), (2.0, 2.5, 0.3), Pose2D(2.0, 2.5, 0.3), None)
    messages = []
    for _ in range(40):
        drive.step(0.1, 0.2)
        if not messages or drive.localizer.hypotheses() is not messages[-1]:
            messages.append(drive.localizer.hypotheses())
    # 2 s, and one message each 0.5 s.
    assert [len(message.poses) for message in messages] == [1, 1, 1, 1]


def test_a_carried_robot_notices_and_is_found_again():
    drive = Drive(flat(), (2.0, 2.5, 0.3), Pose2D(2.0, 2.5, 0.3), None)
    drive.turn(2.0)
    drive.place[:] = 6.3, 1.2, -2.0
    drive.turn(4.0)
    assert "searching" in drive.states
    drive.turn(12.0)
    assert drive.answer.state == "tracking"
    assert drive.off[0] < 0.05


def test_people_all_round_do_not_make_it_search():
    walls = flat()
    drive = Drive(walls, (2.5, 3.0, 0.3), Pose2D(2.5, 3.0, 0.3), None, known=walls)
    drive.turn(1.0)
    crowded = walls.copy()
    for bearing in np.arange(0.0, math.tau, math.tau / 9):
        row, column = int(30 + 7 * math.sin(bearing)), int(25 + 7 * math.cos(bearing))
        crowded[row - 1 : row + 2, column - 1 : column + 2] = True
    drive.walls = crowded
    drive.turn(5.0)
    assert set(drive.states) == {"tracking"}
    assert drive.off[0] < 0.05


def test_an_operator_may_place_it_and_let_it_search():
    drive = Drive(flat(), (2.0, 2.5, 0.3))
    drive.localizer.place(Pose2D(2.0, 2.5, 0.3))
    assert drive.step(0.0, 0.0).state == "tracking"
    drive.localizer.search()
    assert drive.step(0.0, 0.0).state == "searching"
    drive.localizer.search(Pose2D(2.2, 2.5, 0.1), (0.3, 0.3))
    drive.turn(7.0)
    assert drive.answer.state == "tracking"
    assert drive.off[0] < 0.05


def test_a_map_that_is_replaced_is_matched_from_then_on():
    walls = flat()
    drive = Drive(walls, (2.0, 2.5, 0.3), Pose2D(2.0, 2.5, 0.3), None)
    drive.turn(1.0)
    # The same building, its map 0.3 m further along x.
    drive.step(0.0, 0.0, grid_of(walls, origin=(0.3, 0.0)))
    drive.turn(15.0, 0.5, 0.1)
    assert drive.answer.pose.x - drive.place[0] == pytest.approx(0.3, abs=0.05)


def test_the_same_seed_gives_the_same_answers():
    hashes = set()
    for seed in (3, 3, 4):
        drive = Drive(flat(), (2.0, 2.5, 0.3), seed=seed)
        drive.turn(4.0)
        hashes.add(drive.hash.hexdigest())
    assert len(hashes) == 2


def test_reset_starts_as_a_new_object_does():
    drive = Drive(flat(), (2.0, 2.5, 0.3))
    drive.turn(2.0)
    first = drive.hash.hexdigest()
    drive.localizer.reset()
    drive.place[:], drive.odometry[:], drive.ticks = (2.0, 2.5, 0.3), 0.0, 0
    drive.stream, drive.hash = np.random.default_rng([0, 1]), hashlib.sha256()
    drive.turn(2.0)
    assert drive.hash.hexdigest() == first


def test_new_parameters_keep_the_place():
    drive = Drive(flat(), (2.0, 2.5, 0.3), Pose2D(2.0, 2.5, 0.3), None)
    drive.turn(2.0)
    drive.localizer.configure(MclParams(sigma=0.1))
    drive.step(0.0, 0.0)
    assert drive.answer.state == "tracking"
    assert drive.off[0] < 0.03


def test_it_needs_a_map():
    streams = np.random.default_rng
    with pytest.raises(InputError, match="got no map"):
        Mcl(MclParams(), Context("localizer", PERIOD, ROBOT, lambda name: streams(0), Pose2D(0.0, 0.0, 0.0)))


def test_the_least_number_of_particles_is_below_the_most():
    with pytest.raises(ValueError, match="least_particles and most_particles"):
        MclParams(least_particles=600, most_particles=500)


@pytest.mark.skipif(not MAP.is_file(), reason="NAVLOOM_DATA names no folder with rosmaps/aws_small_house.yaml")
@pytest.mark.parametrize("seed", range(4))
def test_a_robot_is_found_anywhere_in_a_real_house(seed):
    raster = load_raster(MAP)
    stream, cell = np.random.default_rng(seed), raster.resolution
    gap = distance_transform_edt(~raster.occupied) * cell
    row, column = stream.permutation(np.argwhere(gap > 0.4))[0]
    place = ((column + 0.5) * cell, (row + 0.5) * cell, stream.uniform(-math.pi, math.pi))
    drive = Drive(raster.occupied, place, cell=cell, seed=seed)
    drive.turn(8.0)
    assert drive.answer.state == "tracking"
    assert drive.off[0] < 0.05
    assert drive.off[1] < math.radians(1.0)
