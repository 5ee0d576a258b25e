"""Speed as ratios within one run, all starting from the same boolean map of rooms and clutter."""

from __future__ import annotations

import time
import timeit
from pathlib import Path

import networkx as nx
import numpy as np
import pyastar2d
import pytest
from movingai_maps import MAPS, read_map, read_scenarios
from navloom_astar import inflation, jump, search
from navloom_astar.jump import JumpPointSearch
from navloom_astar.search import Cell, DijkstraSearch, GridSearch, Way
from numpy.typing import NDArray
from scipy import ndimage

pytestmark = pytest.mark.benchmark
Queries = list[tuple[Cell, Cell]]
ROOT = 2.0**0.5


@pytest.fixture(scope="module")
def free() -> NDArray[np.bool_]:
    """512 x 512 cells: rooms of 31 x 31 with a door of 5 to each neighbour, and 5 % clutter."""
    return rooms_with(0.05)


def rooms_with(clutter: float, size: int = 512) -> NDArray[np.bool_]:
    """The connected part of the rooms, with a share of single cells occupied."""
    rng = np.random.default_rng(0)
    rooms = np.ones((size, size), dtype=np.bool_)
    rooms[::32] = rooms[:, ::32] = False
    for row in range(0, size, 32):
        for column in range(0, size, 32):
            across, up = rng.integers(2, 26, size=2)
            rooms[row, column + across : column + across + 5] = True
            rooms[row + up : row + up + 5, column] = True
    rooms &= rng.random(rooms.shape) >= clutter
    parts, _ = ndimage.label(rooms)
    return parts == np.bincount(parts[rooms]).argmax()


@pytest.fixture(scope="module")
def queries(free) -> Queries:
    return queries_on(free, 30)


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


def dense_grid(size: int, share: float, seed: int) -> NDArray[np.bool_]:
    """(size, size) the largest connected part of a grid with a share of single cells occupied."""
    free = np.random.default_rng(seed).random((size, size)) >= share
    parts, _ = ndimage.label(free)
    return parts == np.bincount(parts[free]).argmax()


def queries_on(free: NDArray[np.bool_], count: int) -> Queries:
    """Random starts and goals, (count, 2) cells."""
    cells = np.argwhere(free)
    picks = np.random.default_rng(1).integers(len(cells), size=(count, 2))
    return [(tuple(cells[a].tolist()), tuple(cells[b].tolist())) for a, b in picks]


def pyastar2d_over_ours(free: NDArray[np.bool_], queries: Queries) -> float:
    """Ratio of the times; pyastar2d gets a map that is converted already."""
    search.warm_up()
    grid, weights = GridSearch(free.shape), np.where(free, np.float32(1), np.float32(np.inf))
    ours, theirs = seconds(
        lambda: [grid.shortest(free, *ends) for ends in queries],
        lambda: [pyastar2d.astar_path(weights, *ends, allow_diagonal=True) for ends in queries],
    )
    return theirs / ours


@pytest.mark.parametrize("size", [256, 512, 1024])
@pytest.mark.parametrize("share", [0.2, 0.3, 0.4])
def test_on_dense_random_grids_it_is_as_fast_as_pyastar2d(size: int, share: float, benchmark) -> None:
    """pyastar2d cuts corners. At 40 % it has almost straight ways, where ours is a maze."""
    free = dense_grid(size, share, seed=0)
    ratio = benchmark.pedantic(pyastar2d_over_ours, (free, queries_on(free, 20)), rounds=1)
    benchmark.extra_info["pyastar2d_over_ours"] = ratio
    assert ratio >= 1.0


@pytest.mark.skipif(not MAPS, reason="NAVLOOM_DATA with a folder movingai is not set")
@pytest.mark.parametrize("path", MAPS, ids=lambda path: path.name.removesuffix(".map.gz"))
def test_on_movingai_maps_it_is_as_fast_as_pyastar2d(path: Path, benchmark) -> None:
    queries = [(start, goal) for _, start, goal, _ in read_scenarios(path)]
    ratio = benchmark.pedantic(pyastar2d_over_ours, (read_map(path), queries), rounds=1)
    benchmark.extra_info["pyastar2d_over_ours"] = ratio
    assert ratio >= 1.0


@pytest.mark.parametrize(("size", "share"), [(512, 0.4), (1024, 0.0), (1024, 0.4)])
def test_a_repaired_search_takes_a_fifth_of_a_new_one(size: int, share: float, benchmark) -> None:
    """The robot goes on by 10 cells, 0.5 m, and up to 5 boxes change within 100 cells of it."""
    search.warm_up()
    rng, free = np.random.default_rng(2), rooms_with(0.05, size) if share == 0.0 else dense_grid(size, share, 0)
    ratios = []

    def drive(start: Cell, goal: Cell) -> None:
        known, kept, new = free.copy(), GridSearch(free.shape), GridSearch(free.shape)
        way = kept.shortest(known, start, goal)
        while isinstance(way, Way) and len(way.cells) > 100:
            place = tuple(way.cells[10].tolist())
            for row, column in (place + rng.integers(-100, 101, size=(int(rng.integers(1, 6)), 2))).clip(0, size - 1):
                box = np.s_[row : row + int(rng.integers(1, 12)), column : column + int(rng.integers(1, 12))]
                known[box] = free[box] & (rng.random() < 0.5)
            known[place] = known[goal] = True
            new._kept = None
            begin = time.process_time()
            way = kept.shortest(known, place, goal)
            middle = time.process_time()
            new.shortest(known, place, goal)
            ratios.append((middle - begin) / (time.process_time() - middle))

    def drives() -> None:
        for ends in queries_on(free, 8):
            drive(*ends)

    benchmark.pedantic(drives, rounds=1)
    benchmark.extra_info["repaired_over_new"] = float(np.median(ratios))
    assert len(ratios) > 50 and np.median(ratios) <= 0.2


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
