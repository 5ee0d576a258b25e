"""Speed as ratios within one run, all starting from the same boolean map of rooms and clutter."""

from __future__ import annotations

import timeit

import networkx as nx
import numpy as np
import pyastar2d
import pytest
from navloom_astar import inflation, jump, search
from navloom_astar.jump import JumpPointSearch
from navloom_astar.search import DijkstraSearch, GridSearch, Way
from numpy.typing import NDArray
from scipy import ndimage

pytestmark = pytest.mark.benchmark
ROOT = 2.0**0.5


@pytest.fixture(scope="module")
def free() -> NDArray[np.bool_]:
    """512 x 512 cells: rooms of 31 x 31 with a door of 5 to each neighbour, and 5 % clutter."""
    return rooms_with(0.05)


def rooms_with(clutter: float) -> NDArray[np.bool_]:
    """The connected part of the rooms, with a share of single cells occupied."""
    rng = np.random.default_rng(0)
    rooms = np.ones((512, 512), dtype=np.bool_)
    rooms[::32] = rooms[:, ::32] = False
    for row in range(0, 512, 32):
        for column in range(0, 512, 32):
            across, up = rng.integers(2, 26, size=2)
            rooms[row, column + across : column + across + 5] = True
            rooms[row + up : row + up + 5, column] = True
    rooms &= rng.random(rooms.shape) >= clutter
    parts, _ = ndimage.label(rooms)
    return parts == np.bincount(parts[rooms]).argmax()


@pytest.fixture(scope="module")
def queries(free) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    cells = np.argwhere(free)
    picks = np.random.default_rng(1).integers(len(cells), size=(30, 2))
    return [(tuple(cells[a].tolist()), tuple(cells[b].tolist())) for a, b in picks]


def seconds(*runs) -> list[float]:
    """Shortest time of each, measured in turns so that all see the same load."""
    best = [np.inf] * len(runs)
    for _ in range(9):
        best = [min(old, timeit.timeit(run, number=1)) for old, run in zip(best, runs, strict=True)]
    return best


def test_three_times_as_fast_as_pyastar2d(free, queries, benchmark) -> None:
    """Each query has its own map, as a planner's request has: neither side may keep a prepared copy."""
    search.warm_up()
    grid = GridSearch(free.shape)

    def ours() -> list:
        return [grid.shortest(free, start, goal) for start, goal in queries]

    def theirs() -> list:
        return [
            pyastar2d.astar_path(np.where(free, np.float32(1), np.float32(np.inf)), start, goal, allow_diagonal=True)
            for start, goal in queries
        ]

    assert all(isinstance(way, Way) for way in benchmark.pedantic(ours, rounds=3))
    weights = np.where(free, np.float32(1), np.float32(np.inf))

    def theirs_prepared() -> list:
        return [pyastar2d.astar_path(weights, start, goal, allow_diagonal=True) for start, goal in queries]

    fast, slow, prepared = seconds(ours, theirs, theirs_prepared)
    benchmark.extra_info["pyastar2d_over_ours"] = slow / fast
    benchmark.extra_info["pyastar2d_with_prepared_map_over_ours"] = prepared / fast
    assert slow / fast >= 3.0


def test_jumps_are_faster_than_astar_among_rooms_and_astar_than_dijkstra(free, queries, benchmark) -> None:
    """In the rooms without clutter: every single obstacle makes jump points, and with 5 % of them A* is ahead."""
    search.warm_up()
    jump.warm_up()
    rooms = rooms_with(0.0)
    grids = [kind(free.shape) for kind in (GridSearch, DijkstraSearch, JumpPointSearch)]

    def answers(grid: GridSearch, on: NDArray[np.bool_]) -> list[float]:
        return [grid.shortest(on, start, goal).length for start, goal in queries]

    assert benchmark.pedantic(answers, (grids[2], rooms), rounds=3) == answers(grids[0], rooms)
    astar, dijkstra, jumps = seconds(*(lambda grid=grid: answers(grid, rooms) for grid in grids))
    cluttered, jumps_cluttered = seconds(*(lambda grid=grid: answers(grid, free) for grid in (grids[0], grids[2])))
    benchmark.extra_info["astar_over_jps"] = astar / jumps
    benchmark.extra_info["astar_over_jps_in_clutter"] = cluttered / jumps_cluttered
    benchmark.extra_info["dijkstra_over_astar"] = dijkstra / astar
    assert astar / jumps >= 1.5 and dijkstra / astar >= 1.5


def test_a_hundred_times_as_fast_as_networkx(free, queries, benchmark) -> None:
    """networkx gets a graph that is built already."""
    search.warm_up()
    graph = nx.Graph()
    for down, across in ((0, 1), (1, 0), (1, 1), (1, -1)):
        for row, column in np.argwhere(free[: 512 - down, max(0, -across) : 512 - max(0, across)]).tolist():
            column += max(0, -across)
            if free[row + down, column + across] and free[row, column + across] and free[row + down, column]:
                graph.add_edge((row, column), (row + down, column + across), weight=ROOT if down and across else 1.0)

    def octile(a: tuple[int, int], b: tuple[int, int]) -> float:
        down, across = abs(a[0] - b[0]), abs(a[1] - b[1])
        return max(down, across) + (ROOT - 1.0) * min(down, across)

    grid = GridSearch(free.shape)
    few = queries[:5]

    def ours() -> list[float]:
        return [grid.shortest(free, start, goal).length for start, goal in few]

    theirs = [nx.astar_path_length(graph, start, goal, octile, "weight") for start, goal in few]
    assert benchmark.pedantic(ours, rounds=3) == pytest.approx(theirs, abs=1e-6)
    fast = min(timeit.repeat(ours, number=1, repeat=9))
    slow = timeit.timeit(lambda: [nx.astar_path_length(graph, *ends, octile, "weight") for ends in few], number=1)
    benchmark.extra_info["networkx_over_ours"] = slow / fast
    assert slow / fast >= 100.0


def test_growing_is_three_times_as_fast_as_a_distance_transform(free, benchmark) -> None:
    inflation.warm_up()
    occupied, reach = ~free, inflation.disc_reach(5.0)
    benchmark.pedantic(inflation.grow, (occupied, reach), rounds=3)
    fast, slow = seconds(lambda: inflation.grow(occupied, reach), lambda: ndimage.distance_transform_edt(free))
    benchmark.extra_info["scipy_over_ours"] = slow / fast
    assert slow / fast >= 3.0
