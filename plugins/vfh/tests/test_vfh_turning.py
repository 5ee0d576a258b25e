"""Turning circles and the masked histogram of VFH+."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_vfh.turning import masked_histogram, turning_limits, turning_radius

N = 72
HERE = (0.0, 0.0, 0.0)


def limits(*cells, circle=1.0, radius=0.5, certainty=3.0, place=HERE):
    return turning_limits(np.array(cells, float).reshape(-1, 3), place, circle, radius, certainty)


def test_radius_is_speed_over_turn_rate():
    assert turning_radius(0.5, 0.25) == pytest.approx(2.0)
    assert turning_radius(0.0, 0.25) == 0.0
    assert turning_radius(-0.1, 0.25) == 0.0


def test_nothing_near_leaves_all_directions():
    assert limits() == (-math.pi, math.pi)
    assert limits([3.0, 0.3, 15.0]) == (-math.pi, math.pi)


def test_a_cell_in_the_left_circle_blocks_what_is_left_of_it():
    """The left circle is about (0, 1); (1, 1) is 1 m from it, less than 1.5 m, and 45 deg to the left."""
    assert limits([1.0, 1.0, 15.0]) == (-math.pi, pytest.approx(math.radians(45.0)))
    assert limits([1.0, -1.0, 15.0]) == (pytest.approx(math.radians(-45.0)), math.pi)


def test_the_cell_nearest_to_the_heading_counts():
    _, left = limits([1.0, 1.0, 15.0], [1.0, 0.5, 15.0], [0.5, 1.0, 15.0])
    assert left == pytest.approx(math.atan2(0.5, 1.0))


def test_a_cell_outside_the_circle_and_the_robots_radius_does_not_block():
    """(1.6, 1) is 1.6 m from (0, 1): beyond 1.5 m, within 1.7 m."""
    assert limits([1.6, 1.0, 15.0])[1] == math.pi
    assert limits([1.6, 1.0, 15.0], radius=0.7)[1] == pytest.approx(math.atan2(1.0, 1.6))


def test_a_stopped_robot_can_turn_past_obstacles_that_a_moving_one_cannot():
    assert limits([1.0, 1.0, 15.0], circle=0.0) == (-math.pi, math.pi)


def test_cells_of_little_certainty_do_not_block():
    assert limits([1.0, 1.0, 3.0]) == (-math.pi, math.pi)
    assert limits([1.0, 1.0, 4.0])[1] < math.pi


@settings(max_examples=60, deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-math.pi, math.pi))
def test_limits_belong_to_the_robot_wherever_it_is(x, y, theta):
    c, s = math.cos(theta), math.sin(theta)
    there = [[x + c * a - s * b, y + s * a + c * b, 15.0] for a, b in ((1.0, 1.0), (0.9, -0.4))]
    assert limits(*there, place=(x, y, theta)) == pytest.approx(limits([1.0, 1.0, 15.0], [0.9, -0.4, 15.0]))


def test_mask_keeps_the_free_sectors_between_the_limits():
    """Heading 90 deg, 20 deg to the right and 30 to the left: 70..120 deg, sectors 14..23, less the blocked 16."""
    blocked, masked = np.zeros(N), np.empty(N)
    blocked[16] = 1.0
    masked_histogram(blocked, math.radians(90.0), math.radians(-20.0), math.radians(30.0), masked)
    np.testing.assert_array_equal(np.flatnonzero(masked == 0.0), [14, 15, *range(17, 24)])


def test_the_sector_of_the_heading_is_never_masked_but_may_be_blocked():
    blocked, masked = np.zeros(N), np.empty(N)
    masked_histogram(blocked, math.radians(91.0), 0.0, 0.0, masked)
    np.testing.assert_array_equal(np.flatnonzero(masked == 0.0), [18])
    blocked[18] = 1.0
    masked_histogram(blocked, math.radians(91.0), 0.0, 0.0, masked)
    assert masked.all()


@pytest.mark.parametrize(("limit_deg", "free"), [(135.0, [0, 1, 2, 3]), (134.9, [0, 3])])
def test_a_sector_whose_direction_is_the_limit_is_free(limit_deg, free):
    """Four sectors, heading 0: their directions are 45, 135, -135 and -45 deg."""
    limit, masked = limit_deg / 180.0 * math.pi, np.empty(4)
    masked_histogram(np.zeros(4), 0.0, -limit, limit, masked)
    np.testing.assert_array_equal(np.flatnonzero(masked == 0.0), free)
