"""Where the beams of scans and sweeps ended, and where the robot was at a time of its track."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.angles import wrap
from navloom.geometry.frames import transform
from navloom.messages import PoseTrack, RangeScan, Sweep

__all__ = ["poses_at", "scan_points", "scan_points_in_map", "sweep_points_in_map"]

Floats = NDArray[np.float64]


def scan_points(scan: RangeScan) -> Floats:
    """Echoes of a scan: (n, 2) m, base frame. Beams without an echo are left out."""
    heard = np.isfinite(scan.ranges)
    bearings = scan.bearings[heard]
    points: Floats = scan.origins[heard] + scan.ranges[heard, None] * np.stack([np.cos(bearings), np.sin(bearings)], 1)
    return points


def scan_points_in_map(scan: RangeScan, track: PoseTrack) -> Floats:
    """Echoes of a scan: (n, 2) m, map frame, each from where the robot was when its beam was taken."""
    times_ns = scan.stamp_ns + 1e9 * scan.time_offsets[np.isfinite(scan.ranges)]
    return transform(poses_at(track, times_ns), scan_points(scan)[:, None])[:, 0]


def sweep_points_in_map(sweep: Sweep, track: PoseTrack) -> Floats:
    """Echoes of a sweep: (n, 3) m, map frame, z above the floor, each from where the robot was in its frame."""
    frames, beams = np.nonzero(np.isfinite(sweep.ranges))
    ranges, pitch, bearing = sweep.ranges[frames, beams], sweep.pitches[frames], sweep.bearings[beams]
    forward = ranges * np.cos(pitch) * np.cos(bearing)
    if sweep.geometry == "paper":
        left, up = ranges * np.cos(pitch) * np.sin(bearing), ranges * np.sin(pitch)
    else:
        left, up = ranges * np.sin(bearing), ranges * np.cos(bearing) * np.sin(pitch)
    poses = poses_at(track, sweep.stamp_ns + 1e9 * sweep.frame_times)[frames]
    flat = transform(poses, np.stack([sweep.x + forward, sweep.y + left], axis=1)[:, None])[:, 0]
    return np.column_stack([flat, sweep.z + up])


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
    headings = np.unwrap(track.poses[:, 2])
    columns = (track.poses[:, 0], track.poses[:, 1], headings)
    x, y, heading = (np.interp(times, known, column) for column in columns)
    return np.column_stack([x, y, wrap(heading)])
