"""Speed as ratios within one run."""

import timeit

import numpy as np
import pytest
from navloom_avoidance.certainty import clear_cone, new_window
from navloom_avoidance.histogram import enlarged_density


def numpy_enlarged_density(cells, radius, reach, sectors):
    """The same histogram in numpy, for comparison and as an oracle."""
    distance = np.hypot(cells[:, 0], cells[:, 1])
    bearing = np.arctan2(cells[:, 1], cells[:, 0])
    magnitude = np.where(distance < reach, cells[:, 2] ** 2 * (1.0 - distance / reach) / 9.0, 0.0)
    gamma = np.arcsin(np.minimum(1.0, radius / distance))
    centres = (np.arange(sectors) + 0.5) * 2.0 * np.pi / sectors
    off = np.abs((centres[None, :] - bearing[:, None] + np.pi) % (2.0 * np.pi) - np.pi)
    return np.where(off <= gamma[:, None], magnitude[:, None], 0.0).max(axis=0)


def scene():
    rng = np.random.default_rng(5)
    turn, distance = rng.uniform(-np.pi, np.pi, 60), rng.uniform(0.5, 1.6, 60)
    return np.column_stack((distance * np.cos(turn), distance * np.sin(turn), rng.choice([2.0, 3.0], 60)))


def test_histogram_agrees_with_numpy():
    """Cells all farther than the radius, so that no shade is narrower than a sector."""
    density = np.zeros(72)
    enlarged_density(scene(), 0.0, 0.47, 1.3, density)
    np.testing.assert_allclose(density, numpy_enlarged_density(scene(), 0.47, 1.3, 72), atol=1e-12)


@pytest.mark.benchmark
def test_histogram_against_numpy(benchmark):
    cells, density = scene(), np.zeros(72)
    benchmark(enlarged_density, cells, 0.0, 0.47, 1.3, density)
    reference = min(timeit.repeat(lambda: numpy_enlarged_density(cells, 0.47, 1.3, 72), number=50, repeat=5)) / 50
    assert reference > 5.0 * benchmark.stats.stats.min


def numpy_clear_cone(grid, origin, cell, apex, axis, half_angle, near, far, margin):
    """The cells of one cone in numpy, over the whole window."""
    rows, columns = np.mgrid[: grid.shape[0], : grid.shape[1]]
    dx = (origin[0] + columns + 0.5) * cell - apex[0]
    dy = (origin[1] + rows + 0.5) * cell - apex[1]
    along, across = dx * axis[0] + dy * axis[1], np.abs(dy * axis[0] - dx * axis[1])
    square = dx * dx + dy * dy
    inside = along * np.sin(half_angle) - across * np.cos(half_angle) >= margin
    grid[inside & (square >= near * near) & (square < far * far)] = 0


def cone(bearing):
    grid, origin = new_window(33)
    grid[:], origin[:] = 2, -16
    axis = (float(np.cos(bearing)), float(np.sin(bearing)))
    return grid, origin, 0.1, (0.05, 0.02), axis, 0.26, 0.3, 1.2, 0.05


@pytest.mark.parametrize("bearing", np.radians([-170.0, -90.0, -31.0, 3.0, 50.0, 90.0, 127.0, 180.0]))
def test_cone_agrees_with_numpy(bearing):
    ours, theirs = cone(bearing), cone(bearing)
    clear_cone(*ours)
    numpy_clear_cone(*theirs)
    np.testing.assert_array_equal(ours[0], theirs[0])
    assert 10 < (ours[0] == 0).sum() < 60


@pytest.mark.benchmark
def test_cone_against_numpy(benchmark):
    benchmark(clear_cone, *cone(0.5))
    arguments = cone(0.5)
    reference = min(timeit.repeat(lambda: numpy_clear_cone(*arguments), number=50, repeat=5)) / 50
    assert reference > 5.0 * benchmark.stats.stats.min
