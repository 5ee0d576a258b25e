"""Compares what beams see with the walls that the map has along them.

An echo before the mapped wall is that of something the map lacks: it says nothing about the pose. A beam that passes
through a mapped wall contradicts the pose, or the map. If its echo is at the front of a mapped wall further on, the
first one may be of glass: it says nothing either.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_scans.field import DistanceField, distance_field, sample

__all__ = ["Sight", "is_through", "look_along", "compare_views", "warm_up"]

Floats = NDArray[np.float64]

_SILENT = 0.5
"""Weight of a beam without an echo where the map has a wall: dark, slanted or glass walls give none either."""
_GRAZING = 0.2
"""Least cosine between a beam and a wall's normal that is used for the depth behind the wall."""
_BESIDE = 0.1
"""Distance to both sides at which a beam must pass a wall too, m: real maps have single cells where nothing is, and a
small error of the pose lets a beam cut a corner."""
_SECTORS = 180
"""Sectors round the robot in which two scans are compared; with its neighbours one spans about 6 degrees."""
_LEAST = 10
"""Least number of beams for a comparison."""


@njit(cache=True, nogil=True, error_model="numpy")
def _is_through(values, frame, x, y, dx, dy, back, gate):  # type: ignore[no-untyped-def]
    """Whether a beam that ends at x, y, and began `back` before, passes a wall and ends deeper than a gate behind it.

    It goes from node to node by the distance to the nearest wall (sphere tracing, Hart 1996).
    """
    c, s, spacing = frame[2], frame[3], frame[4]
    rows, columns = values.shape
    u, v = (c * (x - frame[0]) + s * (y - frame[1])) / spacing, (c * (y - frame[1]) - s * (x - frame[0])) / spacing
    du, dv = (c * dx + s * dy) / spacing, (c * dy - s * dx) / spacing
    while back > gate:
        column, row = math.floor(u - back * du + 0.5), math.floor(v - back * dv + 0.5)
        distance = spacing
        if 0 <= row < rows and 0 <= column < columns:
            distance = values[row, column]
            if distance < 0.5 * spacing:
                before, gx, gy, _ = sample(values, frame, x - back * dx, y - back * dy)
                facing = -(gx * dx + gy * dy)
                if distance < 0.0 or facing > 0.0:
                    return back * max(facing, _GRAZING) - before > gate
        # At least half a node: in a wall's neighbourhood the distance is 0.
        back -= max(distance - 0.5 * spacing, 0.5 * spacing)
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def is_through(values, frame, x, y, dx, dy, back, gate):  # type: ignore[no-untyped-def]
    """Whether a beam passes through a wall, and so do its two neighbours 0.1 m beside it.

    Args:
        values, frame: Attributes of a `DistanceField`.
        x, y: End point, m, and dx, dy: unit direction, both in the map frame. back: Length of the beam, m.
        gate: Depth behind the front of a wall from which a beam has passed through it, m.
    """
    return (
        _is_through(values, frame, x, y, dx, dy, back, gate)
        and _is_through(values, frame, x - _BESIDE * dy, y + _BESIDE * dx, dx, dy, back, gate)
        and _is_through(values, frame, x + _BESIDE * dy, y - _BESIDE * dx, dx, dy, back, gate)
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _is_at_front(values, frame, x, y, dx, dy, gate):  # type: ignore[no-untyped-def]
    """Whether an echo is nearer than half a gate to a wall whose front faces the beam; arguments as for `is_through`.

    Behind a wall that a wrong pose lets the beam pass, the nearest face is the back of that wall.
    """
    distance, _, _, known = sample(values, frame, x, y)
    if not known or abs(distance) > 0.5 * gate:
        return False
    # Half a gate earlier, since noise takes some echoes beyond the middle of a thin wall.
    _, gx, gy, _ = sample(values, frame, x - 0.5 * gate * dx, y - 0.5 * gate * dy)
    return -(gx * dx + gy * dy) > _GRAZING


@njit(cache=True, nogil=True, error_model="numpy")
def _count(values, frame, beams, echoes, first, stride, pose, gate, counts):  # type: ignore[no-untyped-def]
    """Add to the counts of `look_along`."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(first, beams.shape[0], stride):
        dx, dy = c * beams[i, 2] - s * beams[i, 3], s * beams[i, 2] + c * beams[i, 3]
        x, y = pose[0] + c * beams[i, 0] - s * beams[i, 1], pose[1] + s * beams[i, 0] + c * beams[i, 1]
        back = max(0.0, beams[i, 0] * beams[i, 2] + beams[i, 1] * beams[i, 3])
        has_passed = is_through(values, frame, x, y, dx, dy, back, gate)
        if i >= echoes:
            counts[5 if has_passed else 4] += 1
        elif has_passed:
            counts[3 if _is_at_front(values, frame, x, y, dx, dy, gate) else 2] += 1
        else:
            distance, _, _, known = sample(values, frame, x, y)
            if known and abs(distance) < gate:
                counts[0 if abs(distance) < 0.5 * gate else 1] += 1
            else:
                counts[3] += 1


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _sector(x, y):  # type: ignore[no-untyped-def]
    """Sector of a point seen from the origin: its share of the way round the square |x| + |y| = 1."""
    way = abs(x) + abs(y)
    turn = 1.0 - x / way if way > 0.0 else 0.0
    return min(int(0.25 * _SECTORS * (turn if y >= 0.0 else 4.0 - turn)), _SECTORS - 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _compare(before, heard, beams, echoes, dx, dy, turn, gate, first, stride):  # type: ignore[no-untyped-def]
    """Numbers of beams that continue an earlier scan, that end beyond it, and that are compared."""
    low, high, is_silent = np.full(_SECTORS, np.inf), np.zeros(_SECTORS), np.zeros(_SECTORS, dtype=np.bool_)
    for i in range(before.shape[0]):
        k, far = _sector(before[i, 0], before[i, 1]), math.hypot(before[i, 0], before[i, 1])
        low[k], high[k] = min(low[k], far), max(high[k], far)
        is_silent[k] |= i >= heard
    c, s, same, beyond, count = math.cos(turn), math.sin(turn), 0, 0, 0
    for i in range(first, beams.shape[0], stride):
        x, y = dx + c * beams[i, 0] - s * beams[i, 1], dy + s * beams[i, 0] + c * beams[i, 1]
        k, far, least, most, was_silent = _sector(x, y), math.hypot(x, y), np.inf, 0.0, False
        for j in ((k - 1) % _SECTORS, k, (k + 1) % _SECTORS):
            least, most, was_silent = min(least, low[j]), max(most, high[j]), was_silent or is_silent[j]
        if most > 0.0 and not (was_silent and i >= echoes):
            count += 1
            is_beyond = not was_silent and far > most + gate
            beyond += is_beyond
            same += not is_beyond and far >= least - gate
    return same, beyond, count


class Sight(NamedTuple):
    """What beams see from a pose: numbers of beams.

    Attributes:
        inner, outer: Echoes nearer than half a gate to a mapped wall, and nearer than a gate.
        behind: Echoes through a wall that are not at the front of another one.
        elsewhere: Other echoes: before every wall, or at a wall behind what may be glass.
        free, silent: Beams without an echo that pass no wall, and that pass one.
    """

    inner: float = 0.0
    outer: float = 0.0
    behind: float = 0.0
    elsewhere: float = 0.0
    free: float = 0.0
    silent: float = 0.0

    @property
    def total(self) -> float:
        """Number of beams."""
        return sum(self)

    @property
    def fit(self) -> float:
        """Number of echoes at a mapped wall."""
        return self.inner + self.outer

    @property
    def through(self) -> float:
        """Number of beams that pass through a wall; those without an echo count half."""
        return self.behind + _SILENT * self.silent

    @property
    def support(self) -> float:
        """Share of the echoes at a mapped wall; nearer to 1 if fewer than half of the beams have one.

        Echoes of unmapped things that are near a wall by chance are as often in the outer half of the gate as in the
        inner one; so the outer ones are subtracted.
        """
        echoes = max(self.fit + self.behind + self.elsewhere, 1.0)
        weight = min(1.0, 2.0 * echoes / max(self.total, 1.0))
        return 1.0 - weight + weight * max(self.inner - self.outer, 0.0) / echoes

    @property
    def score(self) -> float:
        """How well the echoes fit: 1 if all do; an occluded one adds nothing, one through a wall subtracts one."""
        return (self.fit - self.through) / max(self.fit + self.behind + self.elsewhere, 1.0)


def look_along(
    field: DistanceField,
    beams: Floats,
    echoes: int,
    pose: Floats,
    gate: float,
    part: tuple[int, int] = (0, 1),
    counts: Floats | None = None,
) -> Sight:
    """Count what beams see from a pose.

    Args:
        field: Distance field of the map.
        beams: (n, 4) end point, m, and direction, base frame; first those with an echo, then those without one, which
            end at the range of the sensor.
        echoes: Number of beams with an echo.
        pose: (3,) x, y, m, heading, rad, map frame.
        gate: Largest distance of an echo from its wall, m.
        part: First beam and stride, if not all are counted.
        counts: (6,) earlier counts to which these are added, in place.
    """
    counts = np.zeros(6) if counts is None else counts
    _count(field.values, field.frame, beams, echoes, part[0], part[1], pose, gate, counts)
    return Sight(*counts.tolist())


def compare_views(
    before: Floats,
    heard: int,
    beams: Floats,
    echoes: int,
    step: Floats,
    gate: float,
    part: tuple[int, int] = (0, 1),
) -> tuple[float, float]:
    """Shares of the beams that continue an earlier scan, and that pass through what it saw; the rest is nearer.

    A beam continues that scan if it ends where that one did in about this direction, or between its ends there. Beams
    without an echo where that scan had none are not compared. If fewer than ten are, all count as continued.

    Args:
        before, heard: Beams and number of echoes of the earlier scan, as those of `look_along`.
        beams, echoes: Those of this scan.
        step: (3,) motion of odometry since then: x, y, m, heading, rad, in the base frame of the earlier scan.
        gate: Largest distance beyond those ends, m.
        part: First beam and stride, if not all are compared.
    """
    same, beyond, count = _compare(before, heard, beams, echoes, step[0], step[1], step[2], gate, *part)
    return (same / count, beyond / count) if count >= _LEAST else (1.0, 0.0)


def warm_up() -> None:
    """Compile the kernels."""
    field = distance_field(np.eye(3, dtype=np.bool_), 0.1, (0.0, 0.0, 0.0), 1.0)
    beams = np.array([[0.1, 0.1, 1.0, 0.0]])
    look_along(field, beams, 1, np.zeros(3), 0.1)
    compare_views(beams, 1, beams, 1, np.zeros(3), 0.1)
