"""The window of nearest obstacles against brute force, and the points of bodies."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_mppi.nearest import body_points, fill_nearest, gap_beside

SIZE, CELL = 40, 0.1


def filled(obstacles, reach):
    nearest, squares = np.zeros((SIZE, SIZE), np.int32), np.zeros((SIZE, SIZE), np.float32)
    fill_nearest(obstacles, CELL, reach, nearest, squares)
    return nearest, squares


@settings(max_examples=30)
@given(st.lists(st.tuples(st.floats(-2.5, 2.5), st.floats(-2.5, 2.5)), min_size=1, max_size=20), st.floats(0.2, 1.5))
def test_within_reach_it_is_the_nearest_of_all(points, reach):
    obstacles = np.column_stack([np.array(points), np.full(len(points), 0.05)])
    nearest, squares = filled(obstacles, reach)
    centres = (np.arange(SIZE) + 0.5) * CELL - 0.5 * SIZE * CELL
    x, y = np.meshgrid(centres, centres)
    true = ((x[..., None] - obstacles[:, 0]) ** 2 + (y[..., None] - obstacles[:, 1]) ** 2).min(axis=-1)
    within = true < reach**2
    assert (nearest[within] >= 0).all()
    np.testing.assert_allclose(squares[within], true[within], atol=1e-5)


def test_without_obstacles_there_is_none():
    assert (filled(np.zeros((0, 3)), 1.0)[0] == -1).all()


@pytest.mark.parametrize(
    ("point", "gap"), [((1.0, 0.5), 0.5), ((-1.0, 0.0), 1.0), ((4.0, 2.0), 2.0 * 2**0.5), ((0.0, -0.2), 0.2)]
)
def test_the_gap_beside_a_straight_way_is_measured_to_it_and_to_its_ends(point, gap):
    assert gap_beside(np.array([[*point, 0.05], [9.0, 9.0, 0.05]]), (2.0, 0.0)) == pytest.approx(gap)


def test_a_way_of_no_length_is_a_point_and_without_obstacles_the_gap_is_infinite():
    assert gap_beside(np.array([[3.0, 4.0, 0.0]]), (0.0, 0.0)) == pytest.approx(5.0)
    assert gap_beside(np.zeros((0, 3)), (2.0, 0.0)) == np.inf


@pytest.mark.parametrize(
    ("size", "count", "radius"),
    [((0.8, 0.8), 1, 0.4 * 2**0.5), ((1.2, 0.4), 3, 0.2 * 2**0.5), ((0.3, 0.6), 2, 0.15 * 2**0.5)],
)
def test_discs_along_the_longer_side_cover_a_body(size, count, radius):
    x, y = 0.5 * size[0], 0.5 * size[1]
    points, disc = body_points(np.array([[x + 0.1, y], [-x + 0.1, y], [-x + 0.1, -y], [x + 0.1, -y]]))
    assert len(points) == count
    assert disc == pytest.approx(radius)
    assert points.mean(axis=0) == pytest.approx([0.1, 0.0])
