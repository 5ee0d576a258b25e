"""Polar histogram, enlargement, slots and candidates on numbers that can be checked by hand."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_avoidance.histogram import (
    cell_magnitude,
    enlarged_density,
    free_slots,
    sector_density,
    slot_directions,
    smooth,
    smoothing_gain,
    window_reach,
)

N = 72
ALPHA = 2.0 * math.pi / N
Cells = st.lists(
    st.tuples(st.integers(0, N - 1), st.floats(0.2, 0.45), st.floats(0.3, 1.9), st.sampled_from([2.0, 3.0])),
    min_size=1,
    max_size=12,
)


def place(rows, turn=0):
    """Cells given by sector, share of the sector, distance and certainty, turned by whole sectors."""
    return np.array(
        [[d * math.cos((k + s + turn) * ALPHA), d * math.sin((k + s + turn) * ALPHA), c] for k, s, d, c in rows]
    )


def blocked(*sectors):
    density = np.zeros(N)
    density[list(sectors)] = 1.0
    return density


def slots_of(density, threshold=0.5):
    slots = np.zeros((N // 2 + 1, 2), np.int64)
    return slots, free_slots(density, threshold, slots)


def candidates(density, target, widest=18, inset=9.0):
    slots, count = slots_of(density)
    out = np.zeros(3 * (N // 2 + 1))
    return np.degrees(out[: slot_directions(slots, count, N, widest, inset, target, out)])


def test_magnitude_is_c_squared_times_a_minus_b_d():
    assert cell_magnitude(3.0, 0.0, 2.0) == 1.0
    assert cell_magnitude(3.0, 1.0, 2.0) == 0.5
    assert cell_magnitude(2.0, 1.0, 2.0) == pytest.approx(4.0 / 9.0 * 0.5)
    assert cell_magnitude(3.0, 2.0, 2.0) == 0.0


def test_plain_density_is_the_sum_in_the_sector():
    density = np.zeros(N)
    sector_density(place([(4, 0.5, 1.0, 3.0), (4, 0.4, 1.0, 2.0)]), 0.0, 0.1, 2.0, False, density)
    assert density[4] == pytest.approx(0.5 + 0.5 * 4.0 / 9.0)
    assert density.sum() == pytest.approx(density[4])


@pytest.mark.parametrize("per_arc_cell", [True, False])
def test_full_arc_weighs_by_its_distance_and_not_by_its_cells_only_when_normalised(per_arc_cell):
    """From 1.2 to 3.5 m the plain sum of a full ring grows with its cells; normalised it falls with distance."""
    means = []
    for distance in (1.2, 2.0, 2.8, 3.5):
        count = round(2.0 * math.pi * distance / 0.1)
        ring = np.array(
            [[distance * math.cos(t), distance * math.sin(t), 2.0] for t in np.arange(count) * 2 * math.pi / count]
        )
        density = np.zeros(N)
        sector_density(ring, 0.0, 0.1, 8.0, per_arc_cell, density)
        means.append(density.mean())
    assert (np.diff(means) < 0.0).all() == per_arc_cell


def test_smoothing_divides_by_2_l_plus_1_and_spreads_one_sector_as_a_triangle():
    """l = 5: the weights 1, 2, ..., 6, ..., 2, 1 sum to 36, and VFH divides by 11."""
    smoothed = np.zeros(N)
    smooth(np.full(N, 0.7), 5, smoothed)
    np.testing.assert_allclose(smoothed, 0.7 * 36.0 / 11.0)
    smooth(blocked(0), 5, smoothed)
    np.testing.assert_allclose(smoothed[[0, 1, 5, 6, 67]], np.array([6, 5, 1, 0, 1]) / 11.0)


def test_gain_is_the_level_after_smoothing_of_one_sector_and_of_all():
    for half_width in (0, 1, 5):
        for is_enlarged, rough in ((False, blocked(7)), (True, np.ones(N))):
            smoothed = np.zeros(N)
            smooth(rough, half_width, smoothed)
            assert smoothed[7] == pytest.approx(smoothing_gain(half_width, is_enlarged))


def test_reach_of_the_window_ends_in_the_middle_of_its_corner_cell():
    """33 cells of 0.1 m: 16 cells to the side and 16 ahead."""
    assert window_reach(33, 0.1) == pytest.approx(math.hypot(1.6, 1.6))


def test_enlargement_shades_arcsin_of_radius_over_distance():
    """A cell 1 m ahead and a radius of 0.5 m: 30 degrees to either side, six sectors each way from sector 0's edge."""
    density = np.zeros(N)
    enlarged_density(np.array([[1.0, 0.0, 3.0]]), 0.0, 0.5, 2.0, density)
    np.testing.assert_array_equal(np.flatnonzero(density), [*range(6), *range(66, 72)])
    assert density[0] == 0.5


