"""Costs that are repaired after local changes, compared cell by cell with a new search, and with scipy's Dijkstra."""

from __future__ import annotations

import numpy as np
import pytest
from navloom_astar.search import DijkstraSearch, GridSearch, Way
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

Bools = NDArray[np.bool_]


def cost_by_dijkstra(free: Bools, extra: NDArray[np.uint8] | None, start: tuple, goal: tuple) -> float:
    """Cost of the shortest way, cells; infinite if there is none. Independent of the search."""
    ground = np.pad(np.zeros(free.shape) if extra is None else extra / 8.0, 1)
    inside, flat = np.pad(free, 1), np.pad(np.arange(free.size).reshape(free.shape), 1)
    ends, costs = [], []
    for down in (-1, 0, 1):
        for across in (-1, 0, 1):
            moved = [np.roll(inside, (-a, -b), axis=(0, 1)) for a, b in ((down, across), (down, 0), (0, across))]
            is_legal = inside & moved[0] & moved[1] & moved[2] & bool(down or across)
            target, ahead = (np.roll(table, (-down, -across), axis=(0, 1)) for table in (flat, ground))
            ends.append(np.stack([flat[is_legal], target[is_legal]]))
            costs.append((np.hypot(down, across) * (1.0 + 0.5 * (ground + ahead)))[is_legal])
    graph = csr_array((np.concatenate(costs), np.concatenate(ends, axis=1)), shape=(free.size, free.size))
    first, last = (row * free.shape[1] + column for row, column in (start, goal))
    return float(dijkstra(graph, indices=first)[last])


def check_changes(rng: np.random.Generator, changes: int, search: type[GridSearch]) -> int:
    """Change a random grid near a start that moves, and check each answer. Returns how many had a way."""
    shape = tuple(rng.integers(8, 60, size=2).tolist())
    free, ways = rng.random(shape) >= rng.choice([0.0, 0.1, 0.3, 0.4]), 0
    extra = np.where(rng.random(shape) < 0.3, 24, 0).astype(np.uint8) if rng.random() < 0.4 else None
    start, goal = (tuple(rng.integers(shape).tolist()) for _ in range(2))
    kept = search(shape)
    for _ in range(changes):
        for _ in range(int(rng.integers(3))):
            row, column = (start + rng.integers(-6, 7, size=2)).clip(0, np.array(shape) - 1)
            box = np.s_[row : row + int(rng.integers(1, 4)), column : column + int(rng.integers(1, 4))]
            if extra is not None and rng.random() < 0.5:
                extra[box] = rng.choice([0, 8, 24])
            else:
                free[box] = rng.random() < 0.5
        if rng.random() < 0.6:
            start = tuple((start + rng.integers(-2, 3, size=2)).clip(0, np.array(shape) - 1).tolist())
        free[start] = free[goal] = True
        answer, new = (each.shortest(free, start, goal, extra) for each in (kept, search(shape)))
        assert type(answer) is type(new)
        best = cost_by_dijkstra(free, extra, start, goal)
        if isinstance(answer, Way):
            ways += 1
            assert answer.cells.tolist() == new.cells.tolist()
            assert answer.cost == new.cost == pytest.approx(best, abs=1e-7)
        else:
            assert answer == new and best == np.inf
    return ways


@pytest.mark.parametrize("search", [GridSearch, DijkstraSearch])
def test_after_local_changes_the_way_is_that_of_a_new_search(search: type[GridSearch]) -> None:
    rng = np.random.default_rng(3)
    assert sum(check_changes(rng, 20, search) for _ in range(15)) > 100


@pytest.mark.slow
def test_after_10_000_local_changes_the_way_is_that_of_a_new_search() -> None:
    rng = np.random.default_rng(4)
    assert sum(check_changes(rng, 20, GridSearch) for _ in range(500)) > 5000


def test_astar_and_dijkstra_choose_the_same_of_equally_short_ways() -> None:
    rng = np.random.default_rng(6)
    for _ in range(50):
        free = rng.random((30, 40)) >= 0.25
        free[2, 3] = free[25, 33] = True
        astar, plain = (search(free.shape).shortest(free, (2, 3), (25, 33)) for search in (GridSearch, DijkstraSearch))
        assert type(astar) is type(plain)
        if isinstance(astar, Way):
            assert astar.cells.tolist() == plain.cells.tolist()


def test_a_change_beside_the_start_leaves_the_other_costs() -> None:
    """A wall of 3 cells: itself, and few of the cells in its shadow, as seen from the goal, lose their costs."""
    free = np.ones((30, 30), dtype=np.bool_)
    free[14, 8:] = free[16, 8:] = False  # a corridor to the goal, so that not all costs are those of an empty grid
    search = GridSearch(free.shape)
    search.shortest(free, (10, 2), (15, 29))
    before = search._cost.copy()
    free[9:12, 4] = False
    way = search.shortest(free, (10, 2), (15, 29))
    assert isinstance(way, Way)
    reached = (before < search._top) & (before >= search._base)
    assert 0 < (search._cost[reached] != before[reached]).sum() <= 12


def test_a_changed_goal_or_much_change_starts_a_new_search() -> None:
    free = np.ones((20, 20), dtype=np.bool_)
    search = GridSearch(free.shape)
    search.shortest(free, (0, 0), (19, 10))
    base = search._base
    search.shortest(free, (0, 1), (19, 10))
    assert search._base == base  # repaired
    search.shortest(free, (0, 1), (18, 10))
    assert search._base < base
    base, free[5:9, 3:9] = search._base, False  # 24 of 400 cells, above 5 %
    search.shortest(free, (0, 1), (18, 10))
    assert search._base < base
