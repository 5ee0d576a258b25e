"""Segments to cells."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_astar.raster import draw_segments
from scipy import ndimage

COORDINATE = st.floats(-0.4, 19.4)


def drawn(*segments: tuple[float, float, float, float], shape=(8, 8), **options) -> list[tuple[int, int]]:
    occupied = np.zeros(shape, dtype=np.bool_)
    draw_segments(occupied, np.array(segments, dtype=np.float64).reshape(-1, 4), **options)
    return [tuple(cell) for cell in np.argwhere(occupied).tolist()]


def test_by_hand() -> None:
    assert drawn((1.0, 2.0, 3.0, 2.0)) == [(2, 1), (2, 2), (2, 3)]
    assert drawn((1.0, 1.0, 3.0, 3.0)) == [(1, 1), (2, 2), (3, 3)]  # other centres are 0.707 away
    assert drawn((1.0, 1.0, 3.0, 3.0), method="supercover") == [
        (1, 1), (1, 2), (2, 1), (2, 2), (2, 3), (3, 2), (3, 3),
    ]  # fmt: skip
    assert drawn((2.0, 3.0, 2.0, 3.0)) == [(3, 2)]  # a post
    assert drawn((2.45, 3.45, 2.45, 3.45)) == [(3, 2)]  # a post between four centres, 0.64 from the nearest


def test_a_segment_that_ends_on_an_edge_does_not_fill_the_next_cell() -> None:
    for method in ("distance", "supercover"):
        assert drawn((1.5, 2.0, 3.5, 2.0), method=method) == [(2, 2), (2, 3)]


def test_a_segment_along_an_edge_fills_both_sides() -> None:
    for method in ("distance", "supercover"):
        assert drawn((1.5, 0.7, 1.5, 2.3), method=method) == [(1, 1), (1, 2), (2, 1), (2, 2)]


def test_segments_outside_the_grid_are_left_out() -> None:
    assert drawn((-9.0, 3.0, 1.0, 3.0)) == [(3, 0), (3, 1)]
    assert drawn((-9.0, -9.0, -3.0, -3.0)) == []


@settings(max_examples=150, deadline=None)
@given(COORDINATE, COORDINATE, COORDINATE, COORDINATE)
def test_distance_and_supercover_agree_with_their_definitions(x1: float, y1: float, x2: float, y2: float) -> None:
    rows, columns = np.indices((20, 20))
    share = np.linspace(0.0, 1.0, 601)[:, None, None]
    x, y = abs(x1 + share * (x2 - x1) - columns), abs(y1 + share * (y2 - y1) - rows)
    distance, chessboard = np.hypot(x, y).min(axis=0), np.maximum(x, y).min(axis=0)
    slack = math.dist((x1, y1), (x2, y2)) / 600 + 1e-5  # of the sampling
    near, touched = np.zeros((2, 20, 20), dtype=np.bool_)
    draw_segments(near, np.array([[x1, y1, x2, y2]]))
    draw_segments(touched, np.array([[x1, y1, x2, y2]]), "supercover")
    ends = np.zeros((20, 20), dtype=np.bool_)
    for column, row in ((x1, y1), (x2, y2)):
        ends |= (abs(columns - column) <= 0.5 + 1e-5) & (abs(rows - row) <= 0.5 + 1e-5)
    assert near[distance <= 0.5 - slack].all() and not near[(distance > 0.5 + slack) & ~ends].any()
    assert touched[chessboard <= 0.5 - slack].all() and not touched[chessboard > 0.5 + slack].any()


@settings(max_examples=200, deadline=None)
@given(COORDINATE, COORDINATE, st.sampled_from(["distance", "supercover"]))
def test_a_wall_from_side_to_side_is_closed(left: float, right: float, method: str) -> None:
    occupied = np.zeros((20, 20), dtype=np.bool_)
    draw_segments(occupied, np.array([[-1.0, left, 20.0, right]]), method)
    occupied = np.pad(occupied, ((1, 1), (0, 0)))  # a row below and one above any wall
    parts, _ = ndimage.label(~occupied)
    assert parts[0, 0] != parts[-1, 0]


def test_the_printed_slope_test() -> None:
    """|m/n - 1| <= 0.2 for a segment from (0, 0) to (2, 2), far beyond its end; the row n = 0 is bounded (repaired)."""
    cells = drawn((0.0, 0.0, 2.0, 2.0), shape=(7, 7), method="paper", paper_t=0.2)
    expected = {(n, m) for n in range(1, 7) for m in range(7) if abs(m / n - 1.0) <= 0.2} | {(0, 0), (0, 1), (0, 2)}
    assert set(cells) == expected and (6, 5) in expected
    assert drawn((1.0, 2.0, 4.0, 2.0), method="paper") == [(2, 1), (2, 2), (2, 3), (2, 4)]
    assert {m for _, m in drawn((3.0, 1.0, 3.0, 2.0), method="paper", paper_t=1.0)} == {2, 3, 4}


def test_the_printed_test_takes_both_rows_beside_a_level_segment_and_half_a_cell_beyond_its_ends() -> None:
    assert drawn((1.5, 2.5, 3.5, 2.5), method="paper") == [
        (2, 1),
        (2, 2),
        (2, 3),
        (2, 4),
        (3, 1),
        (3, 2),
        (3, 3),
        (3, 4),
    ]


@pytest.mark.parametrize("method", ["distance", "supercover", "paper"])
def test_the_order_of_the_ends_does_not_matter_where_it_should_not(method: str) -> None:
    there, back = (1.2, 2.0, 5.7, 2.0), (5.7, 2.0, 1.2, 2.0)
    assert drawn(there, method=method) == drawn(back, method=method)
