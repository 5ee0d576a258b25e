"""The forces of the paper with numbers that can be checked by hand, and properties for any cells."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from navloom_vff.forces import cell_force, damping_factor, force_constant, repulsive_force, resultant, travel_cosine

Place = st.floats(-1.7, 1.7, allow_subnormal=False)  # such cells have no direction: their quotients round to 1
Cells = st.lists(st.tuples(Place, Place, st.integers(1, 15)), max_size=12)
Angle = st.floats(-math.pi, math.pi)


def push(cells, radius=0.0, constant=1.0, least=0.1, horizon=math.inf, heading=0.0, sectors=72):
    histogram = np.ones(sectors)
    rows = np.array(cells, float).reshape(-1, 3)
    return repulsive_force(rows, radius, constant, least, horizon, heading, histogram), histogram


def test_a_cell_pushes_with_its_certainty_over_the_square_of_its_distance():
    assert cell_force(6.0, 2.0, 0.5) == pytest.approx(0.75)


def test_at_the_balance_a_full_cell_pushes_as_the_target_pulls():
    assert force_constant(0.3) == pytest.approx(0.006)
    assert cell_force(15.0, 0.3, force_constant(0.3)) == pytest.approx(1.0)


def test_the_push_is_away_from_the_cell():
    (x, y), _ = push([(0.6, 0.8, 15.0)])
    assert (x, y) == pytest.approx((-9.0, -12.0))


def test_pushes_add_up():
    """15 / 1 from the left and 6 / 4 from ahead."""
    (x, y), _ = push([(0.0, 1.0, 15.0), (2.0, 0.0, 6.0)])
    assert (x, y) == pytest.approx((-1.5, -15.0))


def test_distances_are_from_the_robots_disc():
    """1 m from the centre is 0.5 m from the disc: four times the force."""
    (x, _), _ = push([(1.0, 0.0, 15.0)], radius=0.5)
    assert x == pytest.approx(-60.0)


def test_cells_nearer_than_the_least_distance_push_no_harder():
    (x, _), _ = push([(0.55, 0.0, 15.0)], radius=0.5, least=0.1)
    assert x == pytest.approx(-1500.0)
    (x, _), _ = push([(0.3, 0.0, 15.0)], radius=0.5, least=0.1)  # within the disc
    assert x == pytest.approx(-1500.0)


def test_cells_beyond_the_horizon_do_not_push():
    (x, y), histogram = push([(1.0, 0.0, 15.0)], horizon=0.9)
    assert (x, y) == (0.0, 0.0)
    assert histogram.sum() == 0.0


def test_the_histogram_holds_the_magnitudes_by_direction_in_the_pose_frame():
    """Heading 90 deg: ahead is at 90 deg, in sector 18 of 72; to the right is at 0 deg, in sector 0."""
    _, histogram = push([(1.0, 0.01, 15.0), (0.001, -2.0, 6.0)], heading=0.5 * math.pi)
    assert histogram[18] == pytest.approx(15.0, rel=1e-3)
    assert histogram[0] == pytest.approx(1.5, rel=1e-3)
    assert np.count_nonzero(histogram) == 2


def test_cosine_of_the_travel_is_minus_one_at_an_obstacle_zero_along_and_one_away():
    assert travel_cosine((-3.0, 0.0), 0.0) == pytest.approx(-1.0)
    assert travel_cosine((-3.0, 0.0), 0.5 * math.pi) == pytest.approx(0.0)
    assert travel_cosine((-3.0, 0.0), math.pi) == pytest.approx(1.0)
    assert travel_cosine((0.0, 0.0), 1.0) == 0.0


def test_damping_leaves_all_towards_a_quarter_along_and_nothing_away():
    """w = 0.25; the printed formula gives 2 w - 1 = -0.5 away from the obstacle, which would pull."""
    assert damping_factor(-1.0, 0.25, False) == pytest.approx(1.0)
    assert damping_factor(0.0, 0.25, False) == pytest.approx(0.25)
    assert damping_factor(-0.5, 0.25, False) == pytest.approx(0.625)
    assert damping_factor(1.0, 0.25, False) == 0.0
    assert damping_factor(1.0, 0.25, True) == pytest.approx(-0.5)


def test_resultant_of_equal_forces_halves_the_angle_between_them():
    assert resultant((0.0, 1.0), 1.0, 0.0) == pytest.approx(math.radians(45.0))
    assert resultant((-3.0, 0.0), 0.25, 0.0) == pytest.approx(0.0)  # damped to 0.75: the target still wins
    assert resultant((-3.0, 0.0), 1.0, 0.0) == pytest.approx(math.pi)


@settings(max_examples=200)
@given(Cells, st.floats(0.0, 0.8))
def test_the_push_is_finite_and_no_more_than_all_cells_at_the_least_distance(cells, radius):
    (x, y), histogram = push(cells, radius=radius)
    assert math.isfinite(x) and math.isfinite(y)
    assert math.hypot(x, y) <= histogram.sum() + 1e-9
    assert histogram.sum() <= sum(c / 0.1**2 for _, _, c in cells) + 1e-6
    assert (histogram >= 0.0).all()


@settings(max_examples=200)
@given(Cells, Angle, st.floats(0.0, 0.8))
def test_turning_the_cells_turns_the_push(cells, turn, radius):
    c, s = math.cos(turn), math.sin(turn)
    turned = [(c * x - s * y, s * x + c * y, value) for x, y, value in cells]
    (x, y), histogram = push(cells, radius=radius)
    (u, v), _ = push(turned, radius=radius)
    scale = 1e-9 * (1.0 + histogram.sum())
    assert (u, v) == pytest.approx((c * x - s * y, s * x + c * y), abs=scale)


@settings(max_examples=200)
@given(Cells, Angle, Angle)
def test_turning_cells_heading_and_target_turns_the_resultant(cells, heading, turn):
    (x, y), _ = push(cells, constant=0.004)
    answers = []
    for angle in (0.0, turn):
        c, s = math.cos(heading + angle), math.sin(heading + angle)
        force = (c * x - s * y, s * x + c * y)
        factor = damping_factor(travel_cosine(force, heading + angle), 0.25, False)
        pull = 1.0 + angle
        total = math.hypot(math.cos(pull) + factor * force[0], math.sin(pull) + factor * force[1])
        assume(total > 1e-6)
        answers.append(resultant(force, factor, pull))
    assert math.remainder(answers[1] - answers[0] - turn, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)


@settings(max_examples=100)
@given(st.floats(-1.0, 1.0), st.floats(0.0, 1.0))
def test_the_damped_force_is_never_more_than_the_whole_and_never_pulls(cosine, weight):
    assert 0.0 <= damping_factor(cosine, weight, False) <= 1.0 + 1e-12
