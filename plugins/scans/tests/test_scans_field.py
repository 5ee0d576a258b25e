"""The distance field: distances to the surfaces of the squares, not to their centres."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_scans.field import distance_field, sample

CELL = 0.1


def one_square(origin=(0.0, 0.0, 0.0), reach=1.0):
    """A raster of 8 x 8 cells with the square from 0.3 to 0.4 m in x and from 0.4 to 0.5 m in y."""
    occupied = np.zeros((8, 8), dtype=np.bool_)
    occupied[4, 3] = True
    return distance_field(occupied, CELL, origin, reach)


@pytest.mark.parametrize(
    ("x", "y", "expected"),
    [(0.35, 0.45, -0.05), (0.4, 0.47, 0.0), (0.6, 0.45, 0.2), (0.35, 0.1, 0.3), (0.7, 0.1, math.hypot(0.3, 0.3))],
)
def test_distance_is_to_the_squares_surface_and_negative_within(x, y, expected):
    field = one_square()
    assert sample(field.values, field.frame, x, y)[0] == pytest.approx(expected, abs=1e-6)


@given(st.floats(0.0, 1.0), st.sampled_from(["left", "right", "lower", "upper"]))
def test_distance_is_zero_on_the_whole_outline(share, side):
    x, y = {"left": (0.3, 0.4 + CELL * share), "right": (0.4, 0.4 + CELL * share),
            "lower": (0.3 + CELL * share, 0.4), "upper": (0.3 + CELL * share, 0.5)}[side]  # fmt: skip
    field = one_square()
    assert abs(sample(field.values, field.frame, x, y)[0]) < 1e-6


def test_gradient_points_away_from_the_wall_in_the_map_frame():
    # The raster is turned by 90°: its x axis is the map's y axis.
    field = one_square((1.0, 2.0, 0.5 * math.pi))
    distance, gx, gy, known = sample(field.values, field.frame, 1.0 - 0.45, 2.0 + 0.62)
    assert known
    assert (distance, gx, gy) == pytest.approx((0.22, 0.0, 1.0), abs=1e-5)


@given(st.floats(-math.pi, math.pi), st.floats(0.02, 0.25), st.floats(0.05, 0.95))
def test_gradient_turns_with_the_raster(heading, away, share):
    # Off the square's right side the gradient is the raster's x axis, and off its upper side the y axis. Past the
    # side's ends the nearest point is a corner: the gradient turns there.
    field, c, s = one_square((1.0, 2.0, heading)), math.cos(heading), math.sin(heading)
    for x, y, expected in ((0.4 + away, 0.4 + 0.1 * share, (c, s)), (0.3 + 0.1 * share, 0.5 + away, (-s, c))):
        distance, gx, gy, _ = sample(field.values, field.frame, 1.0 + c * x - s * y, 2.0 + s * x + c * y)
        assert distance == pytest.approx(away, abs=1e-6)
        assert (gx, gy) == pytest.approx(expected, abs=1e-4)


@settings(max_examples=50)
@given(st.integers(0, 2**25 - 1))
def test_nodes_agree_with_the_nearest_square_by_trial(bits):
    occupied = np.array([bits >> k & 1 for k in range(25)], dtype=np.bool_).reshape(5, 5)
    field = distance_field(occupied, CELL, (0.0, 0.0, 0.0), 0.25)
    for row, column in ((0, 0), (3, 7), (5, 5), (10, 4), (6, 8)):
        x, y = 0.5 * CELL * column, 0.5 * CELL * row
        assert field.values[row, column] == pytest.approx(
            _by_trial(occupied, x, y) - _by_trial(~occupied, x, y), abs=1e-6
        )


def _by_trial(cells, x, y):
    r, c = np.nonzero(cells)
    dx = np.maximum(np.maximum(c * CELL - x, x - (c + 1) * CELL), 0.0)
    dy = np.maximum(np.maximum(r * CELL - y, y - (r + 1) * CELL), 0.0)
    return min(0.25, np.hypot(dx, dy).min(initial=0.25))


def test_outside_the_raster_nothing_is_known():
    field = one_square()
    assert not sample(field.values, field.frame, -0.01, 0.4)[3]
    assert not sample(field.values, field.frame, 0.4, 0.81)[3]


def test_the_field_cannot_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        one_square().values[0, 0] = 0.0
