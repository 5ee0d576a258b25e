"""The pass that places a scan, compared with plain numpy on random scans and tracks, and its map, compared with a walk
over cells in Python."""

from __future__ import annotations

import math

import numpy as np
import pytest
from navloom_scan_grid.kernels import Weights
from navloom_scan_grid.mapping import COUNTS, Beams, MapSettings, Placed, ScanMap, place
from numpy.typing import NDArray

Floats = NDArray[np.float64]
STAMP_NS = 7_000_000_000
SETTINGS = MapSettings(cell=0.1, chunk=10, max_range=5.0, max_range_tolerance=0.05, track_slack=0.02)


def scan_and_track(seed: int, spread: float, opening: float) -> tuple[Beams, NDArray[np.int64], Floats]:
    """60 beams, some at the minimum, some beyond the reach, some without echo; headings that cross ±π.

    Args:
        spread: Time within which the beams are taken, s.
        opening: Half angle of every third beam, rad.
    """
    rng, n = np.random.default_rng(seed), 60
    ranges = rng.uniform(0.2, 7.5, n)
    ranges[rng.integers(n, size=6)], ranges[rng.integers(n, size=6)] = math.inf, 0.2
    ranges[rng.integers(n, size=3)] = 7.96  # within the tolerance of the maximum
    half_angles = np.where(np.arange(n) % 3 == 0, opening, 0.0)
    beams = Beams(STAMP_NS, rng.uniform(-0.3, 0.3, (n, 2)), rng.uniform(-2.0, 2.0, n), half_angles,
                  rng.uniform(0.0, spread, n), ranges, 0.2, 8.0)  # fmt: skip
    stamps = STAMP_NS + np.cumsum(rng.integers(10_000_000, 60_000_000, 12)) - 200_000_000
    steps = rng.uniform([-0.2, -0.2, -2.0], [0.2, 0.2, 2.0], (12, 3))
    poses = np.cumsum(steps, axis=0)
    poses[:, 2] = np.mod(poses[:, 2] + math.pi, math.tau) - math.pi
    return beams, stamps, poses


