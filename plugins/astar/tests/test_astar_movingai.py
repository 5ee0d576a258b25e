"""Optimal lengths of the MovingAI benchmarks (Sturtevant 2012), exact to the digits of the scenario files."""

from __future__ import annotations

from pathlib import Path

import pytest
from movingai_maps import MAPS, read_map, read_scenarios
from navloom_astar.jump import JumpPointSearch
from navloom_astar.search import DijkstraSearch, GridSearch, Way


@pytest.mark.skipif(not MAPS, reason="NAVLOOM_DATA with a folder movingai is not set")
@pytest.mark.parametrize("search", [GridSearch, DijkstraSearch, JumpPointSearch])
@pytest.mark.parametrize("path", MAPS, ids=lambda path: path.name.removesuffix(".map.gz"))
def test_all_scenarios_have_the_optimal_length(path: Path, search: type[GridSearch]) -> None:
    free = read_map(path)
    grid = search(free.shape)
    scenarios = read_scenarios(path)
    assert len(scenarios) == 50
    for shape, start, goal, optimal in scenarios:
        assert free.shape == shape
        way = grid.shortest(free, start, goal)
        assert isinstance(way, Way)
        assert way.length == pytest.approx(optimal, abs=0.01)
