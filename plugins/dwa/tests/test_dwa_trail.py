"""The trail of targets, turns in place, and the scores by direction."""

import math

import numpy as np
import pytest
from navloom_dwa.trail import TurnTrend, trail_ahead
from navloom_dwa.view import arc_directions, cost_by_direction, free_directions, occupied_picture


def test_the_trail_leads_from_the_robot_over_the_targets_it_was_given():
    trail = []
    for x in (1.0, 1.2, 1.4, 1.6):
        found = trail_ahead(trail, (0.0, 0.5), (x, 0.0), 0.5)
    np.testing.assert_allclose(found, [[0.0, 0.5], [1.0, 0.0], [1.2, 0.0], [1.4, 0.0], [1.6, 0.0]])


def test_passed_targets_are_removed_from_the_trail():
    trail = [(1.0, 0.0), (1.2, 0.0), (1.4, 0.0)]
    assert trail_ahead(trail, (1.25, 0.1), (1.6, 0.0), 0.5)[1].tolist() == [1.2, 0.0]
    assert trail[0] == (1.2, 0.0)


def test_a_target_far_from_the_last_starts_a_new_trail_and_one_near_it_adds_nothing():
    trail = [(1.0, 0.0), (1.2, 0.0)]
    assert len(trail_ahead(trail, (0.0, 0.0), (1.21, 0.0), 0.5)) == 3
    np.testing.assert_allclose(trail_ahead(trail, (0.0, 0.0), (5.0, 5.0), 0.5), [[0.0, 0.0], [5.0, 5.0]])


def test_a_turn_in_place_binds_until_the_robot_has_driven_or_turned():
    trend = TurnTrend(0.1, 1.0)
    trend.note(0.0, 0.3, 0.05, (0.0, 0.0, 0.0))
    assert trend.sign == 1
    trend.note(0.0, -0.3, 0.05, (0.0, 0.0, 0.1))
    trend.follow((0.05, 0.0, 0.9))
    assert trend.sign == 1
    trend.follow((0.05, 0.0, 1.1))
    assert trend.sign == 0
    trend.note(0.3, -0.3, 0.05, (0.0, 0.0, 0.0))
    assert trend.sign == 0  # it drives


def test_an_arcs_direction_is_that_of_its_chord_after_a_metre():
    assert arc_directions(np.array([[0.8, 0.6, 0.0, 1.0]])).tolist() == pytest.approx([0.3])


def test_costs_by_direction_are_0_for_the_best_and_1_where_nothing_is_free():
    costs = np.array([[4.0, 2.0], [math.inf, math.inf], [3.0, 6.0]])
    found = cost_by_direction(np.array([0.1, 1.6, 3.2]), costs, 4)
    np.testing.assert_allclose(found, [0.0, 1.0, 0.25, 1.0])
    assert cost_by_direction(np.zeros(3), np.full((3, 2), math.inf), 4).tolist() == [1.0] * 4


def test_free_directions_are_runs_of_arcs():
    costs = np.array([[1.0], [math.inf], [1.0], [1.0]])
    np.testing.assert_allclose(free_directions(np.array([-0.3, -0.1, 0.1, 0.3]), costs), [[-0.3, -0.3], [0.1, 0.3]])
    assert free_directions(np.zeros(4), np.full((4, 1), math.inf)).shape == (0, 2)


def test_the_picture_shows_what_is_occupied():
    assert occupied_picture(np.array([[0, 3]], np.int32)).tolist() == [[15, 0]]
