"""The peer of the localisation campaign: `amcl` on the scans, the odometry and the map of one of our drives.

GPL: for tests and benchmarks alone, and no dependency of anything; `pip install amcl` where it is wanted.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from navloom.geometry.frames import compose, inverse
from navloom.geometry.world import Place
from navloom.messages import Odometry, RangeScan
from navloom.runs.episode import Episode
from navloom.runs.localization import FOUND, FOUND_TURN, Localization

__all__ = ["follow"]

PARTICLES = (500, 5000)
BEAMS = 60
EVERY = (0.1, 0.1)
"""Motion from which it is given the next scan, m and rad."""
SURE = (0.3, math.radians(10.0))
"""Standard deviations, m and rad, below which it counts as tracking: it has no state of its own."""
KNOWN = (0.05, math.radians(2.0))
"""Spread of a start that is known: that of `scan_matching`."""


def follow(episode: Episode, start: Place | None) -> dict[str, Any]:
    """What it makes of a drive.

    Args:
        episode: A run with the streams of odometry and the laser.
        start: Start pose that it gets; None for an unknown one, which is a normal distribution as wide as the map.

    Returns:
        The same measures as those of our localizers; `absent` if it is not installed.
    """
    try:
        import amcl
    except ImportError:
        return {"absent": "amcl is not installed: pip install amcl"}
    scans = {m.stamp_ns: m for _, m in episode.trail.streams[("platform", "laser")] if isinstance(m, RangeScan)}
    driven = [m for _, m in episode.trail.streams[("platform", "odometry")] if isinstance(m, Odometry)]
    peer = _made(amcl, episode, start)
    last, rows = np.full(3, math.inf), []
    for odometry in driven:
        pose = np.array([odometry.pose.x, odometry.pose.y, odometry.pose.heading])
        step = compose(inverse(last), pose) if math.isfinite(last[0]) else np.full(3, math.inf)
        scan = scans.get(odometry.stamp_ns)
        if scan is not None and (math.hypot(step[0], step[1]) > EVERY[0] or abs(step[2]) > EVERY[1]):
            peer.update(_scan(amcl, scan), amcl.Vector3D(*pose.tolist()))
            last = pose
        rows.append((odometry.stamp_ns * 1e-9, *_said(peer, pose, last)))
    return _measures(episode, np.array(rows))


def _made(amcl: Any, episode: Episode, start: Place | None) -> Any:
    """The filter with the map, and where it begins."""
    grid = episode.system.map
    assert grid is not None
    rows, columns = grid.cells.shape
    motion = amcl.MotionParameters(0.2, 0.2, 0.2, 0.2, 0.1)
    laser = amcl.LaserParameters(0.5, 0.05, 0.05, 0.5, 0.2, 0.1, 0.0, BEAMS)
    peer = amcl.AMCL(*PARTICLES, 0.001, 0.1, motion, laser, "differential")
    known = amcl.create_occupancy_grid_from_list(
        grid.cells.astype(int).tolist(), grid.resolution, grid.origin.x, grid.origin.y
    )
    peer.set_map(known)
    if start is not None:
        place, spread = (start.x, start.y, start.heading), (KNOWN[0], KNOWN[0], KNOWN[1])
    else:
        sides = (columns * grid.resolution, rows * grid.resolution)
        place = (grid.origin.x + 0.5 * sides[0], grid.origin.y + 0.5 * sides[1], 0.0)
        spread = (0.3 * sides[0], 0.3 * sides[1], math.pi)
    peer.set_initial_pose(amcl.Vector3D(*place), amcl.create_diagonal_covariance(*(value**2 for value in spread)))
    return peer


def _scan(amcl: Any, scan: RangeScan) -> Any:
    """A scan as (range, bearing) pairs; the simulated laser is at the base."""
    ranges = np.where(np.isfinite(scan.ranges), scan.ranges, scan.range_max)
    return amcl.create_laser_scan_from_list(np.column_stack([ranges, scan.bearings]).tolist(), scan.range_max)


def _said(peer: Any, pose: Any, last: Any) -> tuple[float, ...]:
    """Its pose, moved on by odometry since its last scan, whether it is sure, and xx, xy, yy, m², heading, rad²."""
    mean, spread = peer.get_pose_mean(), peer.get_pose_covariance().to_list()
    # Before its first scan there is no motion.
    since = compose(inverse(last), pose) if math.isfinite(last[0]) else np.zeros(3)
    at = compose(np.array([mean.x, mean.y, mean.theta]), since).tolist()
    xx, xy, yy, turn = (spread[0][0], spread[0][1], spread[1][1], spread[2][2])
    is_sure = max(xx, yy) <= SURE[0] ** 2 and turn <= SURE[1] ** 2
    return (*at, float(is_sure), xx, xy, yy, turn)


def _measures(episode: Episode, rows: Any) -> dict[str, Any]:
    ours = episode.trail.localization
    shared = np.isin(rows[:, 0], ours.time)
    rows = rows[shared]
    kept = np.isin(ours.time, rows[:, 0])
    found = Localization(
        rows[:, 0], ours.truth[kept], rows[:, 1:4], rows[:, 5:9], rows[:, 4] == 1.0, ours.is_moving[kept]
    )
    at = found.found_at
    is_right = (found.error <= FOUND) & (found.turn_error <= FOUND_TURN)
    return {
        "found_time": None if at is None else float(found.time[at]),
        "false_tracking_time": found.false_tracking,
        "not_tracking_time": found.not_tracking,
        "error_median": float(np.median(found.error[found.is_tracking])) if found.is_tracking.any() else None,
        "right_at_end": bool(is_right[-1]),
        "within_3_sigma": float(found.is_within[found.is_tracking].mean()) if found.is_tracking.any() else None,
    }
