"""The way out of the inflation, compared with shortest paths over a graph of all cells."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from navloom_astar.escape import way_out
from navloom_astar.inflation import disc_reach, grow
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph


def distances_from(occupied: NDArray[np.bool_], start: tuple[int, int]) -> NDArray[np.float64]:
    """(rows, columns) lengths of shortest paths round obstacles, without cutting corners; infinite where none."""
    rows, columns = occupied.shape
    number, graph = np.arange(occupied.size).reshape(occupied.shape), sparse.lil_matrix((occupied.size,) * 2)
    for row, column in np.argwhere(~occupied):
        for down, across in ((0, 1), (1, 0), (1, 1), (1, -1)):
            other = row + down, column + across
            if other[0] >= rows or not 0 <= other[1] < columns:
                continue
            if not (occupied[other] or occupied[row, other[1]] or occupied[other[0], column]):
                graph[number[row, column], number[other]] = math.hypot(down, across)
    found = csgraph.dijkstra(graph.tocsr(), directed=False, indices=number[start])
    return found.reshape(occupied.shape)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.tuples(st.integers(2, 12), st.integers(2, 12)),
    st.sampled_from([0.03, 0.1, 0.25]),
    st.floats(0.6, 2.5),
    st.floats(0.5, 5.0),
)
def test_the_way_out_is_the_shortest_to_the_side_of_the_goal_if_that_is_in_reach(
    seed, shape, density, radius, within
) -> None:
    rng = np.random.default_rng(seed)
    occupied = rng.random(shape) < density
    traversable = ~grow(occupied, disc_reach(radius))
    starts, goals = np.argwhere(~occupied & ~traversable), np.argwhere(traversable)
    if not len(starts) or not len(goals):
        return
    start, goal = tuple(rng.choice(starts).tolist()), tuple(rng.choice(goals).tolist())
    way = way_out(occupied, traversable, start, goal, within)
    distances = distances_from(occupied, start)
    parts, _ = ndimage.label(traversable)
    in_reach = traversable & (distances <= within + 1e-9)
    wanted = in_reach & (parts == parts[goal]) if (in_reach & (parts == parts[goal])).any() else in_reach
    if not wanted.any():
        assert way is None
        return
    assert way is not None and way[0] == start and wanted[way[-1]]
    steps = np.abs(np.diff(way, axis=0))
    assert steps.max() == 1 and not any(occupied[cell] for cell in way)
    assert np.hypot(*steps.T).sum() == pytest.approx(distances[wanted].min(), abs=1e-7)


def test_the_side_of_the_goal_comes_before_the_nearer_one() -> None:
    """A wall from edge to edge with a gap, in which the start is: free space is one cell up and two down."""
    occupied = np.zeros((7, 9), dtype=np.bool_)
    occupied[3] = True
    occupied[3, 4] = False
    traversable = ~occupied
    traversable[3, 4] = traversable[2, 4] = False
    assert way_out(occupied, traversable, (3, 4), (0, 0), 3.0) == [(3, 4), (2, 4), (1, 4)]
    assert way_out(occupied, traversable, (3, 4), (6, 8), 3.0) == [(3, 4), (4, 4)]
    assert way_out(occupied, traversable, (3, 4), (0, 0), 1.0) == [(3, 4), (4, 4)]  # no other side in reach
