"""Theta* and Lazy Theta*: lengths between the true shortest path and that of A*."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_astar.inflation import disc_reach, grow
from navloom_astar.search import Closed, GridSearch
from navloom_theta_star.search import LazyThetaSearch, Taut, ThetaSearch, _along, _at_least
from numpy.typing import NDArray
from theta_oracles import is_touched, shortest_at_all, shortest_over_centres

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
SEARCHES = [ThetaSearch, LazyThetaSearch]
both = pytest.mark.parametrize("search", SEARCHES)


def maze(seed: int, most: int, density: float) -> tuple[Bools, list[tuple[int, int]]]:
    """A random grid with sides up to `most`, and all its free cells in a random order, two at least."""
    rng = np.random.default_rng(seed)
    free = rng.random(rng.integers(2, most + 1, size=2)) >= density
    free[0, 0] = free[-1, -1] = True
    return free, [tuple(cell) for cell in rng.permutation(np.argwhere(free)).tolist()]


def smoothed(cells: NDArray[np.int64], free: Bools) -> float:
    """Length of A*'s path after the usual smoothing by line of sight (Botea, Müller & Schaeffer 2004)."""
    walls = np.argwhere(~free)
    turns = [cells[0]]
    for here, ahead in pairwise(cells[1:]):
        if is_touched(walls, turns[-1], ahead).any():
            turns.append(here)
    return float(np.hypot(*np.diff([*turns, cells[-1]], axis=0).T).sum())


@pytest.mark.parametrize("density", [0.1, 0.25, 0.4])
def test_no_path_is_shorter_than_the_shortest_and_most_are_as_short(density: float) -> None:
    """Compared with the visibility graph of all cell centres, where any-angle paths may turn."""
    ratios: dict[type, list[float]] = {search: [] for search in SEARCHES}
    for seed in range(8):
        free, (start, *goals) = maze(seed, 9, density)
        best = shortest_over_centres(free, start)
        for search in SEARCHES:
            grid = search(free.shape)
            for goal in goals:
                way = grid.shortest(free, start, goal)
                if isinstance(way, Closed):
                    assert best[goal] == math.inf
                else:
                    assert way.length >= best[goal] - 1e-9
                    ratios[search].append(way.length / best[goal])
    for ratio in ratios.values():
        assert len(ratio) > 60
        assert np.mean(np.array(ratio) < 1.0 + 1e-9) > 0.6
        assert np.mean(ratio) < 1.03


def test_no_path_is_shorter_than_round_the_obstacles_corners() -> None:
    """Compared with the visibility graph of the corners: the minimum for a point that may touch but not enter."""
    for seed in range(4):
        free, (start, *goals) = maze(100 + seed, 8, 0.25)
        lengths = shortest_at_all(free, start, goals)
        for grid in (search(free.shape) for search in SEARCHES):
            for goal, least in zip(goals, lengths, strict=True):
                way = grid.shortest(free, start, goal)
                assert isinstance(way, Closed) == (least == math.inf)
                assert isinstance(way, Closed) or way.length >= least - 1e-9


def test_the_oracle_of_corners_by_hand() -> None:
    """From the left of one occupied cell to the right of it: over its corners (1, 1) and (2, 1)."""
    free = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], dtype=np.bool_)
    assert shortest_at_all(free, (1, 0), [(1, 2)]) == pytest.approx([1.0 + 2.0 * math.hypot(0.5, 0.5)])
    free[0, 2] = False  # two obstacles meet at a corner: the other way round
    assert shortest_at_all(free, (1, 0), [(0, 1)]) == pytest.approx([math.sqrt(2.0)])
    free[:, 1] = [False, False, False]
    assert shortest_at_all(free, (1, 0), [(1, 2)]).tolist() == [math.inf]


