"""The search, compared with independent oracles, and its properties."""

from __future__ import annotations

import math
from fractions import Fraction

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from navloom_astar import search
from navloom_astar.search import EXTRA_UNIT, Closed, GridSearch, Way, step_costs
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

ROOT = math.sqrt(2.0)
Bools = NDArray[np.bool_]
SHAPES = st.tuples(st.integers(1, 14), st.integers(1, 14))


def edges(free: Bools, extra: NDArray | None = None) -> tuple[NDArray, NDArray, NDArray]:
    """Every legal step of a grid, computed independently of the search: flat cells from and to, and costs."""
    ground = np.pad(np.zeros(free.shape) if extra is None else extra / EXTRA_UNIT, 1)
    is_free, flat = np.pad(free, 1), np.pad(np.arange(free.size).reshape(free.shape), 1)
    found = []
    for dr, dc in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        is_legal = is_free.copy()
        for shift in ((dr, dc), (dr, 0), (0, dc)):
            is_legal &= np.roll(is_free, (-shift[0], -shift[1]), axis=(0, 1))
        target, ahead = (np.roll(table, (-dr, -dc), axis=(0, 1)) for table in (flat, ground))
        costs = math.hypot(dr, dc) * (1.0 + 0.5 * (ground + ahead))
        found.append((flat[is_legal], target[is_legal], costs[is_legal]))
    origins, targets, costs = (np.concatenate(column) for column in zip(*found, strict=True))
    return origins, targets, costs


def oracle(free: Bools, start: tuple[int, int], extra: NDArray | None = None) -> NDArray:
    """Costs from a start to all cells by scipy's Dijkstra; infinite where there is no way."""
    origins, targets, costs = edges(free, extra)
    graph = csr_array((costs, (origins, targets)), shape=(free.size, free.size))
    return dijkstra(graph, indices=start[0] * free.shape[1] + start[1]).reshape(free.shape)


def check_way(way: Way, free: Bools, start: tuple[int, int], goal: tuple[int, int]) -> None:
    """Check that a path goes over free cells from start to goal by legal steps, of the stated number."""
    cells, steps = way.cells, np.diff(way.cells, axis=0)
    assert tuple(cells[0]) == start and tuple(cells[-1]) == goal
    assert free[cells[:, 0], cells[:, 1]].all()
    assert free[cells[:-1, 0], cells[1:, 1]].all() and free[cells[1:, 0], cells[:-1, 1]].all()
    assert (np.abs(steps).max(axis=1, initial=0) == 1).all()
    assert (np.abs(steps).sum(axis=1) == 1).sum() == way.straight
    assert (np.abs(steps).sum(axis=1) == 2).sum() == way.diagonal


@st.composite
def mazes(draw: st.DrawFn) -> tuple[Bools, tuple[int, int], tuple[int, int]]:
    shape = draw(SHAPES)
    free = draw(arrays(np.bool_, shape, elements=st.integers(0, 99).map(lambda n: n < 70), fill=st.nothing()))
    start, goal = ((draw(st.integers(0, shape[0] - 1)), draw(st.integers(0, shape[1] - 1))) for _ in range(2))
    free[start] = free[goal] = True
    return free, start, goal


@settings(max_examples=300, deadline=None)
@given(mazes())
def test_it_is_as_short_as_dijkstra_and_legal(maze) -> None:
    free, start, goal = maze
    answer, best = GridSearch(free.shape).shortest(free, start, goal), oracle(free, start)
    if isinstance(answer, Closed):
        assert best[goal] == math.inf
    else:
        assert answer.length == pytest.approx(best[goal], abs=1e-9)
        assert answer.cost == answer.length
        check_way(answer, free, start, goal)


@pytest.mark.parametrize("density", [0.05, 0.15, 0.25, 0.35, 0.45])
def test_it_is_as_short_as_dijkstra_on_many_random_grids(density: float) -> None:
    rng = np.random.default_rng(round(1000 * density))
    reached = closed = 0
    for _ in range(25):
        free = rng.random((24, 31)) >= density
        cells = np.argwhere(free)
        start = tuple(cells[rng.integers(len(cells))].tolist())
        best, grid = oracle(free, start), GridSearch(free.shape)
        for goal in map(tuple, cells[rng.integers(len(cells), size=40)].tolist()):  # 1000 queries a density
            answer = grid.shortest(free, start, goal)
            if isinstance(answer, Closed):
                closed += 1
                assert best[goal] == math.inf
            else:
                reached += 1
                assert answer.length == pytest.approx(best[goal], abs=1e-9)
                check_way(answer, free, start, goal)
    assert reached > 100 and reached + closed == 1000


