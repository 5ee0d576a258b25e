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
_PATIENCE = 5
"""Scans in a row that fit nothing, after which another part begins: one may be of a crowd or a door."""
_NEIGHBOURS = 0.4
"""Largest distance of the ends of neighbouring beams, m, between which a surface is assumed."""


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
        poses: (m, 3) x, y, m, heading, rad, unwrapped; in a frame of its own for each part.
        parts: (m,) number of the part: where scans fit nothing that was seen before, another begins.
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
    """Follow the scans; those that fit nothing are left out.

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
    surface, key, added, part, failed = LocalSurface(*_SURFACE), np.zeros(3), 0, 0, 0
    for number, scan in enumerate(scans):
        progress(number)
        points, pose = _points(scan, velocities[number]), np.zeros(3)
        if added:
            step = relative(driven[number - 1], driven[number])
            guess = compose(poses[number - 1], step)
            pose, inliers = _fitted(surface, points, guess, step)
            failed = failed + 1 if inliers < max(_LEAST, _SHARE * len(points)) else 0
            # Unwrapped, so that turns can be added up.
            pose = guess if failed else pose
            pose[2] = poses[number - 1, 2] + math.remainder(pose[2] - poses[number - 1, 2], math.tau)
        if failed >= _PATIENCE:
            surface, pose, added, part, failed = LocalSurface(*_SURFACE), np.zeros(3), 0, part + 1, 0
        poses[number], parts[number] = pose, -1 if failed else part
        moved = relative(key, pose)
        is_far = math.hypot(moved[0], moved[1]) > _KEY_WAY or abs(moved[2]) > _KEY_TURN
        if not failed and len(points) and (added < _FIRST or is_far):
            surface.follow(float(pose[0]), float(pose[1]))
            surface.add(_filled(points), pose)
            key, added = pose, added + 1
    fits = parts >= 0
    return Track(stamps[fits], poses[fits], parts[fits])


def velocities_of(track: Track, begins: Floats, span: float) -> Floats:
    """(n, 3) mean velocity, m/s, rad/s, base frame at the middle, over a span, s, that begins at times, (n,) s."""
    found = np.zeros((len(begins), 3))
    for part in np.unique(track.parts):
        stamps, poses = track.stamps[track.parts == part], track.poses[track.parts == part]
        (places,) = np.nonzero((begins + span >= stamps[0]) & (begins <= stamps[-1]))
        if len(stamps) < 2 or not len(places):
            continue
        ends = np.clip(begins[places], stamps[0], stamps[-1]), np.clip(begins[places] + span, stamps[0], stamps[-1])
        first, last = (np.stack([np.interp(at, stamps, row) for row in poses.T], axis=1) for at in ends)
        rate = (last - first) / np.maximum(1e-9, ends[1] - ends[0])[:, None]
        heading = 0.5 * (first[:, 2] + last[:, 2])
        c, s = np.cos(heading), np.sin(heading)
        found[places] = np.stack([c * rate[:, 0] + s * rate[:, 1], c * rate[:, 1] - s * rate[:, 0], rate[:, 2]], axis=1)
    return found


def _points(scan: Beams, velocity: Floats) -> Floats:
    """(n, 4) ends of the beams, m, and their directions, base frame at the stamp."""
    rows = np.empty((len(scan.ranges), 4))
    limits = np.array([scan.range_min, min(scan.range_max, _REACH + 1.0), math.radians(1.0)])
    count = beam_points(*scan[1:6], limits, np.append(velocity, 0.0), rows)
    return rows[: keep_near(rows[:count], _REACH)]


def _filled(points: Floats) -> Floats:
    """Beams, (n, 4), with others between neighbours that end on one surface: sparse beams leave holes in it."""
    gaps = np.hypot(*(points[1:, :2] - points[:-1, :2]).T)
    (left,) = np.nonzero((gaps > _SURFACE[0]) & (gaps < _NEIGHBOURS))
    between = [points]
    for share in (0.25, 0.5, 0.75):
        rows = (1.0 - share) * points[left] + share * points[left + 1]
        rows[:, 2:] /= np.maximum(1e-9, np.hypot(rows[:, 2], rows[:, 3]))[:, None]
        between.append(rows)
    return np.concatenate(between)


def _fitted(surface: LocalSurface, points: Floats, guess: Floats, step: Floats) -> tuple[Floats, int]:
    """Pose of a scan on the surfaces, (3,), and its inliers; the guess, (3,), begins the fit."""
    away, turn = _SPREAD + 0.3 * math.hypot(step[0], step[1]), _TURN_SPREAD + 0.5 * abs(step[2])
    information = np.diag([away**-2, away**-2, turn**-2])
    options = np.array([_VARIANCE, 0.5, _SCALE, 2.0 * _SCALE, _WALK])
    pose, fused = np.empty(3), np.empty((3, 3))
    field = surface.field
    inliers = fit_pose(field.values, field.frame, points, guess, information, options, 12, pose, fused)
    return pose, inliers if math.isfinite(float(pose.sum())) else 0