@both
@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.05, 0.15, 0.3]))
def test_no_path_is_longer_than_that_of_astar_and_each_is_free(
    search: type[ThetaSearch], seed: int, density: float
) -> None:
    free, (start, goal, *_) = maze(seed, 30, density)
    ends = tuple((x + 0.5, y + 0.5) for y, x in (start, goal))
    if seed % 2:
        shift = np.random.default_rng(seed).random((2, 2))
        ends = tuple((x + a, y + b) for (y, x), (a, b) in zip((start, goal), shift.tolist(), strict=True))
    on_cells, way = (
        GridSearch(free.shape).shortest(free, start, goal),
        search(free.shape).shortest(free, start, goal, None, ends),
    )
    if isinstance(on_cells, Closed):
        assert way == on_cells
        return
    assert way.length <= _length(on_cells.cells, ends) + 1e-7
    assert way.length == way.cost == pytest.approx(_length(way.cells, ends), abs=1e-9)
    assert (tuple(way.cells[0]), tuple(way.cells[-1])) == (start, goal)
    walls = np.argwhere(~np.pad(free, 1)) - 1
    for a, b in pairwise(way.cells[1:-1]):
        assert not is_touched(walls, a, b).any()


def _length(cells: NDArray[np.int64], ends: tuple) -> float:
    """Length of a path of at least two cells over their centres, between the ends, cells."""
    corners = cells[:, ::-1] + 0.5
    corners[0], corners[-1] = ends
    return float(np.hypot(*np.diff(corners, axis=0).T).sum())


@both
@pytest.mark.parametrize(
    ("clutter", "radius", "shorter"), [(0.05, 0.0, 0.6), (0.2, 0.0, 0.6), (0.01, 2.2, 0.4), (0.004, 4.0, 0.25)]
)
def test_paths_are_shorter_than_smoothed_ones_of_astar(search, clutter: float, radius: float, shorter: float) -> None:
    """In sum, and for all but a few single queries, for which the method does not guarantee it."""
    lengths = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        free = ~grow(rng.random((60, 60)) < clutter, disc_reach(radius))
        cells, ours, theirs = np.argwhere(free), search(free.shape), GridSearch(free.shape)
        for pick in rng.integers(len(cells), size=(15, 2)):
            start, goal = (tuple(cell) for cell in cells[pick].tolist())
            way = ours.shortest(free, start, goal)
            if isinstance(way, Taut) and start != goal:
                lengths.append((way.length, smoothed(theirs.shortest(free, start, goal).cells, free)))
    way_lengths, smoothed_lengths = np.array(lengths).T
    assert len(lengths) > 70
    assert way_lengths.sum() < smoothed_lengths.sum()
    assert np.mean(way_lengths > smoothed_lengths + 1e-9) < 0.1
    assert np.mean(way_lengths < smoothed_lengths - 1e-9) > shorter
    assert (way_lengths < 1.03 * smoothed_lengths).all()


@both
def test_lengths_by_hand(search: type[ThetaSearch]) -> None:
    free = np.ones((5, 8), dtype=np.bool_)
    way = search(free.shape).shortest(free, (0, 0), (3, 7))
    assert way.cells.tolist() == [[0, 0], [3, 7]] and way.length == pytest.approx(math.sqrt(58.0))
    free[:4, 3] = False  # over the row 4: as far as (4, 2) and on from (4, 4)
    way = search(free.shape).shortest(free, (0, 0), (0, 6))
    assert way.cells.tolist() == [[0, 0], [4, 2], [4, 4], [0, 6]]
    assert way.length == pytest.approx(2.0 + 2.0 * math.hypot(4.0, 2.0))


@both
def test_a_path_ends_at_the_requested_places(search: type[ThetaSearch]) -> None:
    free = np.ones((3, 6), dtype=np.bool_)
    way = search(free.shape).shortest(free, (0, 0), (2, 5), None, ((0.1, 0.2), (5.9, 2.6)))
    assert way.cells.tolist() == [[0, 0], [2, 5]] and way.length == pytest.approx(math.hypot(5.8, 2.4))
    way = search(free.shape).shortest(free, (1, 1), (1, 1), None, ((1.1, 1.5), (1.9, 1.5)))
    assert way.cells.tolist() == [[1, 1]] and way.length == pytest.approx(0.8)