def numpy_place(beams: Beams, stamps_ns: NDArray[np.int64], poses: Floats, use: MapSettings) -> Placed:
    """The same with `np.interp`, `np.unwrap` and whole columns."""
    # From the pose before the first beam on: where unwrapping begins decides the whole turns of a heading.
    low = max(0, int(np.searchsorted(stamps_ns, STAMP_NS + round(1e9 * beams.time_offsets.min()), "right")) - 1)
    offsets, poses = (stamps_ns[low:] - beams.stamp_ns) * 1e-9, poses[low:]
    columns = (poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
    x, y, heading = (np.interp(beams.time_offsets, offsets, column) for column in columns)
    cos_t, sin_t, origin = np.cos(heading), np.sin(heading), beams.origins
    apex_x, apex_y = x + cos_t * origin[:, 0] - sin_t * origin[:, 1], y + sin_t * origin[:, 0] + cos_t * origin[:, 1]
    cos_a, sin_a = np.cos(heading + beams.bearings), np.sin(heading + beams.bearings)
    readings = np.where(beams.ranges >= beams.range_max - use.max_range_tolerance, np.inf, beams.ranges)
    far = np.minimum(readings, use.max_range) + max(0.5 * use.weights.thickness, use.weights.depth)
    sideways = far * np.tan(beams.half_angles)
    xs = np.concatenate([apex_x, *(apex_x + far * cos_a + k * sideways * sin_a for k in (-1, 1))])
    ys = np.concatenate([apex_y, *(apex_y + far * sin_a + k * sideways * cos_a for k in (-1, 1))])
    at_min, finite = readings <= beams.range_min, readings < np.inf
    beyond = finite & (readings > use.max_range)
    counts = (finite & ~at_min & ~beyond, at_min, beyond, ~finite)
    return Placed(
        np.column_stack([apex_x, apex_y, cos_a, sin_a, readings, beams.half_angles]),
        (float(xs.min()), float(ys.min()), float(xs.max()), float(ys.max())),
        tuple(int(of.sum()) for of in counts),
        (beams.range_min, use.max_range),
    )


@pytest.mark.parametrize("opening", [0.0, 0.26], ids=["lines", "cones"])
@pytest.mark.parametrize("spread", [0.0, 0.1], ids=["at once", "one after another"])
def test_a_scan_is_placed_as_in_plain_numpy(spread: float, opening: float) -> None:
    """Sines and cosines of numpy and of the kernel may differ in their last bit; on x86-64 with AVX2 they do not."""
    for seed in range(40):
        given = scan_and_track(seed, spread, opening)
        got, wanted = place(*given, SETTINGS), numpy_place(*given, SETTINGS)
        assert got.counts == wanted.counts and sum(got.counts) == 60
        assert got.limits == wanted.limits
        np.testing.assert_allclose(got.beams, wanted.beams, rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(got.box, wanted.box, rtol=0.0, atol=1e-14)


def line(x0: float, y0: float, x1: float, y1: float) -> list[tuple[int, int]]:
    """Cells (column, row) from end to end, in cells: at each border the nearer of the two next ones is crossed."""
    cell, last = [math.floor(x0), math.floor(y0)], [math.floor(x1), math.floor(y1)]
    ways, cells = [x1 - x0, y1 - y0], [tuple(cell)]
    starts = (x0, y0)
    while cell != last:
        shares = [
            abs((cell[k] + (ways[k] >= 0.0) - starts[k]) / ways[k]) if cell[k] != last[k] else math.inf for k in (0, 1)
        ]
        k = 0 if shares[0] < shares[1] else 1
        cell[k] += 1 if ways[k] >= 0.0 else -1
        cells.append((cell[0], cell[1]))
    return cells


def walked(odds: dict[tuple[int, int], np.float32], placed: Placed, w: Weights, cell: float) -> None:
    """Insert one scan of beams by the rules: an echo wins over a passing beam, and each cell changes once."""
    hit, passed = set(), set()
    for x, y, cos_a, sin_a, reading, _ in placed.beams.tolist():
        _, reach = placed.limits
        is_echo = reading <= reach
        near = reading - 0.5 * w.thickness if is_echo else reach
        free = 0.0 if reading <= placed.limits[0] else max(0.0, near - w.clear_margin) if is_echo else reach
        for begin, end, of in ((0.0, free, passed), (near, reading + 0.5 * w.thickness, hit)):
            if (of is hit and not is_echo) or end == 0.0:
                continue
            ends = (x + begin * cos_a, y + begin * sin_a, x + end * cos_a, y + end * sin_a)
            of.update(line(*(value / cell for value in ends)))
    for told, value in ((hit, w.hit), (passed - hit, w.passed)):
        for at in told:
            odds[at] = np.float32(min(max(float(odds.get(at, 0.0)) + value, w.lowest), w.highest))


@pytest.mark.parametrize("thickness", [0.0, 0.3], ids=["thin", "thick"])
def test_a_map_of_random_scans_is_that_of_cells_walked_one_by_one(thickness: float) -> None:
    """To the bit, over scans that make the grid grow."""
    use = MapSettings(cell=0.1, chunk=10, max_range=5.0, weights=MapSettings().weights._replace(thickness=thickness))
    scan_map, odds, counts = ScanMap(use), {}, np.zeros(4, int)
    for seed in range(12):
        given = scan_and_track(seed, 0.1, 0.0)
        placed = place(*given, use)
        scan_map.insert(*given)
        walked(odds, placed, use.weights, use.cell)
        counts += placed.counts
    known = np.argwhere(~np.isnan(scan_map.grid.odds))
    b = scan_map.grid.bounds
    got = {(int(c) + b.column, int(r) + b.row): scan_map.grid.odds[r, c] for r, c in known}
    assert got == odds
    assert [scan_map.counts[name] for name in COUNTS] == counts.tolist()
