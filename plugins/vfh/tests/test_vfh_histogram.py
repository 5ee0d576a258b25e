"""Polar histograms of VFH and VFH+: numbers that can be checked by hand."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_vfh.histogram import (
    binary_histogram,
    enlargement_angle,
    linear_magnitude,
    polar_histogram,
    quadratic_magnitude,
)

N = 72
ALPHA = 2.0 * math.pi / N
HERE = (0.0, 0.0)


def histogram(cells, radius=0.0, reach=2.0, horizon=math.inf, is_quadratic=False, place=HERE, heading=0.0):
    density = np.empty(N)
    polar_histogram(np.array(cells, float), place, heading, radius, reach, horizon, is_quadratic, density)
    return density


def test_linear_magnitude_is_the_square_of_the_certainty_and_falls_to_zero_at_the_reach():
    """c = 15 of 15 half way: 1 - 1/2. c = 6: (6/15)^2 = 0.16 of it."""
    assert linear_magnitude(15.0, 1.0, 2.0) == pytest.approx(0.5)
    assert linear_magnitude(6.0, 1.0, 2.0) == pytest.approx(0.08)
    assert linear_magnitude(15.0, 0.0, 2.0) == pytest.approx(1.0)
    assert linear_magnitude(15.0, 2.0, 2.0) == 0.0


def test_quadratic_magnitude_falls_with_the_square_of_the_distance():
    """Half way: 1 - 1/4. c = 6: (6/15)^2 = 0.16 of it."""
    assert quadratic_magnitude(15.0, 1.0, 2.0) == pytest.approx(0.75)
    assert quadratic_magnitude(6.0, 1.0, 2.0) == pytest.approx(0.12)
    assert quadratic_magnitude(15.0, 2.5, 2.0) == 0.0


def test_enlargement_is_the_arcsine_of_radius_over_distance():
    assert enlargement_angle(1.0, 0.5) == pytest.approx(math.radians(30.0))
    assert enlargement_angle(0.4, 0.5) == pytest.approx(math.radians(90.0))
    assert enlargement_angle(1.0, 0.0) == 0.0


def test_a_point_robot_sums_the_cells_of_one_sector():
    """Both at 32 and 33 deg, in sector 6: 0.5 and, of certainty 6 and at 1.5 m, 0.16 * 0.25 = 0.04."""
    near, far = math.radians(32.0), math.radians(33.0)
    cells = [[math.cos(near), math.sin(near), 15.0], [1.5 * math.cos(far), 1.5 * math.sin(far), 6.0]]
    density = histogram(cells)
    assert density[6] == pytest.approx(0.54)
    assert np.count_nonzero(density) == 1


def test_a_robot_of_half_a_metre_is_blocked_for_thirty_degrees_to_either_side():
    """Cell 1 m ahead: gamma = 30 deg, six sectors each way from the edge between sectors 71 and 0; 1 - 1/4 in each."""
    density = histogram([[1.0, 0.0, 15.0]], radius=0.5, is_quadratic=True)
    np.testing.assert_array_equal(np.flatnonzero(density), [*range(6), *range(66, 72)])
    np.testing.assert_allclose(density[density > 0.0], 0.75)


def test_blocked_directions_of_several_cells_add_up():
    density = histogram([[1.0, 0.0, 15.0], [0.0, 1.0, 15.0]], radius=0.8, is_quadratic=True)
    assert density[9] == pytest.approx(1.5)  # 47.5 deg is within 53 deg of both
    assert density[0] == pytest.approx(0.75)


def test_cells_beyond_the_horizon_do_not_count():
    assert histogram([[1.2, 0.0, 15.0]], horizon=1.1).sum() == 0.0
    assert histogram([[1.2, 0.0, 15.0]], horizon=1.3).sum() > 0.0


def test_from_another_place_the_cell_is_nearer_and_elsewhere():
    """From (1, -1) the cell at (1, 0) is 1 m off, straight to the left."""
    density = histogram([[1.0, 0.02, 15.0]], place=(1.02, -0.98))
    assert density[18] == pytest.approx(1.0 - math.hypot(0.02, 1.0) / 2.0)


Cells = st.lists(
    st.tuples(st.integers(0, N - 1), st.floats(0.5, 1.9), st.sampled_from([1, 3, 6, 15])), min_size=1, max_size=12
)


def placed(rows, turn=0):
    """Cells in the middle of sectors, turned by whole sectors."""
    angle = np.array([(k + 0.5 + turn) * ALPHA for k, _, _ in rows])
    distance = np.array([d for _, d, _ in rows])
    certainty = np.array([float(c) for _, _, c in rows])
    return np.column_stack((distance * np.cos(angle), distance * np.sin(angle), certainty))


@settings(max_examples=60, deadline=None)
@given(Cells, st.integers(-N, N), st.booleans())
def test_turning_the_robot_leaves_the_histogram_of_the_pose_frame_alone(rows, turn, is_quadratic):
    here = histogram(placed(rows), 0.463, is_quadratic=is_quadratic)
    there = histogram(placed(rows, -turn), 0.463, is_quadratic=is_quadratic, heading=turn * ALPHA)
    np.testing.assert_allclose(there, here, atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(Cells, st.floats(0.0, 0.6), st.floats(0.0, 0.4))
def test_a_wider_robot_is_never_blocked_less(rows, radius, more):
    assert (histogram(placed(rows), radius + more) >= histogram(placed(rows), radius) - 1e-12).all()


def test_binary_histogram_has_hysteresis():
    """Rising through 0.3 and 0.5 it blocks at 0.5; falling through 0.3 and 0.1 it is free at 0.1."""
    blocked, states = np.zeros(1), []
    for density in (0.1, 0.3, 0.5, 0.3, 0.1):
        binary_histogram(np.array([density]), 0.2, 0.4, blocked)
        states.append(blocked[0])
    assert states == [0.0, 0.0, 1.0, 1.0, 0.0]
