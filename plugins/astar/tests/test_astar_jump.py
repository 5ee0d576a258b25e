"""Jump point search and Dijkstra's algorithm give what A* gives: equal numbers of steps, or the same failure."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_astar import jump
from navloom_astar.grids import RasterMap
from navloom_astar.jump import JumpPointSearch
from navloom_astar.planning import Failure, Found, GridPlanner, Settings
from navloom_astar.search import Closed, DijkstraSearch, GridSearch, Way
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

Bools = NDArray[np.bool_]
OTHERS = [DijkstraSearch, JumpPointSearch]
ROOT = math.sqrt(2.0)


@st.composite
def mazes(draw: st.DrawFn) -> tuple[Bools, tuple[int, int], tuple[int, int]]:
    shape = draw(st.tuples(st.integers(1, 16), st.integers(1, 16)))
    density = draw(st.sampled_from([0.05, 0.15, 0.25, 0.4]))
    free = np.random.default_rng(draw(st.integers(0, 2**32 - 1))).random(shape) >= density
    start, goal = ((draw(st.integers(0, shape[0] - 1)), draw(st.integers(0, shape[1] - 1))) for _ in range(2))
    free[start] = free[goal] = True
    return free, start, goal


def is_legal(way: Way, free: Bools, start: tuple[int, int], goal: tuple[int, int]) -> bool:
    cells, steps = way.cells, np.abs(np.diff(way.cells, axis=0))
    return bool(
        tuple(cells[0]) == start
        and tuple(cells[-1]) == goal
        and free[cells[:, 0], cells[:, 1]].all()
        and (free[cells[:-1, 0], cells[1:, 1]] & free[cells[1:, 0], cells[:-1, 1]]).all()
        and (steps.max(axis=1, initial=0) == 1).all()
        and ((steps.sum(axis=1) == 1).sum(), (steps.sum(axis=1) == 2).sum()) == (way.straight, way.diagonal)
    )


@settings(max_examples=300, deadline=None)
@given(mazes())
def test_the_cost_is_that_of_astar(maze) -> None:
    free, start, goal = maze
    expected, *answers = (kind(free.shape).shortest(free, start, goal) for kind in (GridSearch, *OTHERS))
    for answer in answers:
        if isinstance(expected, Closed):
            assert answer == expected
        else:
            assert (answer.straight, answer.diagonal) == (expected.straight, expected.diagonal)
            assert is_legal(answer, free, start, goal)


@pytest.mark.parametrize("density", [0.02, 0.1, 0.25, 0.4])
def test_jumps_are_as_short_as_scipys_dijkstra(density: float) -> None:
    """Compared with a graph without directions."""
    rng, reached = np.random.default_rng(round(1000 * density)), 0
    for _ in range(20):
        free = rng.random((33, 27)) >= density
        cells = np.argwhere(free)
        start = tuple(cells[rng.integers(len(cells))].tolist())
        best, grid = _costs(free, start), JumpPointSearch(free.shape)
        for goal in map(tuple, cells[rng.integers(len(cells), size=30)].tolist()):
            answer = grid.shortest(free, start, goal)
            if isinstance(answer, Closed):
                assert best[goal] == math.inf
            else:
                reached += 1
                assert answer.length == pytest.approx(best[goal], abs=1e-9)
                assert is_legal(answer, free, start, goal)
    assert reached > 100


def _costs(free: Bools, start: tuple[int, int]) -> NDArray[np.float64]:
    is_free, flat, found = np.pad(free, 1), np.pad(np.arange(free.size).reshape(free.shape), 1), []
    for down, across in ((0, 1), (1, 0), (1, 1), (1, -1)):
        legal = is_free.copy()
        for shift in ((down, across), (down, 0), (0, across)):
            legal &= np.roll(is_free, (-shift[0], -shift[1]), axis=(0, 1))
        ahead = np.roll(flat, (-down, -across), axis=(0, 1))
        found.append((flat[legal], ahead[legal], np.full(legal.sum(), math.hypot(down, across))))
    origins, targets, costs = (np.concatenate(column) for column in zip(*found, strict=True))
    graph = csr_array((costs, (origins, targets)), shape=(free.size, free.size))
    return dijkstra(graph, directed=False, indices=start[0] * free.shape[1] + start[1]).reshape(free.shape)


def test_an_obstacle_is_passed_before_the_turn() -> None:
    """Along a wall of four cells and round its end: the turn is beside the first cell past it, 5 + 2 + sqrt(2)."""
    free = np.ones((4, 8), dtype=np.bool_)
    free[1, :5] = False
    way = JumpPointSearch(free.shape).shortest(free, (0, 0), (3, 4))
    assert way.length == pytest.approx(5 + 2 + ROOT)
    assert [0, 5] in way.cells.tolist() and [1, 5] in way.cells.tolist()


def test_jump_points_are_few() -> None:
    """An empty room has only the goal and one corner as jump points; A* would visit each cell of the diagonal."""
    free = np.ones((50, 80), dtype=np.bool_)
    grid = JumpPointSearch(free.shape)
    way = grid.shortest(free, (0, 0), (49, 79))
    assert (way.straight, way.diagonal) == (30, 49)
    assert np.count_nonzero(grid._cost) == 3  # start, turn and goal; cells never reached have cost 0


@settings(max_examples=60, deadline=None)
@given(mazes(), st.integers(0, 2**32 - 1))
def test_extra_costs_are_minimal_too(maze, seed: int) -> None:
    free, start, goal = maze
    extra = np.random.default_rng(seed).integers(0, 30, size=free.shape, dtype=np.uint8)
    expected, *answers = (kind(free.shape).shortest(free, start, goal, extra) for kind in (GridSearch, *OTHERS))
    for answer in answers:
        if isinstance(expected, Closed):
            assert answer == expected
        else:
            assert answer.cost == pytest.approx(expected.cost, abs=1e-9)
            assert is_legal(answer, free, start, goal)


@pytest.mark.parametrize("other", OTHERS)
def test_queries_do_not_affect_each_other(other: type[GridSearch]) -> None:
    rng = np.random.default_rng(6)
    kept = other((40, 50))
    for _ in range(60):
        free = rng.random((40, 50)) >= 0.3
        cells = np.argwhere(free)
        start, goal = (tuple(cells[n].tolist()) for n in rng.integers(len(cells), size=2))
        extra = rng.integers(0, 20, size=free.shape, dtype=np.uint8) if rng.random() < 0.3 else None
        ours, new = (each.shortest(free, start, goal, extra) for each in (kept, other((40, 50))))
        if isinstance(new, Way):
            assert ours.cells.tolist() == new.cells.tolist()
        else:
            assert ours == new


@pytest.mark.parametrize("other", OTHERS)
def test_a_start_in_an_obstacle_is_refused(other: type[GridSearch]) -> None:
    free = np.array([[1, 0, 1], [1, 1, 1]], dtype=np.bool_)
    with pytest.raises(ValueError, match="start: got cell"):
        other((2, 3)).shortest(free, (0, 1), (1, 1))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 2.5), st.sampled_from(["free", "cost"]), st.booleans())
def test_plans_cost_the_same_and_fail_alike(seed: int, radius: float, unknown: str, may_squeeze: bool) -> None:
    """With inflation, ways out of it, passages narrower than it, and ground of extra cost, where lengths may differ."""
    rng = np.random.default_rng(seed)
    values = np.array([0, 100, -1], dtype=np.int8)
    given_map = RasterMap(rng.choice(values, (25, 30), p=[0.9, 0.04, 0.06]), 1.0, (0.0, 0.0, 0.0))
    start, goal = (tuple((rng.integers(25, size=2) + 0.5).tolist()) for _ in range(2))
    use = Settings(radius=radius, unknown=unknown, squeeze=0.6 * radius if may_squeeze else None)
    (expected, expected_costs), *others = (
        plan_and_costs(GridPlanner(use, start, search), start, goal, given_map) for search in (GridSearch, *OTHERS)
    )
    for answer, costs in others:
        assert costs == pytest.approx(expected_costs, abs=1e-9)
        if not isinstance(expected, Found):
            assert answer == expected
        else:
            assert isinstance(answer, Found)
            assert unknown == "cost" or may_squeeze or answer.length == pytest.approx(expected.length, abs=1e-9)


def plan_and_costs(
    planner: GridPlanner, start: tuple[float, float], goal: tuple[float, float], given_map: RasterMap
) -> tuple[Found | Failure, list[float]]:
    """A plan, and the cost, cells, of each way that was searched for it; infinite where there was none."""
    costs: list[float] = []
    make = planner._make_search

    def searching(shape: tuple[int, int]) -> GridSearch:
        search = make(shape)
        shortest = search.shortest

        def recorded(*given: object) -> Way | Closed:
            answer = shortest(*given)
            costs.append(answer.cost if isinstance(answer, Way) else math.inf)
            return answer

        search.shortest = recorded
        return search

    planner._make_search = searching
    return planner.plan(start, goal, np.empty((0, 4)), given_map), costs


def test_nothing_compiles_after_warm_up() -> None:
    jump.warm_up()
    kernels = [jump._search, jump._slide, jump._run, jump._trace]
    before = [len(kernel.signatures) for kernel in kernels]
    free = np.ones((20, 20), dtype=np.bool_)
    free[5:15, 10] = False
    JumpPointSearch((20, 20)).shortest(free, (10, 2), (10, 18))
    assert [len(kernel.signatures) for kernel in kernels] == before and before[0] == before[3] == 1
