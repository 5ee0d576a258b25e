"""Speed as a ratio within one run: a scan against the same cells added one by one in numpy, and against the tick."""

import timeit

import numpy as np
import pytest
from navloom_scan_grid.mapping import Beams, MapSettings, ScanMap, warm_up

BEAMS = 181


def scan():
    bearings = np.radians(np.linspace(-90.0, 90.0, BEAMS))
    ranges = 5.0 + 2.0 * np.sin(7.0 * bearings)
    zeros = np.zeros(BEAMS)
    return Beams(0, np.zeros((BEAMS, 2)), bearings, zeros, zeros, ranges, 0.05, 10.0)


def numpy_insert(odds, beams, cell, origin):
    """The same beams, sampled every half cell, in numpy: cells seen through, then cells of echoes."""
    along = np.arange(0.0, 10.0, 0.5 * cell)
    points = along[None, :, None] * np.stack([np.cos(beams.bearings), np.sin(beams.bearings)], axis=-1)[:, None, :]
    cells = np.floor((points[along[None, :] < beams.ranges[:, None]] - origin) / cell).astype(int)
    free = np.unique(cells[:, 1] * odds.shape[1] + cells[:, 0])
    odds.ravel()[free] = np.clip(odds.ravel()[free] - 0.4, -2.0, 3.5)


@pytest.mark.benchmark
def test_a_scan_of_181_beams_takes_less_than_in_numpy(benchmark):
    warm_up()
    scan_map, stamps, poses = ScanMap(MapSettings()), np.zeros(1, np.int64), np.zeros((1, 3))
    beams = scan()
    scan_map.insert(beams, stamps, poses)
    benchmark(scan_map.insert, beams, stamps, poses)
    odds = np.zeros(scan_map.grid.odds.shape, np.float32)
    other = min(timeit.repeat(lambda: numpy_insert(odds, beams, 0.05, scan_map.grid.origin), number=1, repeat=10))
    benchmark.extra_info["numpy_over_kernel"] = other / benchmark.stats.stats.min
    assert other > 3.0 * benchmark.stats.stats.min
