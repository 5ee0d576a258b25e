"""From range scans to what the method takes: each laser by itself, and all sonars in one set."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from navloom import RangeScan
from navloom_improved_vfh.avoidance import Beams
from navloom_improved_vfh.certainty import THIN_BEAM


def is_laser(scan: RangeScan) -> bool:
    """Whether all beams of a scan are lines."""
    return bool((scan.half_angles < THIN_BEAM).all())


def beams_of(scan: RangeScan, sensor: int) -> Beams:
    """One scan as beams; `sensor` is its number."""
    limits = np.broadcast_to(np.array([scan.range_min, scan.range_max]), (scan.ranges.size, 2)).copy()
    return Beams(scan.origins, scan.bearings, scan.half_angles, scan.ranges, limits, np.full(scan.ranges.size, sensor))


def split_scans(scans: Sequence[RangeScan]) -> tuple[list[Beams], Beams | None]:
    """Lasers, and the sonars joined; scans without a beam are left out."""
    lasers: list[Beams] = []
    sonars: list[Beams] = []
    for number, scan in enumerate(scans):
        if scan.ranges.size:
            (lasers if is_laser(scan) else sonars).append(beams_of(scan, number))
    if len(sonars) < 2:
        return lasers, sonars[0] if sonars else None
    parts = zip(*[(b.origins, b.bearings, b.half_angles, b.ranges, b.limits, b.sensors) for b in sonars], strict=True)
    return lasers, Beams(*[np.concatenate(part) for part in parts])
