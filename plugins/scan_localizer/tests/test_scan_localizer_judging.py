"""Confidence of the localizer: right poses are tracked; wrong ones are corrected, searched for or lost."""

import math
import re

import numpy as np
import pytest
from navloom_scan_localizer.judging import Judge
from navloom_scan_localizer.tracking import PoseTracker, Settings
from navloom_scans.field import distance_field
from navloom_scans.poses import compose
from navloom_scans.search import candidates
from scan_localizer_rooms import beams_of, fan, ranges_in, room

CELL, PERIOD = 0.1, 0.05
BEARINGS = fan(181)
TRUE = np.array([3.0, 2.5, 0.3])


def furnished():
    """A room of 6 m with a niche and two cupboards, so that it looks different from everywhere."""
    occupied = room()
    occupied[10:16, 1:5] = occupied[40:58, 44:48] = occupied[50:54, 12:20] = True
    return occupied


ROOM = furnished()
FIELD = distance_field(ROOM, CELL, (0.0, 0.0, 0.0), 1.0)


class Robot:
    """A stopped robot with a tracker and its judge."""

    def __init__(self, believed, field=FIELD, **settings):
        self.tracker = PoseTracker(Settings(**settings), field, np.array(believed, dtype=float))
        self.judge, self.time, self.rng = Judge(self.tracker), 0.0, np.random.default_rng(1)
        self.odometry = np.zeros(3)

    def see(self, scene, seconds, true=TRUE, sigma=0.03):
        """Observe a scene from the true pose; gives the states in order."""
        states = []
        for _ in range(round(seconds / PERIOD)):
            ranges = ranges_in(scene, CELL, true, BEARINGS, 10.0)
            beams = beams_of(ranges + sigma * self.rng.standard_normal(len(ranges)), BEARINGS)
            self.tracker.predict(self.odometry, PERIOD)
            self.tracker.correct(beams)
            self.judge.look(beams, self.time)
            self.time += PERIOD
            states.append(self.judge.state)
        return states

    def error(self, true=TRUE):
        off = self.tracker.pose - true
        return math.hypot(off[0], off[1]), abs(math.remainder(off[2], math.tau))


def cluttered():
    """The room with three objects of 0.3 m that are not in the map and give a fifth of the echoes."""
    occupied = furnished()
    for row, column in ((18, 40), (35, 40), (42, 30)):
        occupied[row : row + 3, column : column + 3] = True
    return occupied


def crate():
    """Walls close round the robot that hide the room."""
    occupied = np.zeros_like(ROOM)
    occupied[15:36, 20:41] = room(21, 21)
    return occupied


@pytest.mark.parametrize("scene", [ROOM, cluttered()], ids=["as mapped", "with unmapped things"])
def test_a_right_start_is_tracked_from_the_first_scan_on(scene):
    robot = Robot(TRUE)
    assert set(robot.see(scene, 3.0)) == {"tracking"} and robot.judge.reason == ""
    assert robot.error()[0] < 0.03


@pytest.mark.parametrize("scene", [ROOM, cluttered()], ids=["as mapped", "with unmapped things"])
@pytest.mark.parametrize("degrees", range(0, 360, 45))
@pytest.mark.parametrize("turn", [-15.0, 15.0])
def test_a_start_off_by_half_a_metre_and_15_degrees_is_corrected(scene, degrees, turn):
    way = math.radians(degrees)
    robot = Robot(TRUE + (0.5 * math.cos(way), 0.5 * math.sin(way), math.radians(turn)))
    states = robot.see(scene, 1.5)
    assert states[0] == "searching" and states[-1] == "tracking"
    place, heading = robot.error()
    assert place < 0.05 and heading < math.radians(1.0)


def test_while_it_searches_it_reports_the_error_of_the_odometry():
    robot = Robot(TRUE + (0.4, 0.3, math.radians(15.0)))
    robot.see(ROOM, PERIOD)
    # 0.50 m and 15 deg, less what the first fit has corrected.
    assert re.search(r"100% of the echoes fit the map 0.4\d m and 1[0-5] deg from where odometry", robot.judge.reason)
    robot.see(ROOM, 1.0)
    assert robot.judge.reason == ""


HALL = room(140, 140)
IN_HALL = np.array([7.1, 6.7, 0.3])
"""Walls of 14 m, at least 3.5 m further away than those of the map: every beam passes through one."""


def test_beams_that_pass_through_the_map_start_a_search_and_then_it_is_lost():
    robot = Robot(TRUE)
    states = robot.see(HALL, 5.0, IN_HALL)
    # 0.5 s of patience, then 3 s of searching, in steps of 0.1 s.
    assert states.index("searching") == pytest.approx(11, abs=1)
    assert states.index("lost") == pytest.approx(72, abs=2)
    assert states[-1] == "lost"
    assert robot.judge.reason == "100% of the beams to a wall of the map pass through it, more than 40%"


