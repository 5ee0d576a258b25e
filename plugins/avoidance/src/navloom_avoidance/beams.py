"""The scans of a tick joined to one set of beams, in arrays that are reused from tick to tick."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from navloom_avoidance.certainty import THIN_BEAM
from navloom_avoidance.smoothing import smoothed

__all__ = ["Beams", "Joiner", "Scan"]

Floats = NDArray[np.float64]


class Beams(NamedTuple):
    """Readings of all range sensors in one tick, base frame.

    Attributes:
        origins: (n, 2) origin of each beam, m.
        bearings: (n,) direction of each beam's axis, rad.
        half_angles: (n,) half the opening angle, rad; 0 for a laser.
        ranges: (n,) m, +inf for no echo.
        limits: (n, 2) range_min and range_max of each beam, m.
        sensors: (n,) int64, number of each beam's sensor.

    The first four are read-only, as in messages: numba compiles a kernel again for a writable array.
    """

    origins: Floats
    bearings: Floats
    half_angles: Floats
    ranges: Floats
    limits: Floats
    sensors: NDArray[np.int64]

    @classmethod
    def fixed(
        cls, origins: Floats, bearings: Floats, half_angles: Floats, ranges: Floats, limits: Floats,
        sensors: NDArray[np.int64],
    ) -> Beams:  # fmt: skip
        """Beams of read-only views of the arrays."""
        shown = [array.view() for array in (origins, bearings, half_angles, ranges)]
        for array in shown:
            array.flags.writeable = False
        return cls(shown[0], shown[1], shown[2], shown[3], limits, sensors)

    @classmethod
    def sample(cls) -> Beams:
        """A sonar's and a laser's beam with an echo 1 m ahead, to compile kernels with."""
        angles, limits = np.array([0.2, 0.0]), np.tile([0.3, 4.0], (2, 1))
        return cls.fixed(np.zeros((2, 2)), np.zeros(2), angles, np.ones(2), limits, np.zeros(2, np.int64))


class Scan(Protocol):
    """The fields of a range scan that are used here, base frame."""

    @property
    def origins(self) -> Floats: ...
    @property
    def bearings(self) -> Floats: ...
    @property
    def half_angles(self) -> Floats: ...
    @property
    def ranges(self) -> Floats: ...
    @property
    def range_min(self) -> float: ...
    @property
    def range_max(self) -> float: ...


class Joiner:
    """Joins scans; for sensors that do not change, only the ranges are updated.

    Args:
        agreement: Largest difference of a laser's echoes that are averaged, m, see smoothing.smoothed(); 0 for no
            averaging.
    """

    def __init__(self, agreement: float) -> None:
        self._agreement = agreement
        self._known: Sequence[Scan] = ()
        self._lasers: list[bool] = []
        self._ranges = np.empty(0)

    def join(self, scans: Sequence[Scan]) -> Beams:
        """All beams of a tick, from at least one scan. The same object, with new ranges, until a sensor changes."""
        if not self._is_known(scans):
            self._open(scans)
        at = 0
        for scan, is_laser in zip(scans, self._lasers, strict=True):
            end = at + scan.ranges.size
            ranges = smoothed(scan.ranges, scan.range_max, self._agreement) if is_laser else scan.ranges
            self._ranges[at:end] = ranges
            at = end
        return self._beams

    def _is_known(self, scans: Sequence[Scan]) -> bool:
        if len(scans) != len(self._known):
            return False
        for scan, known in zip(scans, self._known, strict=True):
            if (
                scan.origins is not known.origins
                or scan.bearings is not known.bearings
                or scan.half_angles is not known.half_angles
                or scan.range_min != known.range_min
                or scan.range_max != known.range_max
            ):
                return False
        return True

    def _open(self, scans: Sequence[Scan]) -> None:
        self._known = scans
        self._lasers = [self._agreement > 0.0 and bool((scan.half_angles < THIN_BEAM).all()) for scan in scans]
        sizes = [scan.ranges.size for scan in scans]
        limits = np.array([(scan.range_min, scan.range_max) for scan in scans]).repeat(sizes, axis=0)
        self._ranges = np.empty(sum(sizes))
        self._beams = Beams.fixed(
            np.concatenate([scan.origins for scan in scans]),
            np.concatenate([scan.bearings for scan in scans]),
            np.concatenate([scan.half_angles for scan in scans]),
            self._ranges,
            limits,
            np.arange(len(scans)).repeat(sizes),
        )