@both
def test_an_end_on_the_edge_beside_an_obstacle_is_reached(search: type[ThetaSearch]) -> None:
    """No cell is visible from there, so the first step is to a neighbour."""
    free = np.ones((3, 6), dtype=np.bool_)
    free[0] = False
    way = search(free.shape).shortest(free, (1, 0), (1, 5), None, ((0.5, 1.0), (5.5, 1.5)))
    assert way.length == pytest.approx(math.hypot(1.0, 0.5) + 4.0)


@both
def test_ground_of_extra_cost_is_avoided_when_that_is_cheaper(search: type[ThetaSearch]) -> None:
    """A row of extra cost e between start and goal, with a gap: straight costs 4 + e, by the gap two diagonals."""
    free, extra = np.ones((5, 9), dtype=np.bool_), np.zeros((5, 9), dtype=np.uint8)
    extra[2, :7] = 4
    way = search(free.shape).shortest(free, (0, 4), (4, 4), extra)
    assert way.cells.tolist() == [[0, 4], [4, 4]] and way.cost == pytest.approx(4.5)
    extra[2, :7] = 80
    way = search(free.shape).shortest(free, (0, 4), (4, 4), extra)
    assert [2, 7] in way.cells.tolist()
    assert way.cost == pytest.approx(way.length) and way.length <= 4 * math.sqrt(2.0) + 2.0


@both
@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 16, 255]))
def test_on_ground_of_extra_cost_no_path_costs_more_than_that_of_astar(
    search: type[ThetaSearch], seed: int, most: int
) -> None:
    free, (start, goal, *_) = maze(seed, 16, 0.2)
    extra = np.random.default_rng(seed).integers(0, most + 1, size=free.shape, dtype=np.uint8)
    on_cells, way = (kind(free.shape).shortest(free, start, goal, extra) for kind in (GridSearch, search))
    if isinstance(on_cells, Closed):
        assert way == on_cells
    else:
        assert way.length - 1e-9 <= way.cost <= on_cells.cost + 1e-6


def test_poor_parents_are_rejected_by_a_lower_bound_of_the_cost() -> None:
    """On any ground, and tight enough that a cell's own parent is still rejected as no better."""
    places, ground = np.random.default_rng(4).random((2000, 4)) * 300.0 + 1.0, np.zeros((302, 302), dtype=np.uint8)
    ground[::3] = 8
    for place in places.tolist():
        bound, length = _at_least(*place), _along(None, *place)
        assert length * (1.0 - 1e-12) < bound <= length <= _along(ground, *place)


@both
def test_queries_do_not_affect_each_other(search: type[ThetaSearch]) -> None:
    rng = np.random.default_rng(5)
    kept = search((30, 20))
    for _ in range(40):
        free = rng.random((30, 20)) >= 0.3
        cells = np.argwhere(free)
        start, goal = (tuple(cells[n].tolist()) for n in rng.integers(len(cells), size=2))
        extra = rng.integers(0, 20, size=free.shape, dtype=np.uint8) if rng.random() < 0.3 else None
        ours, new = (each.shortest(free, start, goal, extra) for each in (kept, search((30, 20))))
        if isinstance(new, Taut):
            assert ours.cells.tolist() == new.cells.tolist() and ours.cost == new.cost
        else:
            assert ours == new


@both
def test_a_goal_in_an_obstacle_is_refused(search: type[ThetaSearch]) -> None:
    free = np.array([[1, 0, 1], [1, 1, 1]], dtype=np.bool_)
    with pytest.raises(ValueError, match="goal: got cell"):
        search((2, 3)).shortest(free, (0, 0), (0, 1))
