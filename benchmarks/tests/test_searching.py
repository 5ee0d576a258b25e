"""The measure of the search: its scans end at the walls, and its rows count what was found."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from navloom.messages import OccupancyGrid, Pose2D

sys.path.insert(0, str(Path(__file__).parents[1]))
from searching import filter_times, scan_at, search_times


@pytest.fixture(scope="module")
def room() -> OccupancyGrid:
    """A room of 6 m x 4 m with a pillar, so that each place looks different."""
    cells = np.full((40, 60), 100, dtype=np.int8)
    cells[1:-1, 1:-1] = 0
    cells[10:16, 40:46] = 100
    return OccupancyGrid(cells, 0.1, Pose2D(0.0, 0.0, 0.0))


def test_a_scan_ends_at_the_walls(room: OccupancyGrid) -> None:
    from navloom_mcl.params import MclParams
    from navloom_scans.maps import field_of_map

    beams, heard = scan_at(field_of_map(room, MclParams()), np.array([2.0, 2.0, 0.0]), 0.0, np.random.default_rng(0))
    assert heard == 361
    # The middle beam looks along x, at the wall whose face is at 5.9 m.
    assert beams[180, :2] == pytest.approx([3.9, 0.0], abs=0.06)


def test_the_rows_count_what_was_found(room: OccupancyGrid) -> None:
    row = search_times(room, 5, 0.0)
    assert (row["first"], row["complete"], row["scans"]) == (5, 5, 5)
    assert set(filter_times(room, 200)) == {"predict_us", "correct_us", "hypotheses_us"}
