"""Frames of a robot's messages, as the page reads them: SI units, radians, map frame unless the name says base."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from navloom.messages import MapUpdate, Path, PoseEstimate, RangeScan, Tracks, Trajectory
from numpy.typing import NDArray

from navloom_dashboard.outbox import Frame, binary_frame, text_frame

__all__ = ["command_rows", "map_frame", "path_frame", "pose_frame", "scan_frame", "tracks_frame", "trajectory_frame"]

SAME = 1e-6
"""Tolerance below which bearings count as equally spaced, rad, and origins as equal, m."""
MM = 3
"""Decimals of lengths, m, and of angles, rad."""


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
        strict=True,
    )
    found = [{"id": i, "x": x, "y": y, "vx": vx, "vy": vy, "radius": r} for i, (x, y), (vx, vy), r in rows]
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
    """The raster, compressed: int8, row by row from the lowest y, -1 unknown, 0 free to 100 occupied."""
    grid = update.grid
    rows, columns = grid.cells.shape
    at = grid.origin
    header = {
        "width": columns, "height": rows, "resolution": grid.resolution, "origin": [at.x, at.y, at.heading],
        "version": version, "encoding": "zlib",
    }  # fmt: skip
    return binary_frame("map", header, zlib.compress(np.ascontiguousarray(grid.cells).tobytes(), 1), update.stamp_ns)


def command_rows(commands: Sequence[tuple[str, bool, float, float]]) -> list[dict[str, Any]]:
    """Commands of one tick of the instances of a role: instance, whether active, m/s, rad/s."""
    return [{"instance": name, "active": active, "v": v, "w": w} for name, active, v, w in commands]
