"""Where a map blocks a trajectory, compared with the distance of every sample to every occupied cell."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from navloom.geometry.frames import transform
from navloom.messages import OccupancyGrid, Pose2D
from navloom.navigation.blocked_trajectory import first_blocked


def slow(samples: np.ndarray, progress: float, radius: float, grid: OccupancyGrid) -> float:
    rows, columns = np.nonzero(grid.cells >= 50)
    centres = np.stack([columns + 0.5, rows + 0.5], axis=1) * grid.resolution
    centres = transform(np.array([grid.origin.x, grid.origin.y, grid.origin.heading]), centres)
    for length, x, y in samples[:, :3]:
        if length >= progress and (np.hypot(centres[:, 0] - x, centres[:, 1] - y) <= radius).any():
            return float(length)
    return math.inf


@given(
    seed=st.integers(0, 2**32 - 1),
    heading=st.floats(-3.0, 3.0),
    radius=st.floats(0.0, 1.0),
    progress=st.floats(0.0, 6.0),
)
def test_it_is_the_first_sample_that_is_too_near(seed: int, heading: float, radius: float, progress: float) -> None:
    random = np.random.default_rng(seed)
    cells = np.where(random.random((12, 17)) < 0.05, 100, -1).astype(np.int8)
    grid = OccupancyGrid(cells, 0.25, Pose2D(-1.0, 0.5, heading))
    samples = np.zeros((60, 6))
    samples[:, 0] = np.linspace(0.0, 6.0, 60)
    samples[:, 1:3] = np.cumsum(random.normal(size=(60, 2)), axis=0) * 0.2
    assert first_blocked(samples, progress, radius, grid) == slow(samples, progress, radius, grid)


@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (3, 3)])
def test_an_empty_or_a_free_map_blocks_nothing(shape: tuple[int, int]) -> None:
    grid = OccupancyGrid(np.full(shape, -1, dtype=np.int8), 0.1, Pose2D(0.0, 0.0, 0.0))
    assert first_blocked(np.zeros((3, 6)), 0.0, 1.0, grid) == math.inf