def test_cell_nearer_than_the_radius_shades_a_half_circle():
    density = np.zeros(N)
    enlarged_density(np.array([[0.0, 0.4, 2.0]]), 0.0, 0.5, 2.0, density)
    np.testing.assert_array_equal(np.flatnonzero(density), range(36))


@settings(max_examples=100, deadline=None)
@given(Cells, st.integers(-N, N), st.booleans())
def test_turning_the_world_by_sectors_turns_the_histogram(rows, turn, shaded):
    here, there = np.zeros(N), np.zeros(N)
    for turned, density in ((0, here), (turn, there)):
        if shaded:
            enlarged_density(place(rows, turned), 0.0, 0.45 + 1e-3 * math.pi, 2.0, density)
        else:
            sector_density(place(rows, turned), 0.0, 0.1, 2.0, True, density)
    np.testing.assert_allclose(there, np.roll(here, turn), atol=1e-9)


@settings(max_examples=100, deadline=None)
@given(Cells, st.integers(-N, N))
def test_histogram_is_in_the_pose_frame(rows, turn):
    """Turning the robot one way and the cells in its base frame the other way does not change the histogram."""
    here, there = np.zeros(N), np.zeros(N)
    enlarged_density(place(rows), 0.0, 0.453, 2.0, here)
    enlarged_density(place(rows, -turn), turn * ALPHA, 0.453, 2.0, there)
    np.testing.assert_allclose(there, here, atol=1e-9)


def test_slots_are_runs_around_the_circle():
    slots, count = slots_of(blocked(3, 10, 11))
    assert [tuple(slot) for slot in slots[:count]] == [(4, 6), (12, 63)]
    slots, count = slots_of(np.zeros(N))
    assert (count, *slots[0]) == (1, 0, N)
    assert slots_of(np.ones(N))[1] == 0


def test_narrow_slot_is_steered_through_midway():
    assert candidates(blocked(*range(6), *range(16, N)), 0.0) == pytest.approx([55.0])


def test_wide_slot_gives_half_s_max_from_each_edge_and_the_target_between():
    wall = blocked(*range(30, 42))  # slot from 210 to 510 degrees
    assert candidates(wall, math.radians(0.0)) == pytest.approx([255.0, 465.0, 0.0])
    assert candidates(wall, math.radians(140.0)) == pytest.approx([255.0, 465.0])


def test_open_space_is_steered_straight_at_the_target():
    assert candidates(np.zeros(N), math.radians(-123.0)) == pytest.approx([-123.0])


@settings(max_examples=100, deadline=None)
@given(st.sets(st.integers(0, N - 1), min_size=1, max_size=40), st.integers(0, N - 1), st.integers(0, 71))
def test_turning_histogram_and_target_turns_the_candidates(sectors, turn, target):
    def points(angles):
        return sorted((round(math.cos(a), 6) + 0.0, round(math.sin(a), 6) + 0.0) for a in np.radians(angles))

    goal = (target + 0.37) * ALPHA
    here = candidates(blocked(*sectors), goal) + math.degrees(turn * ALPHA)
    there = candidates(blocked(*((k + turn) % N for k in sectors)), goal + turn * ALPHA)
    assert len(here) == len(there)
    np.testing.assert_allclose(points(here), points(there), atol=1e-5)
