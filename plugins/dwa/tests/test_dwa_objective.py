"""The objective of 1997 with numbers that can be checked by hand."""

import math

import numpy as np
import pytest
from navloom_dwa.objective import arc_pose, distance_term, heading_term, score_1997, smooth, velocity_term


def test_an_arc_ends_where_the_circle_says():
    """A quarter of a circle of 2 m: (2, 2), turned by 90 deg. Straight: 1.5 m."""
    assert arc_pose(math.pi, 0.5 * math.pi, 1.0) == pytest.approx((2.0, 2.0, 0.5 * math.pi))
    assert arc_pose(0.5, 0.0, 3.0) == pytest.approx((1.5, 0.0, 0.0))


def test_heading_is_1_towards_the_target_half_beside_it_and_0_away():
    assert heading_term(0.0, 0.0, 0.25, 1.0, 1.0, 5.0, 0.0) == pytest.approx(1.0)
    assert heading_term(0.0, 0.0, 0.25, 1.0, 1.0, 0.0, 5.0) == pytest.approx(0.5)
    assert heading_term(0.0, 0.0, 0.25, 1.0, 1.0, -5.0, 0.0) == pytest.approx(0.0, abs=1e-9)


def test_heading_is_taken_where_the_robot_comes_to_after_an_interval_and_braking():
    """In place at 1 rad/s for 0.5 s, then 1 rad/s^2: turned by 0.5 + 0.5 rad. At 2 m/s: 1 + 2 m on, past the target."""
    assert heading_term(0.0, 1.0, 0.5, 1.0, 1.0, math.cos(1.0), math.sin(1.0)) == pytest.approx(1.0)
    assert heading_term(2.0, 0.0, 0.5, 1.0, 1.0, 2.9, 0.0) == pytest.approx(0.0, abs=1e-9)
    assert heading_term(2.0, 0.0, 0.5, 1.0, 1.0, 3.1, 0.0) == pytest.approx(1.0)


def test_distance_and_velocity_are_shares():
    assert distance_term(1.0, 4.0) == 0.25
    assert distance_term(math.inf, 4.0) == 1.0
    assert velocity_term(0.3, 0.5) == pytest.approx(0.6)


def test_smoothing_is_the_mean_of_admissible_neighbours():
    values = np.array([[0.0, 3.0], [6.0, -math.inf]])
    smoothed = np.zeros((2, 2))
    smooth(values, smoothed)
    np.testing.assert_allclose(smoothed, [[3.0, 3.0], [3.0, -math.inf]])


ARCS = ((0.8, -0.6, 0.0, 0.5), (1.0, 0.0, 0.0, 0.5), (0.8, 0.6, 0.0, 0.5))


def scored(limits, contacts, target=(5.0, 0.0), weights=(1.0, 0.0, 0.0), arcs=ARCS):
    costs = np.zeros((len(arcs), 6))
    score_1997(np.array(arcs), np.array(limits), np.array(contacts), target, 0.25, 1.0, 1.0, 0.5, 4.0, weights, costs)
    return costs


def test_velocities_over_the_limit_or_outside_the_window_are_not_admissible():
    costs = scored([9.0, 0.25, -1.0], [math.inf] * 3)
    assert np.isfinite(costs).sum(axis=1).tolist() == [6, 3, 0]


def test_with_the_heading_alone_straight_to_the_target_is_best_at_every_speed():
    """The straight arc has two neighbours on either side: the smoothing favours arcs at the edge of the window."""
    arcs = [(0.8, -1.2, 0.0, 0.5), *ARCS, (0.8, 1.2, 0.0, 0.5)]
    assert scored([9.0] * 5, [math.inf] * 5, arcs=arcs)[:, 1:].argmin(axis=0).tolist() == [2] * 5
    beside = scored([9.0] * 5, [math.inf] * 5, target=(1.0, 2.0), arcs=arcs)
    assert (np.diff(beside[:, 1:], axis=0) < 0.0).all()  # the more to the left, the better


def test_with_the_speed_alone_the_fastest_is_best():
    costs = scored([9.0] * 3, [math.inf] * 3, weights=(0.0, 0.0, 1.0))
    assert np.unravel_index(costs.argmin(), (3, 6))[1] == 5


def test_with_the_distance_alone_the_free_side_is_best():
    costs = scored([9.0] * 3, [1.0, 2.0, math.inf], weights=(0.0, 1.0, 0.0))
    assert costs.min(axis=1).argmin() == 2
    assert costs[0, 0] == pytest.approx(-(0.25 + 0.5) / 2.0)  # with its neighbour, each 1/4 and 2/4 of 4 m
