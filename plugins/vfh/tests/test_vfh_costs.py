"""Costs of VFH+ and VFH*, and why A* may trust the heuristic."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_vfh.costs import cheapest, difference, primary_cost, projected_cost, remaining_cost
from navloom_vfh.params import VfhPlusParams, VfhStarParams
from pydantic import ValidationError

FIRST, LATER = (5.0, 2.0, 2.0), (5.0, 1.0, 1.0)
Angle = st.floats(-math.pi, math.pi)


def deg(*angles):
    return [math.radians(angle) for angle in angles]


def test_difference_is_the_shorter_way_round():
    assert difference(*deg(170.0, -170.0)) == pytest.approx(math.radians(20.0))
    assert difference(*deg(-10.0, 30.0)) == pytest.approx(math.radians(40.0))
    assert difference(*deg(540.0, 0.0)) == pytest.approx(math.pi)


def test_primary_cost_weighs_target_heading_and_last_choice():
    """5 * 40 + 2 * 10 + 2 * 20 = 260."""
    assert primary_cost(*deg(10.0, 50.0, 0.0, -10.0), FIRST) == pytest.approx(math.radians(260.0))


def test_projected_cost_takes_the_worse_of_candidate_and_effective_direction():
    """0.8^2 (5 * 40 + 1 * 10 + 1 * 20) = 147.2; the step really leads 60 deg off: 0.64 (5 * 60 + 30) = 211.2."""
    c, target, heading, previous = deg(10.0, 50.0, 0.0, -10.0)
    cost = projected_cost(c, math.radians(30.0), target, heading, previous, LATER, 0.8, 2)
    assert cost == pytest.approx(math.radians(147.2))
    cost = projected_cost(c, math.radians(-10.0), target, heading, previous, LATER, 0.8, 2)
    assert cost == pytest.approx(math.radians(211.2))


def test_the_remaining_cost_assumes_that_the_target_direction_is_free():
    """0.8 (1 * 50 + 1 * 60) = 88."""
    assert remaining_cost(*deg(50.0, 0.0, -10.0), LATER, 0.8, 1) == pytest.approx(math.radians(88.0))


@settings(max_examples=200, deadline=None)
@given(
    Angle, Angle, Angle, Angle, Angle,
    st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0), st.floats(0.0, 5.0)), st.floats(0.1, 1.0), st.integers(0, 6),
)  # fmt: skip
def test_no_step_costs_less_than_the_heuristic(c, effective, target, heading, previous, extra, discount, depth):
    """With mu_1' = mu_2' + mu_3' + something, whatever the candidate."""
    weights = (extra[0] + extra[1] + extra[2], extra[1], extra[2])
    least = remaining_cost(target, heading, previous, weights, discount, depth)
    assert projected_cost(c, effective, target, heading, previous, weights, discount, depth) >= least - 1e-9


def test_a_heuristic_of_larger_weights_would_overestimate():
    """mu_1' = 1 < mu_2' + mu_3' = 4: straight on costs 90, the heuristic says 180 + 180."""
    weights = (1.0, 2.0, 2.0)
    straight = projected_cost(0.0, 0.0, math.radians(90.0), 0.0, 0.0, weights, 1.0, 1)
    assert straight == pytest.approx(math.radians(90.0))
    assert remaining_cost(math.radians(90.0), 0.0, 0.0, weights, 1.0, 1) == pytest.approx(math.radians(360.0))


def test_the_cheapest_candidate_is_taken_and_the_last_choice_decides_between_equals():
    directions = np.radians([-40.0, 40.0, 120.0])
    assert cheapest(directions, 3, 0.0, 0.0, math.radians(40.0), FIRST) == 1
    assert cheapest(directions, 3, 0.0, 0.0, math.radians(-40.0), FIRST) == 0
    assert cheapest(directions, 3, math.radians(100.0), math.radians(100.0), math.radians(100.0), FIRST) == 2
    assert cheapest(directions, 0, 0.0, 0.0, 0.0, FIRST) == -1


def test_weights_under_which_the_robot_would_not_turn_to_its_target_are_refused():
    with pytest.raises(ValidationError, match="target_weight 4 must be more than heading_weight 2 and"):
        VfhPlusParams(target_weight=4.0)
    with pytest.raises(ValidationError, match="projected_target_weight 2 must be more than projected_heading_weight"):
        VfhStarParams(projected_target_weight=2.0)


def test_thresholds_the_wrong_way_round_are_refused():
    with pytest.raises(ValidationError, match=r"threshold_low 0\.5 must not be more than threshold_high 0\.4"):
        VfhPlusParams(threshold_low=0.5)
