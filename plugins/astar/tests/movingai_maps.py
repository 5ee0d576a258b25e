"""The MovingAI benchmarks (Sturtevant 2012) in the folder `NAVLOOM_DATA`."""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import numpy as np
from navloom_astar.search import Cell
from numpy.typing import NDArray

FOLDER = Path(os.environ.get("NAVLOOM_DATA", "")) / "movingai"
MAPS = sorted(FOLDER.glob("*.map.gz")) if os.environ.get("NAVLOOM_DATA") else []


def read_map(path: Path) -> NDArray[np.bool_]:
    """(rows, columns) passable, row 0 at the top as in the scenario files."""
    lines = gzip.decompress(path.read_bytes()).splitlines()
    assert lines[0] == b"type octile" and lines[3] == b"map"
    return np.array([[cell in b".GS" for cell in line] for line in lines[4:]])


def read_scenarios(path: Path) -> list[tuple[tuple[int, int], Cell, Cell, float]]:
    """Shape of the map, start, goal and optimal length, cells, of each scenario of a map."""
    found = []
    for line in path.with_suffix(".scen").read_text("utf-8").splitlines()[1:]:
        width, height, x0, y0, x1, y1, optimal = line.split()[-7:]
        shape, start, goal = ((int(row), int(column)) for row, column in ((height, width), (y0, x0), (y1, x1)))
        found.append((shape, start, goal, float(optimal)))
    return found
