"""From scans and the poses they were taken at to a map."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from navloom_ipabd.track import check_track
from numpy.typing import NDArray

from navloom_scan_grid import kernels
from navloom_scan_grid.grid import Box, LogOddsGrid
from navloom_scan_grid.kernels import Weights
from navloom_scan_grid.models import log_odds

__all__ = ["COUNTS", "Beams", "MapSettings", "Placed", "ScanMap", "place", "warm_up"]

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
        return self.stamp_ns + (round(1e9 * kernels.span(self.time_offsets)[1]) if self.time_offsets.size else 0)


class Placed(NamedTuple):
    """A scan in the map frame.

    Attributes:
        beams: (n, 6) apex x, y, m; cosine and sine of the axis; reading, m, +inf for none; half angle, rad.
        box: What it speaks of.
        counts: What became of its readings, in the order of `COUNTS`.
        limits: Least reading and reach, m.
    """

    beams: Floats
    box: Box
    counts: tuple[int, int, int, int]
    limits: tuple[float, float]


def place(beams: Beams, stamps_ns: NDArray[np.int64], poses: Floats, settings: MapSettings) -> Placed:
    """A scan in the map frame, each beam where base was when it was taken.

    Args:
        beams: The scan, not empty.
        stamps_ns, poses: (m,) and (m, 3) x, y, m, heading, rad, of base in the map frame.
        settings: Of which the weights' depths, the ranges and the track's slack are used.

    Raises:
        TrackError: The track is empty, does not rise or does not cover the scan.
    """
    offsets = beams.time_offsets
    first, last = kernels.span(offsets)
    # A track holds minutes of poses, of which a scan needs those beside it.
    low = max(0, int(stamps_ns.searchsorted(beams.stamp_ns + round(1e9 * first), "right")) - 1)
    high = int(stamps_ns.searchsorted(beams.stamp_ns + round(1e9 * last), "left")) + 1
    track_offsets = (stamps_ns[low:high] - beams.stamp_ns).astype(np.float64) * 1e-9
    track_poses = np.array(poses[low:high], dtype=np.float64, order="C")
    check_track(first, last, track_offsets, track_poses, settings.track_slack)
    # One array of its own instead of five of a message, which are read-only: a kernel is compiled anew for that.
    table = np.empty((beams.ranges.size, 5))
    table[:, :2], table[:, 2], table[:, 3] = beams.origins, beams.bearings, beams.half_angles
    table[:, 4] = beams.ranges
    times = np.array([first]) if first == last else np.array(offsets, dtype=np.float64, order="C")
    limits = float(beams.range_min), float(min(beams.range_max, settings.max_range))
    beyond = max(0.5 * settings.weights.thickness, settings.weights.depth)
    no_echo_from = float(beams.range_max - settings.max_range_tolerance)
    placed, box, counts = kernels.place(table, times, track_offsets, track_poses, no_echo_from, limits, beyond)
    return Placed(placed, box, counts, limits)


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
        """Take one scan in, with the track of poses that covers it; as of `place`.

        Raises:
            DataError: The track does not cover it, or the map would be too large. The map is as before.
        """
        if beams.ranges.size == 0:
            return
        placed = place(beams, stamps_ns, poses, self.settings)
        self.grid.cover(placed.box)
        self.grid.insert(placed.beams, placed.limits, self.settings.weights)
        for name, count in zip(COUNTS, placed.counts, strict=True):
            self.counts[name] += count

    def cells(self) -> NDArray[np.int8]:
        """(rows, columns) int8 of the map as published."""
        return self.grid.render(self.settings.occupied_from, self.settings.is_ternary)


def warm_up() -> None:
    """Compile every kernel of the package, for the very types that scans come in."""
    beams = Beams(0, np.zeros((2, 2)), np.zeros(2), np.array([0.0, 0.1]), np.zeros(2), np.ones(2), 0.1, 2.0)
    kernels.span(_frozen(beams.time_offsets))
    for is_ternary in (False, True):
        scan_map = ScanMap(MapSettings(cell=0.5, chunk=4, is_ternary=is_ternary))
        scan_map.insert(beams, np.zeros(1, np.int64), np.zeros((1, 3)))
        scan_map.cells()


def _frozen(array: Floats) -> Floats:
    """A read-only copy, as messages hold arrays: another type to a kernel."""
    copy = array.copy()
    copy.setflags(write=False)
    return copy
