"""The search of the shortest path, measured."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from navloom_optimal import shortest_path

sys.path.insert(0, str(Path(__file__).parents[1]))
from shortest_way import WORLDS, measured


@pytest.mark.benchmark
@pytest.mark.parametrize("kind", list(WORLDS))
def test_the_work_of_the_search_grows_with_the_boxes(kind: str) -> None:
    shortest_path.warm_up()
    few, many = measured(kind, 250), measured(kind, 1000)
    assert many["looked_at"] < 12 * few["looked_at"]  # the number of all pairs grows by 16
