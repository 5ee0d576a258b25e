"""HIMM on cells that can be counted by hand."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_avoidance.certainty import new_window, place_beams, scroll_window
from navloom_avoidance.himm import count_readings, vote_line

CELL, SIZE = 0.1, 41
CENTRE = (0.05, 0.05, 0.0)  # the middle of cell (0, 0), which is the middle of the window


def insert(window, beams, pose=CENTRE, margin=0.0, depth=0.0, times=1):
    """Beams are rows of bearing in degrees and range; origin at the base, half angle 15 degrees, limits 0.3 and 4 m."""
    rows = np.array(beams, float)
    n = len(rows)
    limits = np.tile([0.3, 4.0], (n, 1))
    scroll_window(*window, pose[0], pose[1], CELL)
    placed = place_beams(
        pose, np.zeros((n, 2)), np.radians(rows[:, 0]), np.full(n, 0.26), rows[:, 1].copy(), limits, margin, 3.0
    )
    for _ in range(times):
        count_readings(*window, CELL, placed, limits, depth, 3, 1, np.zeros((SIZE, SIZE), np.uint8))


def filled(certainty):
    window = new_window(SIZE)
    window[0][:], window[1][:] = certainty, -20
    return window


def at(window, x, y):
    grid, origin = window
    return int(grid[math.floor(y / CELL) - origin[1], math.floor(x / CELL) - origin[0]])


def test_one_cell_is_counted_for_a_reading_however_wide_the_cone():
    window = new_window(SIZE)
    insert(window, [[0.0, 1.0]])
    assert at(window, 1.05, 0.05) == 3
    assert window[0].sum() == 3


def test_certainty_grows_by_three_up_to_fifteen():
    window = new_window(SIZE)
    seen = []
    for _ in range(7):
        insert(window, [[0.0, 1.0]])
        seen.append(at(window, 1.05, 0.05))
    assert seen == [3, 6, 9, 12, 15, 15, 15]


def test_cells_of_the_axis_before_the_echo_shrink_by_one_and_no_others():
    window = filled(5)
    insert(window, [[0.0, 1.0]])
    assert [at(window, x, 0.05) for x in (0.05, 0.55, 0.95)] == [4, 4, 4]
    assert at(window, 1.05, 0.05) == 8
    assert at(window, 1.15, 0.05) == 5  # behind the echo
    assert at(window, 0.55, 0.15) == 5  # in the cone, off the axis


def test_no_echo_shrinks_the_axis_to_the_end_of_the_window_and_never_below_zero():
    window = filled(1)
    insert(window, [[90.0, math.inf]], times=3)
    assert [at(window, 0.05, y) for y in (0.15, 1.05, 2.05)] == [0, 0, 0]
    assert (window[0] == 0).sum() == 21


def test_an_echo_beyond_range_max_counts_as_no_echo():
    window = filled(5)
    insert(window, [[0.0, 4.5]])
    assert at(window, 1.95, 0.05) == 4
    assert window[0].max() == 5


def test_two_beams_in_one_cell_count_once_and_an_echo_wins_over_a_beam_that_passes():
    window = filled(5)
    insert(window, [[0.0, 1.0], [1.0, 1.0], [0.0, 1.5]])
    assert at(window, 1.05, 0.05) == 8
    assert at(window, 0.55, 0.05) == 4


def test_a_margin_before_the_echo_is_not_counted_down():
    window = filled(5)
    insert(window, [[0.0, 1.0]], margin=0.2)
    assert [at(window, x, 0.05) for x in (0.85, 0.95)] == [4, 5]


def test_a_reading_at_range_min_counts_the_depth_before_it_and_clears_nothing():
    for depth, value in ((0.0, 2), (0.1, 5)):
        window = filled(2)
        insert(window, [[0.0, 0.3]], depth=depth)
        assert at(window, 0.35, 0.05) == 5
        assert at(window, 0.25, 0.05) == value
        assert at(window, 0.15, 0.05) == 2


@settings(max_examples=100)
@given(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(-math.pi, math.pi), st.floats(0.0, 1.5))
def test_every_cell_a_line_crosses_is_marked_and_no_other(x, y, bearing, far):
    votes, axis = np.zeros((SIZE, SIZE), np.uint8), (math.cos(bearing), math.sin(bearing))
    vote_line(votes, np.array([-20, -20]), CELL, (x, y), axis, far)
    rows, columns = np.nonzero(votes)
    # A cell that is crossed: its nearest point to the line's middle piece lies within half a diagonal of the line.
    centres = (np.column_stack((columns, rows)) - 20 + 0.5) * CELL - (x, y)
    along = np.clip(centres @ axis, 0.0, far)
    off = np.abs(centres - along[:, None] * axis).max(axis=1)
    assert (off <= 0.5 * CELL * math.sqrt(2.0) + 1e-9).all()
    for distance in np.arange(0.0, far, 0.003):
        c, r = (math.floor((p + distance * a) / CELL) + 20 for p, a in zip((x, y), axis, strict=True))
        near_border = min(abs((p + distance * a) / CELL % 1.0 - 0.5) for p, a in zip((x, y), axis, strict=True)) > 0.499
        assert votes[r, c] or near_border


@settings(max_examples=50)
@given(st.permutations(range(5)), st.lists(st.floats(0.35, 1.8), min_size=5, max_size=5), st.floats(-3.0, 3.0))
def test_answer_does_not_depend_on_the_order_of_the_beams(order, ranges, heading):
    beams = [[bearing, r] for bearing, r in zip((-6.0, -3.0, 0.0, 3.0, 90.0), ranges, strict=True)]
    grids = []
    for rows in (beams, [beams[i] for i in order]):
        window = filled(4)
        insert(window, rows, pose=(0.05, 0.05, heading))
        grids.append(window[0])
    np.testing.assert_array_equal(grids[0], grids[1])


@pytest.mark.parametrize("times", [1, 20])
def test_certainty_stays_within_its_bounds(times):
    window = filled(1)
    insert(window, [[b, 0.5 + 0.01 * b] for b in range(0, 90, 2)], times=times)
    assert window[0].max() <= 15
