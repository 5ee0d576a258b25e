"""Line of sight and the cost of ground, by hand and compared with other computations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom.navigation.line_of_sight import is_segment_free
from navloom_theta_star.sight import ground_cost, is_in_sight
from theta_oracles import is_touched


def sees(wall: np.ndarray, a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Line of sight in a picture without border; places are x, y."""
    return bool(is_in_sight(np.pad(wall, 1, constant_values=True), *(value + 1.0 for value in (*a, *b))))


def test_a_corner_is_not_cut() -> None:
    wall = np.array([[0, 1, 0], [0, 0, 0]], dtype=np.bool_)
    assert sees(wall, (0.5, 1.5), (2.5, 1.5))
    assert not sees(wall, (0.5, 0.5), (1.5, 1.5))  # touches the wall's corner at (1, 1)
    assert not sees(wall, (0.5, 0.5), (2.5, 1.5))


def test_a_line_through_a_corner_touches_all_four_cells() -> None:
    """From (0.5, 0.5) to (3.5, 1.5) at y = 1 it is at x = 2: between the columns 1 and 2."""
    for blocked in ((0, 1), (0, 2), (1, 1), (1, 2)):
        wall = np.zeros((2, 4), dtype=np.bool_)
        assert sees(wall, (0.5, 0.5), (3.5, 1.5))
        wall[blocked] = True
        assert not sees(wall, (0.5, 0.5), (3.5, 1.5))


def test_outside_the_grid_there_is_no_line_of_sight() -> None:
    wall = np.zeros((2, 2), dtype=np.bool_)
    assert sees(wall, (0.5, 0.5), (1.5, 0.5)) and not sees(wall, (0.5, 0.0), (1.5, 0.5))


def test_it_agrees_with_exact_arithmetic_and_with_the_pruning_of_the_framework() -> None:
    rng, seen = np.random.default_rng(2), 0
    for _ in range(40):
        wall = rng.random((12, 15)) < rng.choice([0.03, 0.1, 0.2])
        cells = np.argwhere(~wall)
        for a, b in cells[rng.integers(len(cells), size=(25, 2))]:
            ends = (a[1] + 0.5, a[0] + 0.5), (b[1] + 0.5, b[0] + 0.5)
            expected = not is_touched(np.argwhere(wall), a, b).any()
            assert sees(wall, *ends) == sees(wall, *ends[::-1]) == expected
            assert is_segment_free(~wall, 1.0, 0.0, 0.0, *ends[0], *ends[1]) == expected
            seen += expected
    assert 300 < seen < 900


def test_rows_and_columns_are_alike() -> None:
    """A steep segment mirrored on the diagonal is a level one; the two are checked along different lanes."""
    rng, seen = np.random.default_rng(3), 0
    for _ in range(40):
        wall = rng.random((14, 11)) < rng.choice([0.02, 0.1])
        for x0, y0, x1, y1 in rng.random((50, 4)) * (11.0, 14.0, 11.0, 14.0):
            sight = sees(wall, (x0, y0), (x1, y1))
            assert sees(wall.T.copy(), (y0, x0), (y1, x1)) == sees(wall, (x1, y1), (x0, y0)) == sight
            assert is_segment_free(~wall, 1.0, 0.0, 0.0, x0, y0, x1, y1) == sight
            seen += sight
    assert 600 < seen < 1800


def test_between_neighbours_the_ground_costs_the_same_as_in_astar() -> None:
    """Half of the step in each cell: s (1 + (e + f) / 2)."""
    extra = np.array([[0, 8, 0], [0, 0, 24]], dtype=np.uint8)
    assert ground_cost(extra, 8, 0.5, 0.5, 1.5, 0.5) == pytest.approx(1.5)
    assert ground_cost(extra, 8, 1.5, 0.5, 2.5, 1.5) == pytest.approx(math.sqrt(2.0) * (1.0 + 0.5 * (1.0 + 3.0)))
    assert ground_cost(extra, 8, 2.5, 1.5, 2.5, 0.5) == pytest.approx(2.5)
    assert ground_cost(extra, 8, 0.5, 1.5, 0.5, 1.5) == 0.0


def test_the_ground_cost_is_the_integral() -> None:
    rng = np.random.default_rng(4)
    extra = rng.integers(0, 200, (9, 11), dtype=np.uint8)
    shares = (np.arange(20_000) + 0.5) / 20_000
    for _ in range(20):
        a, b = rng.uniform((0.0, 0.0), (11.0, 9.0), (2, 2))
        x, y = (a + shares[:, None] * (b - a)).T
        mean = (1.0 + extra[y.astype(int), x.astype(int)] / 8.0).mean()
        assert ground_cost(extra, 8, *a, *b) == pytest.approx(math.dist(a, b) * mean, rel=1e-3)
