"""Motion of a laser from its scans alone: each scan is fitted to the surfaces that the scans before it have seen.

Odometry only tells where a fit begins. Its prior is so wide that the result does not depend on it where walls show the
motion, so that turn rates of the scans and of the odometry can be compared.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from navloom_scan_localizer.surface import LocalSurface
from navloom_scans.beams import beam_points, keep_near
from navloom_scans.matching import fit_pose
from navloom_scans.poses import compose, relative
from numpy.typing import NDArray

__all__ = ["Beams", "Track", "Way", "laser_track", "velocities_of"]

Floats = NDArray[np.float64]

_REACH = 10.0
"""Longest reading that is used, m."""
_SURFACE = (0.05, _REACH, 0.2, 0.1, 60.0)
"""Spacing, reach, depth before and behind, m, and memory, beams, of the surfaces, as those of `scan_odometry`."""
_SPREAD, _TURN_SPREAD = 0.05, math.radians(6.0)
"""Least spread of the prior of a fit, m and rad: several times what a fit itself is uncertain by."""
_VARIANCE = 0.03**2 * 4.0
"""Variance of a beam's end, m², times the beams that count as one independent measurement."""
_SCALE, _WALK = 0.1, 0.3
"""Last robust scale, and longest search for the front of a wall, m."""
_LEAST, _SHARE = 20, 0.2
"""Least inliers of a fit, in beams and as a share of the echoes."""
_KEY_WAY, _KEY_TURN = 0.1, math.radians(5.0)
"""Motion after which a scan is added to the surfaces, m and rad."""
_FIRST = 10
"""Scans of a part that are always added."""


class Beams(NamedTuple):
    """One scan.

    Attributes:
        stamp: s.
        origins: (n, 2) m, base frame.
        bearings, half_angles: (n,) rad, base frame.
        time_offsets: (n,) s after the stamp.
        ranges: (n,) m.
        range_min, range_max: m.
    """

    stamp: float
    origins: Floats
    bearings: Floats
    half_angles: Floats
    time_offsets: Floats
    ranges: Floats
    range_min: float
    range_max: float


class Way(NamedTuple):
    """Odometry.

    Attributes:
        stamps: (n,) s, rising.
        poses: (n, 3) x, y, m, heading, rad, unwrapped, odometry frame.
    """

    stamps: Floats
    poses: Floats

    def at(self, times: Floats) -> Floats:
        """(m, 3) poses at times, (m,) s; the heading unwrapped."""
        return np.stack([np.interp(times, self.stamps, self.poses[:, k]) for k in range(3)], axis=1)


class Track(NamedTuple):
    """Poses of the base as the scans show them.

    Attributes:
        stamps: (m,) of the scans, s.
        poses: (m, 3) x, y, m, heading, rad, unwrapped; in a frame that begins anew with each part.
        parts: (m,) number of the part: a scan that fits nothing begins another.
    """

    stamps: Floats
    poses: Floats
    parts: NDArray[np.int64]


def laser_track(
    scans: Sequence[Beams],
    way: Way,
    velocities: Floats,
    offset: float = 0.0,
    progress: Callable[[int], None] = lambda count: None,
) -> Track:
    """Follow the scans.

    Args:
        scans: Scans of one laser, by rising stamps.
        way: Odometry, where each fit begins.
        velocities: (m, 3) m/s, rad/s, base frame, with which the beams of each scan are brought to its stamp.
        offset: Added to the stamps of the scans before the odometry is looked up, s.
        progress: Called with the number of scans that are done.
    """
    stamps = np.array([scan.stamp for scan in scans])
    driven = way.at(stamps + offset)
    poses, parts = np.zeros((len(scans), 3)), np.zeros(len(scans), dtype=np.int64)
    surface, key, added, part = LocalSurface(*_SURFACE), np.zeros(3), 0, -1
    for number, scan in enumerate(scans):
        progress(number)
        points = _points(scan, velocities[number])
        pose, is_new = np.zeros(3), part < 0
        if not is_new:
            step = relative(driven[number - 1], driven[number])
            guess = compose(poses[number - 1], step)
            pose, inliers = _fitted(surface, points, guess, step)
            is_new = inliers < max(_LEAST, _SHARE * len(points))
            # Unwrapped, so that turns can be added up.
            pose[2] = poses[number - 1, 2] + math.remainder(pose[2] - poses[number - 1, 2], math.tau)
        if is_new:
            surface, pose, added, part = LocalSurface(*_SURFACE), np.zeros(3), 0, part + 1
        poses[number], parts[number] = pose, part
        moved = relative(key, pose)
        if added < _FIRST or math.hypot(moved[0], moved[1]) > _KEY_WAY or abs(moved[2]) > _KEY_TURN:
            surface.follow(float(pose[0]), float(pose[1]))
            surface.add(points, pose)
            key, added = pose, added + 1
    return Track(stamps, poses, parts)


def velocities_of(track: Track, smoothing: float) -> Floats:
    """(m, 3) velocity, m/s, rad/s, base frame, at each scan of a track, averaged over a time, s."""
    found = np.zeros((len(track.stamps), 3))
    for part in np.unique(track.parts):
        (places,) = np.nonzero(track.parts == part)
        if len(places) < 2:
            continue
        times, poses = track.stamps[places], track.poses[places]
        ahead = np.minimum(times + 0.5 * smoothing, times[-1])
        behind = np.maximum(times - 0.5 * smoothing, times[0])
        ends = [np.stack([np.interp(at, times, poses[:, k]) for k in range(3)], axis=1) for at in (ahead, behind)]
        rate = (ends[0] - ends[1]) / (ahead - behind)[:, None]
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        found[places] = np.stack([c * rate[:, 0] + s * rate[:, 1], c * rate[:, 1] - s * rate[:, 0], rate[:, 2]], axis=1)
    return found


def _points(scan: Beams, velocity: Floats) -> Floats:
    """(n, 4) ends of the beams, m, and their directions, base frame at the stamp."""
    rows = np.empty((len(scan.ranges), 4))
    limits = np.array([scan.range_min, min(scan.range_max, _REACH + 1.0), math.radians(1.0)])
    count = beam_points(*scan[1:6], limits, np.append(velocity, 0.0), rows)
    return rows[: keep_near(rows[:count], _REACH)]


def _fitted(surface: LocalSurface, points: Floats, guess: Floats, step: Floats) -> tuple[Floats, int]:
    """Pose of a scan on the surfaces, (3,), and its inliers; the guess, (3,), begins the fit."""
    away, turn = _SPREAD + 0.3 * math.hypot(step[0], step[1]), _TURN_SPREAD + 0.5 * abs(step[2])
    information = np.diag([away**-2, away**-2, turn**-2])
    options = np.array([_VARIANCE, 0.5, _SCALE, 2.0 * _SCALE, _WALK])
    pose, fused = np.empty(3), np.empty((3, 3))
    field = surface.field
    inliers = fit_pose(field.values, field.frame, points, guess, information, options, 12, pose, fused)
    return pose, inliers if math.isfinite(float(pose.sum())) else 0
