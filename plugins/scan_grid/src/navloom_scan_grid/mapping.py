"""Builds a map from scans and the poses at which they were taken."""

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
"""Kinds of readings: an echo; one at the sensor's minimum range; one beyond the map's reach; no echo."""


@dataclass(frozen=True)
class MapSettings:
    """Settings by which readings become a map.

    Attributes:
        weights: Weights of the readings.
        cell: Edge of a cell, m.
        chunk: The map grows by this many cells at a time.
        extent: Area covered from the start, m, map frame.
        max_range: Readings are used up to this range, m.
        max_range_tolerance: A reading this near to the sensor's maximum range counts as no echo, m.
        occupied_from: Log odds from which a cell is published as occupied.
        is_ternary: Publish known cells as 0 or 100 only, not as percentages.
        track_slack: Longest time by which a reading may lie outside the track of poses, s.
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
        stamp_ns: Time of the scan on the run clock.
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
        """Time of the last beam on the run clock."""
        return self.stamp_ns + (round(1e9 * kernels.span(self.time_offsets)[1]) if self.time_offsets.size else 0)


class Placed(NamedTuple):
    """A scan in the map frame.

    Attributes:
        beams: (n, 6) apex x, y, m; cosine and sine of the axis; reading, m, +inf for none; half angle, rad.
        box: Area that its readings can change.
        counts: Number of its readings of each kind, in the order of `COUNTS`.
        limits: Smallest reading and reach, m.
    """

    beams: Floats
    box: Box
    counts: tuple[int, int, int, int]
    limits: tuple[float, float]


def place(beams: Beams, stamps_ns: NDArray[np.int64], poses: Floats, settings: MapSettings) -> Placed:
    """Transforms a scan to the map frame, each beam by the pose of the base when the beam was measured.

    Args:
        beams: The scan, not empty.
        stamps_ns, poses: (m,) times on the run clock and (m, 3) x, y, m, heading, rad, of the base in the map frame.
        settings: Only the weights' depths, the ranges and the track's slack are used.

    Raises:
        TrackError: The track is empty, its times do not increase, or it does not cover the scan.
    """
    offsets = beams.time_offsets
    first, last = kernels.span(offsets)
    # A track holds minutes of poses; a scan needs only those around its own time.
    low = max(0, int(stamps_ns.searchsorted(beams.stamp_ns + round(1e9 * first), "right")) - 1)
    high = int(stamps_ns.searchsorted(beams.stamp_ns + round(1e9 * last), "left")) + 1
    track_offsets = (stamps_ns[low:high] - beams.stamp_ns).astype(np.float64) * 1e-9
    track_poses = np.array(poses[low:high], dtype=np.float64, order="C")
    check_track(first, last, track_offsets, track_poses, settings.track_slack)
    # One new writable array: for the five read-only ones of a message, numba would compile the kernel again.
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
    """A map built from scans, one after another.

    Attributes:
        grid: Log odds of occupancy.
        counts: Number of readings of each kind, by the names of `COUNTS`, since `counts` was last cleared.
    """

    def __init__(self, settings: MapSettings) -> None:
        self.settings = settings
        self.grid = LogOddsGrid(settings.cell, settings.chunk, settings.extent)
        self.counts: Counter[str] = Counter()

    def insert(self, beams: Beams, stamps_ns: NDArray[np.int64], poses: Floats) -> None:
        """Add one scan, with the track of poses that covers it; arguments as in `place`.

        Raises:
            DataError: The track does not cover the scan, or the map would be too large. The map is unchanged.
        """
        if beams.ranges.size == 0:
            return
        placed = place(beams, stamps_ns, poses, self.settings)
        self.grid.cover(placed.box)
        self.grid.insert(placed.beams, placed.limits, self.settings.weights)
        for name, count in zip(COUNTS, placed.counts, strict=True):
            self.counts[name] += count

    def cells(self) -> NDArray[np.int8]:
        """(rows, columns) int8 cells of the map as published."""
        return self.grid.render(self.settings.occupied_from, self.settings.is_ternary)


def warm_up() -> None:
    """Compile every kernel of the package for the array types of real scans."""
    beams = Beams(0, np.zeros((2, 2)), np.zeros(2), np.array([0.0, 0.1]), np.zeros(2), np.ones(2), 0.1, 2.0)
    kernels.span(_frozen(beams.time_offsets))
    for is_ternary in (False, True):
        scan_map = ScanMap(MapSettings(cell=0.5, chunk=4, is_ternary=is_ternary))
        scan_map.insert(beams, np.zeros(1, np.int64), np.zeros((1, 3)))
        scan_map.cells()


def _frozen(array: Floats) -> Floats:
    """A read-only copy, like the arrays of messages; numba treats it as a type of its own."""
    copy = array.copy()
    copy.setflags(write=False)
    return copy
