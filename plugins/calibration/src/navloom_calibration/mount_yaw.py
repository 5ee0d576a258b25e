"""The yaw of a laser's mount: the direction in which its scans show that it moves, against that of the odometry.

While the robot drives straight for some decimetres, the laser moves by d as the odometry says and by d' as its scans
say, both in the base frame at the beginning. A mount that is turned by δ more than the config says makes d = R(δ) d'.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navloom_calibration.laser_track import Track, Way
from navloom_calibration.offset import Interval, interval_of

__all__ = ["Yaw", "find_yaw"]

Floats = NDArray[np.float64]

_LEG = 0.3
"""Length of a straight leg, m: an error of a fit of 3 mm is then 0.6°."""
_LONGEST = 4.0
"""Longest time of a leg, s."""
_STRAIGHT = math.radians(4.0)
"""Largest turn within a leg, rad: in curves, the place of the mount and the time offset matter too."""
_FINEST = math.radians(0.15)
"""Standard deviation of what all legs have in common, as the surfaces of a room, rad."""
_FAR_OFF = 2.5
"""Robust standard deviations from which a leg does not count."""


class Yaw(NamedTuple):
    """How a mount is turned.

    Attributes:
        yaw: What is to be added to the configured yaw, rad.
        straight: Way of the legs that show it, m.
        legs: Their number.
    """

    yaw: Interval
    straight: float
    legs: int


def find_yaw(track: Track, way: Way, mount: Floats, offset: float) -> Yaw | None:
    """The yaw of a mount; None without three straight legs.

    Args:
        track: The base as the scans show it, with the configured mount.
        way: Odometry.
        mount: (2,) place of the laser, m, base frame.
        offset: To be added to its stamps, s.
    """
    angles, lengths = _legs(track, way, mount, offset)
    if len(angles) < 3:
        return None
    middle = _mean(angles, lengths)
    for _ in range(5):
        off = np.angle(np.exp(1j * (angles - middle)))
        spread = max(1e-4, 1.4826 * float(np.median(np.abs(off))))
        kept = np.abs(off) < _FAR_OFF * spread
        middle = _mean(angles[kept], lengths[kept])
    off, weights = np.angle(np.exp(1j * (angles[kept] - middle))), lengths[kept]
    # Leaving out the tails of a normal distribution makes it look narrower by a tenth.
    own = 1.1 * math.sqrt(float(((weights * off) ** 2).sum())) / float(weights.sum())
    sigma = math.hypot(own, _FINEST)
    freedom = max(1.0, float(kept.sum()) - 1.0)
    return Yaw(interval_of(middle, sigma, freedom), float(weights.sum()), int(kept.sum()))


def _mean(angles: Floats, weights: Floats) -> float:
    return float(np.angle((weights * np.exp(1j * angles)).sum()))


def _legs(track: Track, way: Way, mount: Floats, offset: float) -> tuple[Floats, Floats]:
    """For each straight leg, the direction of the odometry's motion less that of the scans', rad, and its length, m."""
    driven = way.at(track.stamps + offset)
    passed = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(driven[:, :2], axis=0).T))))
    angles, lengths, first = list[float](), list[float](), 0
    while first < len(passed) - 1:
        last = int(np.searchsorted(passed, passed[first] + _LEG))
        if last >= len(passed):
            break
        is_one = track.parts[first] == track.parts[last] and track.stamps[last] - track.stamps[first] < _LONGEST
        bends = np.ptp(driven[first : last + 1, 2]) > _STRAIGHT or np.ptp(track.poses[first : last + 1, 2]) > _STRAIGHT
        if not is_one or bends:
            first += 1
            continue
        seen, said = (_moved(poses[first], poses[last], mount) for poses in (track.poses, driven))
        if abs(seen) > 0.5 * _LEG and abs(said) > 0.5 * _LEG:
            angles.append(float(np.angle(said * np.conj(seen))))
            lengths.append(abs(said))
        first = last
    return np.array(angles), np.array(lengths)


def _moved(before: Floats, after: Floats, mount: Floats) -> complex:
    """Motion of the mount between two poses of the base, m, as x + iy in the base frame before."""
    place, turn = complex(*mount), np.exp(1j * (after[2] - before[2]))
    step = complex(after[0] - before[0], after[1] - before[1]) * np.exp(-1j * before[2])
    return complex(step + (turn - 1.0) * place)