def test_it_tracks_again_once_it_sees_the_room_again():
    robot = Robot(TRUE)
    robot.see(HALL, 5.0, IN_HALL)
    states = robot.see(ROOM, 2.0)
    assert states[0] == "lost" and states[-1] == "tracking" and robot.judge.reason == ""
    assert robot.error()[0] < 0.05


CARRIED = TRUE + (0.5, -0.3, math.radians(60.0))


def test_a_robot_that_is_carried_trusts_no_place():
    robot = Robot(TRUE)
    robot.see(ROOM, 1.0)
    states = robot.see(ROOM, 5.0, CARRIED)
    assert "tracking" not in states[11:] and states[-1] == "lost"  # after 0.5 s of patience
    assert "of the beams continue the view of before: the robot was carried or shut in" in robot.judge.reason


def test_a_carried_robot_that_is_put_back_tracks_again():
    robot = Robot(TRUE)
    robot.see(ROOM, 1.0)
    robot.see(ROOM, 5.0, CARRIED)
    assert robot.see(ROOM, 2.0)[-1] == "tracking" and robot.error()[0] < 0.05


def test_echoes_before_every_wall_do_not_contradict_the_pose_of_a_robot_at_rest():
    robot = Robot(TRUE)
    robot.see(ROOM, 1.0)
    before = robot.tracker.covariance[0, 0]
    assert set(robot.see(crate(), 10.0)) == {"tracking"}
    # 10 s at rest with 0.002 m/sqrt(s): 10 * 4e-6 m^2.
    assert robot.tracker.covariance[0, 0] - before == pytest.approx(4e-5, rel=0.05)


def test_a_robot_that_has_seen_nothing_of_the_map_yet_is_not_tracking():
    robot = Robot(TRUE)
    assert robot.see(crate(), 1.0)[-1] == "searching"
    assert robot.judge.reason == "less than 5% of the beams have seen the map at this place"


def test_a_robot_that_is_shut_in_and_driven_0_3_m_searches():
    robot = Robot(TRUE)
    robot.see(ROOM, 1.0)
    near, states = beams_of(np.full(len(BEARINGS), 0.6), BEARINGS), []
    for tick in range(60):  # at 0.2 m/s, 0.01 m a tick
        robot.tracker.predict(np.array([0.01 * tick, 0.0, 0.0]), PERIOD)
        robot.judge.look(near, robot.time + tick * PERIOD)
        states.append(robot.judge.state)
    # 30 ticks for 0.3 m, and 0.5 s of patience.
    assert states.index("searching") == pytest.approx(42, abs=3)
    assert robot.judge.reason.startswith("0% of the beams continue the view of before")


def test_a_place_that_looks_alike_is_not_trusted_if_beams_fit_better_further_away():
    hall = room(24, 80)  # 8 m by 2.4 m, the same from both ends but for a post near a wall
    hall[1:4, 54:57] = True
    field, true = distance_field(hall, CELL, (0.0, 0.0, 0.0), 1.0), np.array([3.0, 1.2, math.pi])
    robot = Robot((5.3, 1.3, math.radians(12.0)), field)  # the other end's place is (5.0, 1.2, 0)
    assert robot.see(hall, 2.0, true)[-1] == "searching"
    assert robot.judge.reason.endswith("of the echoes fit the map here, but more within 2 m")


def test_a_pallet_close_by_that_hides_two_thirds_of_the_map_changes_nothing():
    scene = furnished()
    scene[18:33, 34] = scene[34, 20:36] = scene[15, 20:36] = True  # walls round three sides, 0.4 m or more away
    robot = Robot(TRUE)
    assert set(robot.see(scene, 5.0)) == {"tracking"}
    assert robot.error()[0] < 0.03


def test_a_mapped_cupboard_that_was_taken_away_changes_nothing():
    scene = furnished()
    scene[40:58, 44:48] = False
    robot = Robot(TRUE)
    assert set(robot.see(scene, 5.0)) == {"tracking"}
    assert robot.error()[0] < 0.03


def test_a_mapped_pane_of_glass_through_which_most_of_the_room_is_seen_changes_nothing():
    known = furnished()
    known[1:-1, 36] = True
    robot = Robot(TRUE, distance_field(known, CELL, (0.0, 0.0, 0.0), 1.0))
    # It is 0.6 m away: 104 of 181 beams pass through it.
    assert set(robot.see(ROOM, 5.0)) == {"tracking"}
    assert robot.error()[0] < 0.03


def test_beams_without_an_echo_where_the_map_has_walls_contradict_the_pose():
    robot = Robot(TRUE)
    ways = np.column_stack((np.cos(BEARINGS), np.sin(BEARINGS)))
    for tick in range(20):  # 1 s, with nothing within 8 m; the walls of the map are 2.5 to 4.6 m away
        robot.judge.look(np.hstack((8.0 * ways, ways)), tick * PERIOD, 0)
    assert robot.judge.state == "searching"
    assert robot.judge.reason == "100% of the beams to a wall of the map pass through it, more than 40%"


