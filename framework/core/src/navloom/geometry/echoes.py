"""Where the beams of scans and sweeps ended, and where the robot was at a time of its track."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.angles import wrap
from navloom.geometry.frames import transform
from navloom.messages import PoseTrack, RangeScan, Sweep

__all__ = [
    "Geometry",
    "beam_ends",
    "poses_along",
    "poses_at",
    "scan_points",
    "scan_points_in_map",
    "sweep_points",
    "sweep_points_in_map",
]

Floats = NDArray[np.float64]
Geometry = Literal["paper", "rigid_pitch"]
"""How a sweep's ranges, pitches and bearings give points: see `sweep_points`."""


def beam_ends(origins: Floats, bearings: Floats, ranges: Floats) -> Floats:
    """Where beams of given ranges end: (n, 2) m, base frame. Origins are (n, 2) m, bearings (n,) rad, ranges (n,) m."""
    ends: Floats = origins + ranges[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], 1)
    return ends


def scan_points(scan: RangeScan) -> Floats:
    """Echoes of a scan: (n, 2) m, base frame. Beams without an echo are left out."""
    heard = scan.ranges < scan.range_max
    return beam_ends(scan.origins[heard], scan.bearings[heard], scan.ranges[heard])


def scan_points_in_map(scan: RangeScan, track: PoseTrack) -> Floats:
    """Echoes of a scan: (n, 2) m, map frame, each from where the robot was when its beam was taken."""
    times_ns = scan.stamp_ns + 1e9 * scan.time_offsets[scan.ranges < scan.range_max]
    return transform(poses_at(track, times_ns), scan_points(scan)[:, None])[:, 0]


def sweep_points(sweep: Sweep, geometry: Geometry | None = None) -> Floats:
    """(frames, beams, 3) points of a sweep: x, y, z, m, base frame, z above the floor; NaN where there is no echo.

    Args:
        sweep: Ranges, pitches α and bearings b.
        geometry: Overrides that of the sweep. "paper": R cosα cos b, R cosα sin b, R sinα (Hoang et al. 2013, eq. (1)).
            "rigid_pitch", the scan plane tilted as a whole: R cosα cos b, R sin b, R sinα cos b.
    """
    sin_a, cos_a = np.sin(sweep.pitches)[:, None], np.cos(sweep.pitches)[:, None]
    sin_b, cos_b = np.sin(sweep.bearings)[None, :], np.cos(sweep.bearings)[None, :]
    ranges = np.where(sweep.ranges < sweep.range_max, sweep.ranges, np.nan)
    if (geometry or sweep.geometry) == "rigid_pitch":
        forward, left, up = ranges * (cos_a * cos_b), ranges * sin_b, ranges * (sin_a * cos_b)
    else:
        forward, left, up = ranges * cos_a * cos_b, ranges * cos_a * sin_b, ranges * sin_a
    return np.stack([forward + sweep.x, left + sweep.y, up + sweep.z], axis=-1)


def sweep_points_in_map(sweep: Sweep, track: PoseTrack) -> Floats:
    """Echoes of a sweep: (n, 3) m, map frame, z above the floor, each from where the robot was in its frame."""
    points, heard = sweep_points(sweep), sweep.ranges < sweep.range_max
    flat = transform(poses_at(track, sweep.stamp_ns + 1e9 * sweep.frame_times), points[..., :2])
    return np.column_stack([flat[heard], points[heard, 2]])


def poses_at(track: PoseTrack, times_ns: NDArray[np.int64] | Floats) -> Floats:
    """Poses of base at run times: (n, 3) x, y, m, and heading, rad, map frame.

    Linear between the poses of the track. Before the first and after the last it is the nearest one.

    Args:
        track: At least one pose.
        times_ns: (n,) run clock, ns.

    Raises:
        ValueError: The track is empty.
    """
    if not len(track.stamps_ns):
        raise ValueError("the track has no pose: expected at least one")
    begin = track.stamps_ns[0]  # differences of stamps fit a float64, stamps of a long run do not
    times, known = times_ns - begin, track.stamps_ns - begin
    poses = poses_along(times, known, track.poses)
    poses[:, 2] = wrap(poses[:, 2])
    return poses


def poses_along(times: Floats, known: Floats, poses: Floats) -> Floats:
    """`poses_at` for times of any epoch and unit: (n, 3) x, y, m, and heading, rad, which is continuous, not wrapped.

    Args:
        times: (n,) requested times.
        known: (k,) times of the poses, increasing; at least one.
        poses: (k, 3) x, y, m, and heading, rad.
    """
    # Wrapped, a heading between 179° and -179° would come out as 0°.
    columns = (poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
    return np.column_stack([np.interp(times, known, column) for column in columns])
