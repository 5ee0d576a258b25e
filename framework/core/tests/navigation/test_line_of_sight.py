"""Line of sight and pruning."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from navloom.navigation.line_of_sight import is_segment_free, prune, simplify

WALL = np.ones((4, 6), np.bool_)
WALL[1, 2] = False
"""A grid with one blocked cell: x 2..3, y 1..2."""


def sees(cells, a, b, resolution=1.0, origin=(0.0, 0.0)):
    return is_segment_free(cells, resolution, *origin, *map(float, a), *map(float, b))


@pytest.mark.parametrize(
    ("a", "b", "free"),
    [
        ((0.5, 0.5), (5.5, 0.5), True),
        ((0.5, 1.5), (5.5, 1.5), False),
        ((0.5, 2.5), (5.5, 2.5), True),
        ((2.5, 3.5), (2.5, 0.5), False),
        ((1.5, 0.5), (3.5, 2.5), False),
        ((0.5, 1.5), (2.5, 3.5), True),
        ((1.5, 2.5), (2.5, 0.5), False),
        ((0.5, 0.5), (6.5, 0.5), False),
        ((0.5, 0.5), (0.5, -0.1), False),
        ((4.5, 3.5), (4.5, 3.5), True),
        ((2.5, 1.5), (2.5, 1.5), False),
    ],
)
def test_sight_beside_one_blocked_cell(a, b, free):
    assert sees(WALL, a, b) == sees(WALL, b, a) == free


def test_a_segment_through_the_corner_of_a_blocked_cell_is_blocked():
    assert not sees(WALL, (1.5, 1.5), (2.5, 2.5)), "touches the corner (2, 2)"
    assert sees(WALL, (1.4, 1.5), (2.4, 2.5)), "0.07 beside it"


def test_resolution_and_origin():
    assert not sees(WALL, (-9.75, 5.75), (-7.25, 5.75), 0.5, (-10.0, 5.0))
    assert sees(WALL, (-9.75, 5.25), (-7.25, 5.25), 0.5, (-10.0, 5.0))


grids = st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed).random((7, 9)) > 0.25)
coordinate = st.floats(0.0, 1.0)


@settings(max_examples=150, deadline=None)
@given(grids, coordinate, coordinate, coordinate, coordinate)
def test_sight_equals_clipping_the_segment_against_every_blocked_cell(cells, ax, ay, bx, by):
    a, b = (0.01 + 8.98 * ax, 0.01 + 6.98 * ay), (0.01 + 8.98 * bx, 0.01 + 6.98 * by)
    loose, tight = (
        any(_crosses(a, b, column, row, grown) for row, column in np.argwhere(~cells)) for grown in (2e-5, -2e-5)
    )
    if loose == tight:
        assert sees(cells, a, b) == (not loose)


def _crosses(a, b, column, row, grown):
    low, high = 0.0, 1.0
    for start, end, cell in ((a[0], b[0], column), (a[1], b[1], row)):
        first, last, run = cell - grown, cell + 1 + grown, end - start
        if abs(run) < 1e-12:
            if not first <= start <= last:
                return False
            continue
        t0, t1 = sorted(((first - start) / run, (last - start) / run))
        low, high = max(low, t0), min(high, t1)
    return low <= high


def test_open_space_is_crossed_in_one_line():
    path = np.array([[0.5, 0.5], [1.5, 1.5], [2.5, 2.5], [3.5, 2.5], [4.5, 2.5]])
    assert prune(path, np.ones((4, 6), np.bool_), 1.0, (0.0, 0.0)).tolist() == [[0.5, 0.5], [4.5, 2.5]]


def test_a_wall_keeps_the_one_corner_around_it():
    path = np.array([[1.5, 0.5], [1.5, 1.5], [1.5, 2.5], [2.5, 2.5], [3.5, 2.5], [3.5, 1.5], [3.5, 0.5]])
    blocked = WALL.copy()
    blocked[0, 2] = False
    pruned = prune(path, blocked, 1.0, (0.0, 0.0))
    assert pruned.tolist() == [[1.5, 0.5], [1.5, 2.5], [3.5, 2.5], [3.5, 0.5]]


@settings(max_examples=60, deadline=None)
@given(grids, st.lists(st.tuples(coordinate, coordinate), min_size=2, max_size=7, unique=True), st.floats(0.0, 0.5))
def test_no_chain_over_the_points_is_cheaper(cells, raw, corner_cost):
    points = np.array(raw) * [8.98, 6.98] + 0.01
    # Nearer than a micrometre, two points are one to `prune`.
    assume(all(math.dist(a, b) > 1e-5 for a, b in itertools.pairwise(points)))
    pruned = prune(points, cells, 1.0, (0.0, 0.0), corner_cost)
    count = len(points)

    def cost(chain):
        legs = list(itertools.pairwise(chain))
        if any(j - i > 1 and not sees(cells, points[i], points[j]) for i, j in legs):
            return math.inf
        return sum(math.dist(points[i], points[j]) + corner_cost for i, j in legs)

    chains = ((0, *inner, count - 1) for n in range(count) for inner in itertools.combinations(range(1, count - 1), n))
    found = sum(math.dist(*leg) + corner_cost for leg in itertools.pairwise(pruned))
    assert found == pytest.approx(min(map(cost, chains)), abs=1e-5)


def test_points_on_one_spot_count_once():
    path = np.array([[0.5, 0.5], [0.5, 0.5], [0.5, 0.5]])
    assert prune(path, np.ones((2, 2), np.bool_), 1.0, (0.0, 0.0)).tolist() == [[0.5, 0.5]]


def test_long_paths_keep_their_turning_points():
    along = np.arange(0.5, 500.0)
    path = np.concatenate(
        [np.column_stack([along, np.full(500, 0.5)]), np.column_stack([np.full(499, 499.5), along[1:]])]
    )
    cells = np.zeros((500, 500), np.bool_)
    cells[0, :] = cells[:, 499] = True
    assert prune(path, cells, 1.0, (0.0, 0.0)).tolist() == [[0.5, 0.5], [499.5, 0.5], [499.5, 499.5]]


def test_simplify_drops_a_staircase_within_the_tolerance_and_keeps_a_corner():
    stairs = [[0.05 * ((k + 1) // 2), 0.05 * (k // 2)] for k in range(40)]
    path = np.array([*stairs, [5.0, 0.95]])
    assert simplify(path, 0.04).tolist() == [stairs[0], stairs[38], [5.0, 0.95]]
    assert len(simplify(path, 0.001)) == 40
