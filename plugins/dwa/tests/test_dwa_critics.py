"""Each critic with numbers that can be checked by hand, and their sum over a window."""

import math

import numpy as np
import pytest
from navloom_dwa.critics import (
    beyond_target,
    contact_nearness,
    goal_distance,
    is_oscillating,
    mean_until,
    must_rotate,
    obstacle_nearness,
    path_distance,
    score_critics,
    segments_of,
)
from navloom_dwa.field import fill_field
from navloom_dwa.window import sample_arcs

CELL, SIZE = 0.1, 81


def test_goal_distance_is_the_cost_to_go_in_metres():
    field = np.full((3, 3), 55, np.int32)
    assert goal_distance(field, np.array([0, 0]), CELL, 0.15, 0.15) == pytest.approx(0.55)


def test_path_distance_is_that_of_the_nearest_piece():
    path = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]])
    assert path_distance(segments_of(path), 1.0, 0.5) == pytest.approx(0.5)
    assert path_distance(segments_of(path), 2.3, 1.0) == pytest.approx(0.3)
    assert path_distance(segments_of(path), -3.0, 4.0) == pytest.approx(5.0)
    assert path_distance(segments_of(path[:1]), 1.0, 1.0) == 0.0


def test_nearness_of_obstacles_and_contacts():
    assert [obstacle_nearness(c, 0.4, 0.2) for c in (0.3, 0.4, 0.45, 0.6)] == pytest.approx([1.0, 1.0, 0.75, 0.0])
    assert [contact_nearness(t, 2.0) for t in (0.0, 0.5, 3.0, math.inf)] == pytest.approx([1.0, 0.75, 0.0, 0.0])


def test_a_turn_in_place_may_not_go_back_but_one_while_driving_may():
    assert is_oscillating(0.0, -0.3, 1, 0.05)
    assert not is_oscillating(0.0, 0.3, 1, 0.05)
    assert not is_oscillating(0.2, -0.3, 1, 0.05)
    assert not is_oscillating(0.0, -0.3, 0, 0.05)


def test_a_near_target_beside_is_turned_to_first():
    assert must_rotate(0.3, 1.2, 0.5, 1.0)
    assert not must_rotate(0.3, -0.8, 0.5, 1.0)
    assert not must_rotate(0.6, 1.2, 0.5, 1.0)


def test_past_a_target_that_is_not_the_goal_the_way_goes_on():
    assert beyond_target(0.4, 3.0) == pytest.approx(-0.4)
    assert beyond_target(0.4, 0.1) == pytest.approx(-0.1)


def test_the_mean_of_a_running_sum_up_to_a_number_between():
    """Samples 2, 4, 6: mean of the first two 3; up to number 1.5, (2 + 4 + half of 6) / 2.5."""
    sums = np.array([2.0, 6.0, 12.0])
    assert mean_until(sums, 0.0) == 2.0
    assert mean_until(sums, 1.0) == 3.0
    assert mean_until(sums, 1.5) == pytest.approx(9.0 / 2.5)
    assert mean_until(sums, 2.0) == 4.0


def scored(target, contacts=None, obstacles=(), remaining=0.0, trend=0, window=(0.0, 0.5, -0.4, 0.4)):
    arcs, costs = np.zeros((21, 4)), np.zeros((21, 10))
    sample_arcs(window, 0.57, 0.3, math.inf, arcs)
    contacts = np.full(21, math.inf) if contacts is None else contacts
    origin = np.zeros(2, np.int64)
    distance, to_go = np.zeros((SIZE, SIZE), np.int32), np.zeros((SIZE, SIZE), np.int32)
    pose = (0.0, 0.0, 0.0)
    points = np.array([[x, y, 0.05] for x, y in obstacles]).reshape(-1, 3)
    fill_field(points, pose, target, origin, CELL, 0.4, 0.3, 3.0, distance, to_go)
    weights = np.array([1.0, 1.0, 0.1, 0.1, 0.5, 0.5, 0.02])
    path = np.array([[0.0, 0.0], target])
    score_critics(
        arcs, np.full(21, math.inf), contacts, target, pose, 2.0, 0.3, remaining, 0.3, path, to_go, distance, origin,
        CELL, 0.4, 0.3, weights, trend, 0.05, (0.5, 1.0), costs,
    )  # fmt: skip
    j, i = np.unravel_index(costs.argmin(), costs.shape)
    u = arcs[j, 2] + (arcs[j, 3] - arcs[j, 2]) * i / 9
    return arcs, costs, (arcs[j, 0] * u, arcs[j, 1] * u)


def test_in_the_open_the_best_is_straight_ahead_at_full_speed():
    _, costs, best = scored((3.0, 0.0))
    assert best == pytest.approx((0.5, 0.0), abs=1e-6)
    assert np.isfinite(costs).all()


def test_a_target_behind_is_turned_to_in_place():
    _, _, (v, w) = scored((-3.0, 0.5))
    assert v == pytest.approx(0.0, abs=1e-6)
    assert w == pytest.approx(0.4, abs=1e-6)


def test_while_a_turn_to_the_right_binds_nothing_turns_left_in_place():
    arcs, costs, (v, w) = scored((-3.0, 0.5), trend=-1)
    speeds = arcs[:, 2:3] + (arcs[:, 3:4] - arcs[:, 2:3]) * np.linspace(0.0, 1.0, 10)
    in_place = (arcs[:, :1] * speeds < 0.05) & (arcs[:, 1:2] * speeds > 0.0)
    assert np.isinf(costs[in_place]).all()
    assert not (v < 0.05 and w > 0.0)


def test_an_obstacle_ahead_on_the_left_is_passed_on_the_right():
    _, _, (v, w) = scored((3.0, 0.0), obstacles=[(1.2, 0.2), (1.2, 0.4)])
    assert v > 0.0
    assert w < -0.1


def test_a_target_on_the_way_is_driven_through_but_the_goal_is_not():
    """0.3 m to the target at 0.5 m/s and 2 s: driving on is worth it only where the way goes on."""
    assert scored((0.3, 0.0), remaining=5.0)[2][0] == pytest.approx(0.5, abs=1e-6)
    assert scored((0.3, 0.0), remaining=0.0)[2][0] < 0.35


def test_of_two_arcs_the_one_that_soon_ends_at_an_obstacle_is_worth_less():
    contacts = np.full(21, math.inf)
    contacts[10] = 0.2
    _, free, _ = scored((3.0, 0.0))
    _, blocked, _ = scored((3.0, 0.0), contacts)
    assert (blocked[10, 2:] > free[10, 2:]).all()  # slower ones do not come so far in 2 s
    np.testing.assert_array_equal(np.delete(blocked, 10, 0), np.delete(free, 10, 0))
