"""Optimal lengths of the MovingAI benchmarks (Sturtevant 2012), exact to the digits of the scenario files."""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import numpy as np
import pytest
from navloom_astar.jump import JumpPointSearch
from navloom_astar.search import DijkstraSearch, GridSearch, Way
from numpy.typing import NDArray

FOLDER = Path(os.environ.get("NAVLOOM_DATA", "")) / "movingai"
MAPS = sorted(FOLDER.glob("*.map.gz")) if os.environ.get("NAVLOOM_DATA") else []


def read_map(path: Path) -> NDArray[np.bool_]:
    """(rows, columns) passable, row 0 at the top as in the scenario files."""
    lines = gzip.decompress(path.read_bytes()).splitlines()
    assert lines[0] == b"type octile" and lines[3] == b"map"
    return np.array([[cell in b".GS" for cell in line] for line in lines[4:]])


@pytest.mark.skipif(not MAPS, reason="NAVLOOM_DATA with a folder movingai is not set")
@pytest.mark.parametrize("search", [GridSearch, DijkstraSearch, JumpPointSearch])
@pytest.mark.parametrize("path", MAPS, ids=lambda path: path.name.removesuffix(".map.gz"))
def test_all_scenarios_have_the_optimal_length(path: Path, search: type[GridSearch]) -> None:
    free = read_map(path)
    grid = search(free.shape)
    lines = path.with_suffix(".scen").read_text("utf-8").splitlines()[1:]
    assert len(lines) == 50
    for line in lines:
        width, height, x0, y0, x1, y1, optimal = line.split()[-7:]
        assert free.shape == (int(height), int(width))
        way = grid.shortest(free, (int(y0), int(x0)), (int(y1), int(x1)))
        assert isinstance(way, Way)
        assert way.length == pytest.approx(float(optimal), abs=0.01)
