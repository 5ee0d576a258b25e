"""Split and merge on shapes with known lines."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_ipabd.lines import _distance_to_chord, distances_to_segments, extract_lines, fresh_segments


def one_object(points: np.ndarray, tolerance: float = 0.06) -> np.ndarray:
    return extract_lines(points, np.array([0, len(points)]), tolerance)


def test_a_corner_gives_its_two_walls() -> None:
    along = np.linspace(0.0, 2.0, 21)
    first = np.column_stack([along, np.zeros(21)])
    second = np.column_stack([np.full(20, 2.0), along[1:]])
    assert one_object(np.vstack([first, second])) == pytest.approx(
        np.array([[0.0, 0.0, 2.0, 0.0], [2.0, 0.0, 2.0, 2.0]])
    )


def test_total_least_squares_is_not_vertical_least_squares() -> None:
    # A vertical wall, points ±1 cm to its sides in turn: y on x regression has no answer, the wall is x = 3.
    y = np.linspace(-1.0, 1.0, 20)
    x = 3.0 + 0.01 * np.where(np.arange(20) % 2 == 0, 1.0, -1.0)
    segment = one_object(np.column_stack([x, y]))
    assert segment.shape == (1, 4)
    assert segment[0, [0, 2]] == pytest.approx([3.0, 3.0], abs=0.005)
    assert segment[0, [1, 3]] == pytest.approx([-1.0, 1.0], abs=1e-3)


def test_pieces_that_one_line_fits_are_merged() -> None:
    # The chord rises to 0.061 m, so that the middle lies 0.0605 m below it and splits; one line leaves at most 0.06.
    x = np.linspace(0.0, 10.0, 101)
    y = np.zeros(101)
    y[-1], y[50] = 0.061, -0.030
    assert len(one_object(np.column_stack([x, y]))) == 1


def test_a_spike_along_the_chord_is_not_lost() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.2, 0.0]])
    assert distances_to_segments(points, one_object(points)).max() == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("point", "distance"),
    [
        ((1.8, 5.1), 2.0),
        ((4.2, 1.9), 2.0),
        ((9.0, 8.0), 5.0),
        ((-3.0, -1.0), 5.0),
        ((1.0, 2.0), 0.0),
        ((5.0, 5.0), 0.0),
    ],
    ids=["left", "right", "beyond", "before", "first end", "second end"],
)
def test_distance_to_a_chord_by_hand(point, distance) -> None:
    """The chord from (1, 2) to (5, 5) is 5 m long; its middle is (3, 3.5), and (-0.6, 0.8) points to its left."""
    chord = np.array([1.0, 2.0]), np.array([5.0, 5.0])
    assert _distance_to_chord(*chord, np.array(point)) == pytest.approx(distance, abs=1e-12)


def test_objects_are_never_joined() -> None:
    x = np.array([0.0, 0.5, 1.0, 2.0, 2.5, 3.0])
    got = extract_lines(np.column_stack([x, np.zeros(6)]), np.array([0, 3, 6]), 0.06)
    assert got == pytest.approx(np.array([[0.0, 0.0, 1.0, 0.0], [2.0, 0.0, 3.0, 0.0]]))


def test_single_points_and_pairs_stay() -> None:
    points = np.array([[1.0, 2.0], [4.0, 0.0], [4.0, 0.1]])
    got = extract_lines(points, np.array([0, 1, 3]), 0.06)
    assert got == pytest.approx(np.array([[1.0, 2.0, 1.0, 2.0], [4.0, 0.0, 4.0, 0.1]]))


def test_no_points_no_segments() -> None:
    assert extract_lines(np.zeros((0, 2)), np.array([0]), 0.06).shape == (0, 4)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 60))
def test_every_point_is_near_a_segment(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.uniform(-0.3, 0.3, (count, 2)), axis=0)
    assert distances_to_segments(points, one_object(points)).max() <= 0.06 + 1e-9


@settings(max_examples=40, deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(0.3, 9.0))
def test_a_straight_wall_is_one_segment_from_end_to_end(direction: float, length: float) -> None:
    along = np.linspace(0.0, length, 30)[:, None] * [math.cos(direction), math.sin(direction)]
    got = one_object(along + np.array([2.0, -1.0]))
    assert got.shape == (1, 4)
    ends = np.array([2.0, -1.0, 2.0 + along[-1, 0], -1.0 + along[-1, 1]])
    assert got[0] == pytest.approx(ends, abs=1e-9)


def test_distance_to_segments_by_hand() -> None:
    segments = np.array([[0.0, 0.0, 2.0, 0.0], [5.0, 5.0, 5.0, 5.0]])
    assert distances_to_segments(np.array([[1.0, 0.5], [3.0, 0.0], [5.0, 4.0]]), segments) == pytest.approx([0.5, 1, 1])
    assert distances_to_segments(np.zeros((2, 2)), np.zeros((0, 4))).tolist() == [math.inf, math.inf]


def test_a_segment_seen_again_is_kept_once_and_a_longer_one_replaces_it() -> None:
    known = np.array([[0.0, 0.0, 1.0, 0.0], [9.0, 9.0, 9.0, 9.0]])
    again = fresh_segments(known, np.array([[0.1, 0.02, 0.9, 0.01]]), 0.06)
    assert again.tolist() == known.tolist()
    longer = fresh_segments(known, np.array([[-0.5, 0.0, 1.5, 0.01]]), 0.06)
    assert longer.tolist() == [[9.0, 9.0, 9.0, 9.0], [-0.5, 0.0, 1.5, 0.01]]
