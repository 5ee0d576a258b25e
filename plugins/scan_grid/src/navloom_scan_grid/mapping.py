"""From scans and the poses they were taken at to a map."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from navloom_ipabd.track import poses_at
from numpy.typing import NDArray

from navloom_scan_grid.grid import Box, LogOddsGrid
from navloom_scan_grid.kernels import Weights
from navloom_scan_grid.models import log_odds

__all__ = ["COUNTS", "Beams", "MapSettings", "ScanMap", "beam_poses", "place", "warm_up"]

Floats = NDArray[np.float64]

COUNTS = ("echo", "at_min", "beyond", "no_echo")
"""What becomes of a reading: an echo; one at the sensor's minimum; one farther than the map's reach; none."""


@dataclass(frozen=True)
class MapSettings:
    """How readings become a map.

    Attributes:
        weights: What readings count.
        cell: Edge of a cell, m.
        chunk: The map grows by this many cells at a time.
        extent: What it covers from the start, m, map frame.
        max_range: Farther than this nothing is taken, m.
        max_range_tolerance: A reading this near to the sensor's maximum is no echo, m.
        occupied_from: Log odds from which a cell is published as occupied.
        is_ternary: Publish 0 and 100 only, not percent.
        track_slack: How far the track of poses may miss a reading, s.
    """

    weights: Weights = field(
        default_factory=lambda: Weights(log_odds(0.7), log_odds(0.4), log_odds(0.6), log_odds(0.3), log_odds(0.12),
                                        log_odds(0.97), 0.0, 0.1, 0.1, True)
    )  # fmt: skip
    cell: float = 0.05
    chunk: int = 100
    extent: Box = (0.0, 0.0, 0.0, 0.0)
    max_range: float = 10.0
    max_range_tolerance: float = 0.01
    occupied_from: float = log_odds(0.65)
    is_ternary: bool = True
    track_slack: float = 0.2


@dataclass(frozen=True, eq=False)
class Beams:
    """One scan, in the base frame: the fields of a range scan.

    Attributes:
        stamp_ns: Run clock.
        origins: (n, 2) m. bearings, half_angles: (n,) rad. time_offsets: (n,) s after the stamp.
        ranges: (n,) m, +inf for no echo.
        range_min, range_max: m.
    """

    stamp_ns: int
    origins: Floats
    bearings: Floats
    half_angles: Floats
    time_offsets: Floats
    ranges: Floats
    range_min: float
    range_max: float

    @property
    def end_ns(self) -> int:
        """Run clock of the last beam."""
        return self.stamp_ns + (round(1e9 * float(self.time_offsets.max())) if self.time_offsets.size else 0)


def beam_poses(beams: Beams, stamps_ns: NDArray[np.int64], poses: Floats, slack: float) -> Floats:
    """Where base was when each beam was taken: (n, 3), or (1, 3) where all were taken at once; m, rad, map frame.

    Args:
        beams: The scan, not empty.
        stamps_ns, poses: (m,) and (m, 3) x, y, m, heading, rad, of base in the map frame.
        slack: How far the track may miss the scan, s.

    Raises:
        TrackError: The track is empty, does not rise or does not cover the scan.
    """
    offsets = beams.time_offsets
    first, last = float(offsets.min()), float(offsets.max())
    # A track holds minutes of poses, of which a scan needs those beside it.
    low = max(0, int(np.searchsorted(stamps_ns, beams.stamp_ns + round(1e9 * first), "right")) - 1)
    high = int(np.searchsorted(stamps_ns, beams.stamp_ns + round(1e9 * last), "left")) + 1
    track_offsets = (stamps_ns[low:high] - beams.stamp_ns).astype(np.float64) * 1e-9
    asked = np.array([first]) if first == last else offsets
    return poses_at(asked, track_offsets, poses[low:high], slack)


def place(beams: Beams, base_to_map: Floats, tolerance: float = 0.0) -> Floats:
    """Beams in the map frame.

    Args:
        beams: In the base frame.
        base_to_map: (n or 1, 3) x, y, m, heading, rad, of base at each beam.
        tolerance: A reading this near to the sensor's maximum is no echo, m.

    Returns:
        (n, 6) apex x, y, m; cosine and sine of the axis; reading, m, +inf for none; half angle, rad.
    """
    x, y, heading = base_to_map.T
    cos_t, sin_t = np.cos(heading), np.sin(heading)
    placed = np.empty((beams.ranges.size, 6))
    placed[:, 0] = x + cos_t * beams.origins[:, 0] - sin_t * beams.origins[:, 1]
    placed[:, 1] = y + sin_t * beams.origins[:, 0] + cos_t * beams.origins[:, 1]
    placed[:, 2], placed[:, 3] = np.cos(heading + beams.bearings), np.sin(heading + beams.bearings)
    placed[:, 4] = np.where(beams.ranges >= beams.range_max - tolerance, np.inf, beams.ranges)
    placed[:, 5] = beams.half_angles
    return placed


class ScanMap:
    """A map that takes scan after scan.

    Attributes:
        grid: What is known.
        counts: What became of the readings since `counts` was last emptied; names of `COUNTS`.
    """

    def __init__(self, settings: MapSettings) -> None:
        self.settings = settings
        self.grid = LogOddsGrid(settings.cell, settings.chunk, settings.extent)
        self.counts: Counter[str] = Counter()

    def insert(self, beams: Beams, stamps_ns: NDArray[np.int64], poses: Floats) -> None:
        """Take one scan in, with the track of poses that covers it; as of `beam_poses`.

        Raises:
            DataError: The track does not cover it, or the map would be too large. The map is as before.
        """
        if beams.ranges.size == 0:
            return
        use = self.settings
        base_to_map = beam_poses(beams, stamps_ns, poses, use.track_slack)
        placed = place(beams, base_to_map, use.max_range_tolerance)
        reach = min(beams.range_max, use.max_range)
        self.grid.cover(_box(placed, reach, max(0.5 * use.weights.thickness, use.weights.depth)))
        self.grid.insert(placed, (beams.range_min, reach), use.weights)
        self._count(placed[:, 4], beams.range_min, reach)

    def cells(self) -> NDArray[np.int8]:
        """(rows, columns) int8 of the map as published."""
        return self.grid.render(self.settings.occupied_from, self.settings.is_ternary)

    def _count(self, readings: Floats, range_min: float, reach: float) -> None:
        at_min = int(np.count_nonzero(readings <= range_min))
        within = int(np.count_nonzero(readings <= reach))
        finite = int(np.count_nonzero(readings < np.inf))
        for name, count in zip(COUNTS, (within - at_min, at_min, finite - within, readings.size - finite), strict=True):
            self.counts[name] += count


def _box(placed: Floats, reach: float, beyond: float) -> Box:
    """What a scan speaks of: apexes, and the corners in which a cone's flanks meet the tangent at its tip."""
    x, y, cos_a, sin_a, readings, half_angles = placed.T
    far = np.minimum(readings, reach) + beyond
    sideways = far * np.tan(half_angles)
    along_x, along_y = x + far * cos_a, y + far * sin_a
    side_x, side_y = sideways * sin_a, sideways * cos_a
    xs = np.concatenate([x, along_x - side_x, along_x + side_x])
    ys = np.concatenate([y, along_y - side_y, along_y + side_y])
    return float(xs.min()), float(ys.min()), float(xs.max()), float(ys.max())


def warm_up() -> None:
    """Compile every kernel of the package, for the very types that scans come in."""
    beams = Beams(0, np.zeros((2, 2)), np.zeros(2), np.array([0.0, 0.1]), np.zeros(2), np.ones(2), 0.1, 2.0)
    for is_ternary in (False, True):
        scan_map = ScanMap(MapSettings(cell=0.5, chunk=4, is_ternary=is_ternary))
        scan_map.insert(beams, np.zeros(1, np.int64), np.zeros((1, 3)))
        scan_map.cells()
