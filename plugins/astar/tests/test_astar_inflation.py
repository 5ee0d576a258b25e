"""Inflation of obstacles, compared with the definition cell by cell."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_astar.inflation import circumscribed_radius, disc_reach, grow, inscribed_radius, square_reach
from numpy.typing import NDArray


def too_near(occupied: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """Cells whose centre is nearer than the radius, in cells, to the square of an occupied one, or in it."""
    rows, columns = np.indices(occupied.shape)
    near = occupied.copy()
    for r, c in np.argwhere(occupied):
        gap = np.hypot(np.maximum(abs(rows - r) - 0.5, 0.0), np.maximum(abs(columns - c) - 0.5, 0.0))
        near |= gap < radius - 1e-9
    return near


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32 - 1), st.tuples(st.integers(1, 25), st.integers(1, 25)), st.floats(0.0, 9.0))
def test_a_disc_reaches_cells_nearer_than_its_radius(seed: int, shape: tuple[int, int], radius: float) -> None:
    occupied = np.random.default_rng(seed).random(shape) < 0.03
    assert (grow(occupied, disc_reach(radius)) == too_near(occupied, radius)).all()


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.tuples(st.integers(1, 20), st.integers(1, 20)), st.integers(0, 5))
def test_a_square_reaches_as_many_cells_in_rows_as_in_columns(seed: int, shape: tuple[int, int], cells: int) -> None:
    occupied = np.random.default_rng(seed).random(shape) < 0.03
    padded = np.pad(occupied, cells)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * cells + 1, 2 * cells + 1))
    assert (grow(occupied, square_reach(cells)) == windows.any(axis=(2, 3))).all()


def test_obstacles_at_edges_and_corners_reach_as_far_as_others() -> None:
    """One or two obstacles anywhere on a mostly free grid, at its edges or not."""
    assert not grow(np.zeros((7, 9), dtype=np.bool_), disc_reach(2.6)).any()
    for n in range(63):
        for other in (n, 62 - n, 31):
            occupied = np.zeros(63, dtype=np.bool_)
            occupied[[n, other]] = True
            occupied = occupied.reshape(7, 9)
            assert (grow(occupied, disc_reach(2.6)) == too_near(occupied, 2.6)).all()


def test_sizes_by_hand() -> None:
    occupied = np.zeros((9, 9), dtype=np.bool_)
    occupied[4, 4] = True
    assert grow(occupied, square_reach(2)).sum() == 25
    assert grow(occupied, disc_reach(0.5)).sum() == 1  # the next centre is half a cell from the edge: touching is free
    assert grow(occupied, disc_reach(0.6)).sum() == 5  # diagonal centres are 0.707 away
    assert grow(occupied, disc_reach(0.8)).sum() == 9
    assert grow(occupied, disc_reach(2.0)).sum() == 21  # a 5 x 5 square without its corners: hypot(1.5, 1.5) = 2.12
    assert grow(occupied, disc_reach(0.0)).sum() == 1


def test_the_argument_is_not_changed() -> None:
    occupied = np.zeros((3, 3), dtype=np.bool_)
    for reach in (square_reach(0), square_reach(1)):
        grow(occupied, reach)[:] = True
    assert not occupied.any()


def test_radii_of_a_footprint() -> None:
    box = np.array([(0.5, 0.3), (-0.1, 0.3), (-0.1, -0.3), (0.5, -0.3)])
    assert inscribed_radius(box) == pytest.approx(0.1)
    assert circumscribed_radius(box) == pytest.approx(math.hypot(0.5, 0.3))
