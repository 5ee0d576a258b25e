"""Frames of a robot's messages, as the page reads them: SI units, radians, map frame unless the name says base."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from navloom.geometry.echoes import sweep_points_in_map
from navloom.messages import (
    Hypotheses,
    MapUpdate,
    Path,
    PoseEstimate,
    PoseTrack,
    RangeScan,
    Sweep,
    Tracks,
    Trajectory,
)
from numpy.typing import NDArray

from navloom_dashboard.outbox import Frame, binary_frame, text_frame

__all__ = [
    "command_rows",
    "hypotheses_frame",
    "map_frame",
    "path_frame",
    "pose_frame",
    "scan_frame",
    "sweep_frame",
    "tracks_frame",
    "trajectory_frame",
]

SAME = 1e-6
"""Tolerance below which bearings count as equally spaced, rad, and origins as equal, m."""
MM = 3
"""Decimals of lengths, m, and of angles, rad."""
FINEST, MOST_CELLS = 0.05, 1_000_000
"""Smallest cell of a sweep seen from above, m, and most of them: larger cells show a larger area."""


def _rounded(values: NDArray[np.float64]) -> list[Any]:
    rounded: list[Any] = np.round(values, MM).tolist()
    return rounded


def pose_frame(estimate: PoseEstimate) -> Frame:
    """Pose with covariance; `cov` is null if the localizer cannot tell it."""
    pose, known = estimate.pose, bool(estimate.covariance.any())
    fields = {
        "x": pose.x, "y": pose.y, "heading": pose.heading, "state": estimate.state, "reason": estimate.reason,
        "run_time": estimate.stamp_ns * 1e-9,
        "cov": estimate.covariance.tolist() if known and np.isfinite(estimate.covariance).all() else None,
    }  # fmt: skip
    return text_frame("pose", fields, estimate.stamp_ns)


def hypotheses_frame(places: Hypotheses) -> Frame:
    """Places where a robot may be that does not know where it is, the likeliest first; none where there is one only."""
    rows = zip(_rounded(places.poses), _rounded(places.weights), strict=True) if len(places.poses) > 1 else ()
    found = [{"x": x, "y": y, "heading": heading, "weight": weight} for (x, y, heading), weight in rows]
    return text_frame("hypotheses", {"places": found}, places.stamp_ns)


def path_frame(path: Path, stamp_ns: int) -> Frame:
    """The planned path."""
    headings = None if path.headings is None else _rounded(path.headings)
    return text_frame("path", {"points": _rounded(path.points), "headings": headings}, stamp_ns)


def trajectory_frame(trajectory: Trajectory, stamp_ns: int) -> Frame:
    """The trajectory as rows of x, y, heading and speed."""
    return text_frame("trajectory", {"points": _rounded(trajectory.samples[:, [1, 2, 3, 5]])}, stamp_ns)


def tracks_frame(tracks: Tracks, source: str) -> Frame:
    """People and other bodies that move."""
    rows = zip(
        tracks.ids.tolist(),
        _rounded(tracks.positions),
        _rounded(tracks.velocities),
        _rounded(tracks.radii),
        _rounded(tracks.unseen),
        strict=True,
    )
    found = [
        {"id": i, "x": x, "y": y, "vx": vx, "vy": vy, "radius": radius, "unseen": unseen}
        for i, (x, y), (vx, vy), radius, unseen in rows
    ]
    return text_frame("tracks", {"tracks": found, "source": source}, tracks.stamp_ns, f"tracks {source}")


def scan_frame(scan: RangeScan, name: str) -> Frame:
    """Ranges as float32, infinite where there is no echo.

    A scanner with one origin and equally spaced beams has `pose`, `angle_min` and `angle_step` in its header; any other
    sensor has `beams` instead: x, y, bearing and half angle of each beam in the base frame.
    """
    ranges = np.where(scan.ranges < scan.range_max, scan.ranges, math.inf).astype("<f4")
    header: dict[str, Any] = {"name": name, "range_max": _finite(scan.range_max)}
    if len(ranges) > 2 and _is_uniform(scan):
        (x, y), step = scan.origins[0], (scan.bearings[-1] - scan.bearings[0]) / (len(ranges) - 1)
        header |= {
            "pose": [float(x), float(y), 0.0], "angle_min": float(scan.bearings[0]), "angle_step": float(step),
        }  # fmt: skip
    else:
        beams = np.column_stack((scan.origins, scan.bearings, scan.half_angles))
        header["beams"] = _rounded(beams)
    return binary_frame("scan", header, ranges.tobytes(), scan.stamp_ns, f"scan {name}")


def _is_uniform(scan: RangeScan) -> bool:
    steps = np.diff(scan.bearings)
    return bool(
        np.ptp(steps) < SAME and np.ptp(scan.origins, axis=0).max() < SAME and scan.half_angles.max(initial=0.0) < 0.05
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def map_frame(update: MapUpdate, version: int) -> Frame:
    """The map: -1 unknown, 0 free to 100 occupied."""
    grid, at = update.grid, update.grid.origin
    header = {"origin": [at.x, at.y, at.heading], "version": version}
    return _raster_frame("map", header, grid.cells, grid.resolution, update.stamp_ns)


def sweep_frame(sweep: Sweep, track: PoseTrack, height: float) -> Frame | None:
    """The 3D image of a pitched laser from above: the highest echo in each cell; None without any.

    -1 is no echo, 0 the floor or below, 100 the robot's height, m; it passes below what is higher.
    """
    points = sweep_points_in_map(sweep, track)
    points = points[points[:, 2] <= height]
    if not len(points):
        return None
    flat, z = points[:, :2], points[:, 2]
    corner, size = flat.min(axis=0), np.ptp(flat, axis=0)
    cell = max(FINEST, math.sqrt((size + FINEST).prod() / MOST_CELLS))
    columns, rows = (size / cell).astype(int) + 1
    column, row = ((flat - corner) / cell).astype(int).T
    cells = np.full((rows, columns), -1, np.int8)
    np.maximum.at(cells, (row, column), (100.0 * np.maximum(z, 0.0) / height).astype(np.int8))
    return _raster_frame("sweep", {"origin": [*corner.tolist(), 0.0]}, cells, cell, sweep.stamp_ns)


def _raster_frame(kind: str, header: dict[str, Any], cells: NDArray[np.int8], cell: float, stamp_ns: int) -> Frame:
    """Cells of `cell` m, compressed: int8, row by row from the lowest y."""
    rows, columns = cells.shape
    header = {"width": columns, "height": rows, "resolution": cell, "encoding": "zlib", **header}
    return binary_frame(kind, header, zlib.compress(np.ascontiguousarray(cells).tobytes(), 1), stamp_ns)


def command_rows(commands: Sequence[tuple[str, bool, float, float]]) -> list[dict[str, Any]]:
    """Commands of one tick of the instances of a role: instance, whether active, m/s, rad/s."""
    return [{"instance": name, "active": active, "v": v, "w": w} for name, active, v, w in commands]
