"""Speed as ratios within one run."""

from __future__ import annotations

import timeit

import numpy as np
import pytest
from navloom_astar.inflation import disc_reach, grow
from navloom_astar.search import DijkstraSearch, GridSearch
from navloom_theta_star.search import LazyThetaSearch, ThetaSearch

pytestmark = pytest.mark.benchmark


def test_the_price_of_any_angle(benchmark) -> None:
    """Round 120 discs on 400 x 400 cells, from side to side.

    A* goes straight through open ground, so the ratio to it means little; Dijkstra's algorithm visits every cell once.
    """
    rng = np.random.default_rng(0)
    free = ~grow(rng.random((400, 400)) < 120 / 400**2, disc_reach(10.0))
    left, right = np.flatnonzero(free[:, 5]), np.flatnonzero(free[:, 394])
    ends = [((int(rng.choice(left)), 5), (int(rng.choice(right)), 394)) for _ in range(5)]
    grids = [kind(free.shape) for kind in (GridSearch, DijkstraSearch, ThetaSearch, LazyThetaSearch)]

    def answers(grid) -> list[float]:
        return [grid.shortest(free, *pair).length for pair in ends]

    lengths = [sum(answers(grid)) for grid in grids]
    benchmark.pedantic(answers, (grids[2],), rounds=3)
    best = [np.inf] * 4
    for _ in range(9):
        best = [
            min(old, timeit.timeit(lambda grid=grid: answers(grid), number=1))
            for old, grid in zip(best, grids, strict=True)
        ]
    for name, seconds in (("theta_star", best[2]), ("lazy_theta_star", best[3])):
        benchmark.extra_info[f"{name}_over_astar"] = seconds / best[0]
        benchmark.extra_info[f"{name}_over_dijkstra"] = seconds / best[1]
    benchmark.extra_info["theta_star_length_over_astar"] = lengths[2] / lengths[0]
    assert max(lengths[2:]) < 0.95 * lengths[0]
    assert max(best[2:]) < 4.0 * best[1]
