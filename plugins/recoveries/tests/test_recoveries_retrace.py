"""Retracing: what it drives, when it does not, and that it always ends."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom import RangeScan
from navloom_recoveries.adapter import less_noisy
from navloom_recoveries.driving_out import LOOK
from navloom_recoveries.motion import edges_of, gap, is_free, margin_of, turn_back
from navloom_recoveries.retracing import Retracing, Rules

SQUARE = np.array([[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]])
EDGES = edges_of(SQUARE)
PERIOD = 0.05
RULES = Rules(0.4, 0.15, 1.0, math.pi / 2, math.radians(45.0), 0.03, 1.0, 15.0, 0.5)
NOTHING = np.empty((0, 2))
STRAIGHT = np.stack([np.linspace(-2.0, 0.0, 41), np.zeros(41), np.zeros(41)], axis=1)


def drive(points, attempt=1, trail=STRAIGHT, rules=RULES, limit=40.0):
    """Poses of an ideal robot from (0, 0, 0) among obstacle points (k, 2), and the time until the recovery ended."""
    retracing = Retracing(rules, SQUARE)
    pose, time, poses = (0.0, 0.0, 0.0), 0.0, [(0.0, 0.0, 0.0)]
    retracing.start(time, attempt, pose, trail)
    while time < limit:
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        moved = points - np.array(pose[:2])
        seen = np.stack([cos * moved[:, 0] + sin * moved[:, 1], cos * moved[:, 1] - sin * moved[:, 0]], axis=1)
        v, w, is_over = retracing.step(time, pose, [seen])
        if is_over:
            return np.array(poses), time
        middle = pose[2] + 0.5 * w * PERIOD
        pose = (pose[0] + v * PERIOD * math.cos(middle), pose[1] + v * PERIOD * math.sin(middle), pose[2] + w * PERIOD)
        poses.append(pose)
        time += PERIOD
    raise AssertionError(f"did not end within {limit} s")


def test_the_gap_of_a_square_is_known_beside_its_edges_and_never_too_large_at_its_corners():
    assert gap(np.array([[0.5, 0.0]]), EDGES) == pytest.approx(0.3)
    assert gap(np.array([[0.0, 0.1]]), EDGES) == pytest.approx(-0.1)
    assert gap(np.array([[0.5, 0.6]]), EDGES) == pytest.approx(0.4)  # the corner is 0.5 away
    assert gap(NOTHING, EDGES) == math.inf


def test_the_arc_backwards_leads_through_the_place_it_steers_for():
    trail = np.array([[-1.0, 0.3, 0.0], [0.0, 0.0, 0.0]])
    w = turn_back(trail, (0.0, 0.0, 0.0), 0.15, 0.25)
    radius = -0.15 / w
    centre = (0.0, radius)
    assert math.dist(centre, trail[0, :2]) == pytest.approx(abs(radius))
    assert turn_back(trail, (-2.0, 0.0, 0.0), 0.15, 0.25) is None  # the trail is ahead
    assert turn_back(trail[:0], (0.0, 0.0, 0.0), 0.15, 0.25) is None


def test_it_backs_up_along_a_bend_of_its_trail_and_no_farther_than_asked():
    angle = np.linspace(-1.0, 0.0, 41)
    bend = np.stack([np.sin(angle), 1.0 - np.cos(angle), angle], axis=1)  # a circle of 1 m that ends at (0, 0, 0)
    poses, _ = drive(NOTHING, trail=bend)
    driven = np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()
    assert 0.4 <= driven < 0.4 + 2 * 0.15 * PERIOD
    assert np.abs(np.hypot(poses[:, 0], poses[:, 1] - 1.0) - 1.0).max() < 0.03
    assert poses[-1, 2] == pytest.approx(-0.4, abs=0.05)


def test_the_second_attempt_goes_twice_as_far_and_turns_to_the_roomier_side():
    wall_left = np.stack([np.linspace(-3.0, 3.0, 121), np.full(121, 0.6)], axis=1)
    poses, _ = drive(wall_left, attempt=2)
    assert poses[:, 0].min() == pytest.approx(-0.8, abs=0.02)
    assert poses[-1, 2] == pytest.approx(-math.pi / 2, abs=0.1)


def test_it_stops_before_an_obstacle_behind_it():
    behind = np.array([[-0.4, 0.0]])
    poses, _ = drive(behind)
    assert -0.2 + 0.03 - 0.001 < poses[:, 0].min() + 0.03 < 0.0
    assert poses[:, 0].min() - 0.2 > behind[0, 0] + 0.03 - 1e-9


def test_motors_that_lag_make_it_stop_earlier():
    """1 s at 0.15 m/s is 0.15 m."""
    post = np.array([[-0.55, 0.0]])
    (at_once, _), (late, _) = drive(post), drive(post, rules=replace(RULES, delay=1.0))
    assert late[:, 0].min() - at_once[:, 0].min() == pytest.approx(0.15, abs=0.02)


def test_a_robot_that_is_wedged_in_stays_where_it_is_and_ends():
    box = np.array([(side * x, y) for side in (-1, 1) for x, y in ((0.215, 0.15), (0.215, -0.15))])
    poses, time = drive(np.concatenate([box, box[:, ::-1]]), attempt=3)
    searches = 18 * PERIOD  # of 3 rooms, 2 choices of directions, 3 margins
    assert np.abs(poses).max() < 1e-9 and time == pytest.approx(LOOK + searches + RULES.rest, abs=2.1 * PERIOD)


def test_a_robot_that_begins_nearer_than_its_margin_may_leave_but_comes_no_nearer():
    beside = np.array([[0.0, 0.21], [0.21, 0.0]])
    assert margin_of(beside, EDGES, 0.03, 0.0) == pytest.approx(0.005)
    assert margin_of(beside, EDGES, 0.03, 0.04) == pytest.approx(0.01 - 0.005 - 0.02)
    poses, _ = drive(beside)
    assert poses[:, 0].min() < -0.3


def test_a_jammed_robot_moves_away_from_the_obstacle_before_it_goes_back():
    """A post 1 cm beside its right side, near the rear: it drives forward and turns away until the gap is 0.1 m."""
    post = np.array([[-0.1, -0.21]])
    poses, _ = drive(post)
    assert poses[-1, 0] > 0.05
    cos, sin = math.cos(poses[-1, 2]), math.sin(poses[-1, 2])
    moved = post - poses[-1, :2]
    assert gap(moved @ np.array([[cos, -sin], [sin, cos]]), EDGES) > 0.09


def test_a_robot_that_the_gate_holds_gives_up_going_back():
    retracing = Retracing(RULES, SQUARE)
    retracing.start(0.0, 1, (0.0, 0.0, 0.0), STRAIGHT)
    asked = [retracing.step(0.05 * k, (0.0, 0.0, 0.0), [NOTHING])[0] for k in range(30)]
    assert asked[8] < 0.0 and asked[-1] == 0.0  # it looks first


def test_the_noise_of_a_laser_is_averaged_and_a_sonar_is_taken_as_it_is():
    ranges = np.array([2.0, 1.03, 0.97, 1.0, math.inf, 2.0])
    for half_angle, expected in ((0.0, [2.0, 1.0, 1.0, 1.0, math.inf, 2.0]), (0.2, ranges)):
        scan = RangeScan(
            0, np.zeros((6, 2)), np.linspace(-0.1, 0.1, 6), np.full(6, half_angle), np.zeros(6), ranges, 0.05, 4.0
        )
        np.testing.assert_allclose(less_noisy(scan), expected)


def test_without_a_trail_it_does_not_back_up():
    poses, _ = drive(NOTHING, trail=np.empty((0, 3)))
    assert np.abs(poses).max() == 0.0


@settings(max_examples=25)
@given(
    st.lists(st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)), max_size=20),
    st.integers(1, 4),
)
def test_it_never_touches_what_it_sees_and_always_ends(places, attempt):
    points = np.array(places).reshape(-1, 2)
    if gap(points, EDGES) < 0.01:
        return
    poses, time = drive(points, attempt)
    assert time <= RULES.patience + RULES.rest + 2 * PERIOD
    for x, y, heading in poses:
        cos, sin = math.cos(heading), math.sin(heading)
        moved = points - (x, y)
        seen = np.stack([cos * moved[:, 0] + sin * moved[:, 1], cos * moved[:, 1] - sin * moved[:, 0]], axis=1)
        assert gap(seen, EDGES) > 0.0


def test_an_arc_is_free_if_no_obstacle_is_on_it():
    post = np.array([[1.0, 0.0]])
    assert not is_free(post, EDGES, 1.0, 0.0, 1.0, 0.03)
    assert is_free(post, EDGES, 1.0, 0.0, 0.7, 0.03)
    assert is_free(post, EDGES, -1.0, 0.0, 1.0, 0.03)
    assert is_free(post, EDGES, 1.0, 1.5, 1.0, 0.03)