def test_an_obstacle_that_passes_by_changes_nothing():
    robot = Robot(TRUE)
    assert set(robot.see(ROOM, 1.0) + robot.see(crate(), 0.4) + robot.see(ROOM, 1.0)) == {"tracking"}


def test_a_pose_that_is_uncertain_for_long_is_not_trusted():
    robot = Robot(TRUE, lost_sigma=0.3)
    robot.tracker.covariance = np.diag([0.16, 0.01, 0.01])
    for tick in range(12):
        robot.judge.look(np.empty((0, 4)), tick * PERIOD)  # no echo
    assert robot.judge.state == "searching"
    assert robot.judge.reason == "the position has a standard deviation of 0.40 m, more than 0.3 m"


def corridor():
    """A bare corridor of 2 m by 60 m."""
    occupied = np.zeros((26, 600), dtype=np.bool_)
    occupied[[2, 23]] = True
    return occupied, distance_field(occupied, CELL, (0.0, 0.0, 0.0), 1.0), np.array([30.0, 1.3, 0.0])


def test_in_a_bare_corridor_the_place_along_it_is_that_of_the_odometry():
    occupied, field, true = corridor()
    robot = Robot(true + (0.3, 0.4, math.radians(15.0)), field)
    robot.see(occupied, 1.5, true)
    assert abs(robot.tracker.pose[1] - true[1]) < 0.03 and abs(robot.tracker.pose[0] - true[0] - 0.3) < 0.15
    assert math.sqrt(robot.tracker.covariance[0, 0]) > 0.3  # and it reports that


def test_a_pose_that_was_moved_to_some_place_along_a_corridor_is_not_trusted():
    occupied, field, true = corridor()
    robot = Robot(true + (0.3, 0.4, math.radians(15.0)), field)
    assert robot.see(occupied, 1.5, true)[-1] == "searching"
    # The search reaches 0.7 m, which is the standard deviation of the place along the corridor.
    assert robot.judge.reason == "the position has a standard deviation of 0.70 m, more than 0.3 m"


def test_a_right_start_in_a_bare_corridor_is_tracked():
    occupied, field, true = corridor()
    assert set(Robot(true, field).see(occupied, 3.0, true)) == {"tracking"}


def test_two_bays_that_look_alike_are_not_told_apart_by_one_scan():
    occupied, field, true = corridor()
    for column in range(270, 330, 8):  # bays of 0.4 m, 0.8 m apart, on both sides
        for row in (2, 23):
            occupied[row, column : column + 4] = False
        occupied[[0, 25], column : column + 4] = True
    field = distance_field(occupied, CELL, (0.0, 0.0, 0.0), 1.0)
    robot = Robot(true + (0.4, 0.2, math.radians(12.0)), field)
    assert robot.see(occupied, 1.5, true)[-1] == "searching"
    assert "places nearby are as good" in robot.judge.reason


def test_candidates_lie_apart_with_the_true_place_among_them():
    beams = beams_of(ranges_in(ROOM, CELL, TRUE, BEARINGS, 10.0), BEARINGS)
    found = candidates(FIELD, beams, TRUE + (0.42, -0.33, 0.2), 0.7, math.radians(20.0), 8)
    assert len(found) == 8
    assert min(np.abs(pose - TRUE) @ (1.0, 1.0, 1.0) for pose in found) < 0.2
    for k, pose in enumerate(found):
        steps = np.abs(found[:k] - pose) / (0.1, 0.1, math.radians(2.5))
        assert (steps.max(axis=1) > 2.5).all()


@pytest.mark.parametrize("degrees", [-30.0, -12.0, 12.0, 20.0, 30.0])
def test_odometry_that_turns_at_once_is_bridged(degrees):
    robot = Robot(TRUE)
    robot.see(ROOM, 2.0)
    robot.tracker.predict(np.array([0.0, 0.0, math.radians(degrees)]), PERIOD)
    robot.odometry = robot.tracker.odometry
    assert set(robot.see(ROOM, 2.0)) == {"tracking"}
    assert robot.error()[0] < 0.03 and robot.error()[1] < math.radians(1.0)


@pytest.mark.parametrize("scene", [ROOM, cluttered()], ids=["as mapped", "with unmapped things"])
def test_scans_that_are_seconds_apart_bridge_an_error_of_odometry(scene):
    robot, true = Robot(TRUE), TRUE
    for k in range(1, 16):  # a drive of 1.5 m back and forth proves the pose
        robot.odometry = np.array([0.1 * min(k, 15 - k), 0.0, 0.0])
        true = compose(TRUE, robot.odometry)
        robot.see(scene, PERIOD, true)
        robot.time += 0.1
    # Over the next 3 s it drives 1 m; odometry lacks 0.5 m and turns by 18 degrees too much.
    robot.odometry, robot.time = np.array([0.5, 0.0, math.radians(18.0)]), robot.time + 3.0
    true = compose(TRUE, np.array([1.0, 0.0, 0.0]))
    assert set(robot.see(scene, 5.0, true)) == {"tracking"}
    assert robot.error(true)[0] < 0.05