def test_networkx_agrees() -> None:
    rng = np.random.default_rng(3)
    free = rng.random((30, 30)) >= 0.3
    free[0, 0] = True
    graph = nx.DiGraph()
    graph.add_weighted_edges_from(zip(*(column.tolist() for column in edges(free)), strict=True))
    lengths = nx.single_source_dijkstra_path_length(graph, 0)
    grid = GridSearch(free.shape)
    for r, c in np.argwhere(free).tolist():
        answer = grid.shortest(free, (0, 0), (r, c))
        if isinstance(answer, Way):
            assert answer.length == pytest.approx(lengths[30 * r + c], abs=1e-9)
        else:
            assert 30 * r + c not in lengths


@settings(max_examples=200, deadline=None)
@given(mazes(), st.integers(0, 2**32 - 1), st.sampled_from([1, 8, 60, 255]))
def test_extra_costs_are_minimal_too(maze, seed: int, most: int) -> None:
    free, start, goal = maze
    extra = np.random.default_rng(seed).integers(0, most + 1, size=free.shape, dtype=np.uint8)
    answer, best = GridSearch(free.shape).shortest(free, start, goal, extra), oracle(free, start, extra)
    if isinstance(answer, Closed):
        assert best[goal] == math.inf
    else:
        assert answer.cost == pytest.approx(best[goal], abs=1e-7)
        check_way(answer, free, start, goal)


def test_ground_of_extra_cost_is_avoided_when_that_is_cheaper() -> None:
    """Round the row of extra cost e: 6 + 2 sqrt(2) = 8.83. Along it: 8 + 7 e, 8.875 at e = 1/8 and 8 at e = 0."""
    free, extra = np.ones((5, 9), dtype=np.bool_), np.zeros((5, 9), dtype=np.uint8)
    extra[2, 1:8] = 1
    way = GridSearch(free.shape).shortest(free, (2, 0), (2, 8), extra)
    assert (way.straight, way.diagonal) == (6, 2)
    assert way.cost == pytest.approx(6 + 2 * ROOT)
    extra[2, 4:8] = 0  # along it: 8 + 3/8
    way = GridSearch(free.shape).shortest(free, (2, 0), (2, 8), extra)
    assert (way.straight, way.diagonal, way.cost) == (8, 0, 8.375)


@settings(max_examples=100, deadline=None)
@given(mazes())
def test_turning_or_mirroring_the_grid_keeps_the_length(maze) -> None:
    free, start, goal = maze
    marks = np.zeros((2, *free.shape), dtype=np.bool_)
    marks[0][start] = marks[1][goal] = True
    lengths = set()
    for turns in range(4):
        for flip in (False, True):
            views = [np.rot90(each.T if flip else each, turns) for each in (free, *marks)]
            ends = [tuple(np.argwhere(each)[0].tolist()) for each in views[1:]]
            answer = GridSearch(views[0].shape).shortest(views[0], *ends)
            lengths.add(None if isinstance(answer, Closed) else (answer.straight, answer.diagonal))
    assert len(lengths) == 1


@settings(max_examples=100, deadline=None)
@given(mazes())
def test_the_way_back_is_as_long(maze) -> None:
    free, start, goal = maze
    there, back = (GridSearch(free.shape).shortest(free, *ends) for ends in ((start, goal), (goal, start)))
    assert type(there) is type(back)
    if isinstance(there, Way):
        assert (there.straight, there.diagonal) == (back.straight, back.diagonal)


def test_lengths_by_hand() -> None:
    free = np.ones((3, 4), dtype=np.bool_)
    way = GridSearch((3, 4)).shortest(free, (0, 0), (2, 3))
    assert (way.straight, way.diagonal, way.length) == (1, 2, 1 + 2 * ROOT)
    free[1, 1] = False  # neither diagonal beside it may be taken: three on, two up
    way = GridSearch((3, 4)).shortest(free, (0, 0), (2, 1))
    assert (way.straight, way.diagonal) == (3, 0)
    assert way.cells.tolist() == [[0, 0], [1, 0], [2, 0], [2, 1]]


def test_corners_are_not_cut() -> None:
    free = np.array([[1, 0], [1, 1]], dtype=np.bool_)
    assert GridSearch((2, 2)).shortest(free, (0, 0), (1, 1)).length == 2.0
    free[1, 0] = False  # two obstacles that touch at a corner are closed
    assert GridSearch((2, 2)).shortest(free, (0, 0), (1, 1)) == Closed((0, 0))


def test_start_is_goal() -> None:
    way = GridSearch((2, 2)).shortest(np.ones((2, 2), dtype=np.bool_), (1, 0), (1, 0))
    assert way.cells.tolist() == [[1, 0]] and way.length == 0.0


def test_without_a_path_the_nearest_place_is_given() -> None:
    free = np.ones((7, 7), dtype=np.bool_)
    free[:, 4] = False
    free[3, 3] = False
    assert GridSearch((7, 7)).shortest(free, (0, 0), (3, 6)) == Closed((2, 3))  # (4, 3) is as near, but costs more


def test_queries_do_not_affect_each_other() -> None:
    rng = np.random.default_rng(5)
    kept = GridSearch((40, 50))
    for _ in range(60):
        free = rng.random((40, 50)) >= 0.3
        cells = np.argwhere(free)
        start, goal = (tuple(cells[n].tolist()) for n in rng.integers(len(cells), size=2))
        extra = rng.integers(0, 20, size=free.shape, dtype=np.uint8) if rng.random() < 0.3 else None
        kept_answer, new = (
            kept.shortest(free, start, goal, extra),
            GridSearch((40, 50)).shortest(free, start, goal, extra),
        )
        assert type(kept_answer) is type(new)
        if isinstance(new, Way):
            assert kept_answer.cells.tolist() == new.cells.tolist()
        else:
            assert kept_answer == new


def test_costs_are_renewed_when_the_room_for_them_is_used_up() -> None:
    free = np.ones((5, 5), dtype=np.bool_)
    grid = GridSearch((5, 5))
    first = grid.shortest(free, (0, 0), (4, 4))
    grid._base, grid._kept = -search._LARGEST + 1, None  # the state after very many queries
    again = grid.shortest(free, (0, 0), (4, 4))
    assert grid._base > -1e9
    assert again.cells.tolist() == first.cells.tolist()


@pytest.mark.parametrize(
    ("start", "goal", "culprit"), [((0, 3), (1, 1), "start"), ((0, 0), (-1, 0), "goal"), ((0, 1), (1, 1), "start")]
)
def test_ends_outside_or_occupied_are_refused(start, goal, culprit: str) -> None:
    free = np.array([[1, 0, 1], [1, 1, 1]], dtype=np.bool_)
    with pytest.raises(ValueError, match=f"{culprit}: got cell"):
        GridSearch((2, 3)).shortest(free, start, goal)


def test_a_grid_of_another_shape_is_refused() -> None:
    with pytest.raises(ValueError, match=r"free: got a grid of shape \(3, 2\), expected \(2, 3\)"):
        GridSearch((2, 3)).shortest(np.ones((3, 2), dtype=np.bool_), (0, 0), (1, 1))


def test_step_costs_by_hand() -> None:
    assert step_costs(1) == (2, 3)
    assert step_costs(984) == (985, 1393)
    assert step_costs(985) == (2378, 3363)
    assert step_costs(512 * 512) == (470832, 665857)


def test_step_costs_stay_small_enough_for_the_longest_way_of_a_query() -> None:
    """4 * most * p is at most 2^62. Of 3/2, 7/5 and 17/12, 2^58 steps allow p <= 4, and 2^57 allow p <= 8."""
    assert step_costs(2**58) == (2, 3)
    assert step_costs(2**57) == (5, 7)


@given(st.integers(1, 400_000_000))
def test_step_costs_are_convergents_above_the_number_of_diagonal_steps(most: int) -> None:
    q, p = step_costs(most)
    assert q > most and abs(p * p - 2 * q * q) == 1
    assert 2 * most * p < 2**61  # costs of all queries stay within 64 bits


@given(st.integers(-3000, 3000), st.integers(-984, 984))
def test_integer_costs_rank_as_real_lengths_do(straight: int, diagonal: int) -> None:
    """Sign of a + b sqrt(2), in exact arithmetic, against that of 985 a + 1393 b, for |b| < 985."""
    squares = Fraction(straight * abs(straight) + 2 * diagonal * abs(diagonal))
    exact = (squares > 0) - (squares < 0) if straight * diagonal < 0 else np.sign(straight + diagonal)
    whole = 985 * straight + 1393 * diagonal
    assert (whole > 0) - (whole < 0) == exact


def test_the_costs_985_and_1393_misjudge_985_diagonal_steps() -> None:
    """Why `step_costs` is there: 1393 straight steps are shorter than 985 diagonal ones, but cost the same."""
    assert 985 * 1393 == 1393 * 985 and 985 * ROOT > 1393
    q, p = step_costs(1393 + 985)
    assert q * 1393 < p * 985
