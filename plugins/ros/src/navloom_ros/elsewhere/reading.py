"""Converts ROS maps and paths to arrays. Pure: imports neither the framework nor the network."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom_ros.errors import Unusable
from navloom_ros.frames import heading_of

__all__ = ["cells_of", "points_of", "pose_of"]

MOST_POINTS = 100_000
"""Most points of a path; longer paths are refused."""


def cells_of(grid: Any) -> tuple[NDArray[np.int8], float, tuple[float, float, float]]:
    """Cells of a nav_msgs/msg/OccupancyGrid, int8 (rows, columns), cell size, m, and origin x, y, m, heading, rad.

    Raises:
        Unusable: Invalid values.
    """
    info = grid.info
    cells = np.asarray(grid.data, dtype=np.int8)
    if info.width * info.height != len(cells) or not len(cells):
        raise Unusable(f"a map of {info.width} x {info.height} cells, but with {len(cells)} values")
    if not (math.isfinite(info.resolution) and info.resolution > 0.0):
        raise Unusable(f"a map with cells of {info.resolution:g} m")
    if cells.min() < -1 or cells.max() > 100:
        raise Unusable("a map with cells below -1 or above 100")
    heading = heading_of(info.origin.orientation)
    if heading is None:
        raise Unusable("a map whose origin has an orientation that is not a unit quaternion")
    place = (info.origin.position.x, info.origin.position.y, heading)
    if not all(map(math.isfinite, place)):
        raise Unusable("a map whose origin is not finite")
    return cells.reshape(info.height, info.width), float(info.resolution), place


def points_of(path: Any, frame: str) -> NDArray[np.float64]:
    """Points of a nav_msgs/msg/Path, (n, 2), m, without repeated neighbours. Raises Unusable."""
    if path.header.frame_id.lstrip("/") != frame:
        raise Unusable(f"a path in the frame {path.header.frame_id!r}; expected {frame!r}")
    if not 2 <= len(path.poses) <= MOST_POINTS:
        raise Unusable(f"a path of {len(path.poses)} poses; expected 2 to {MOST_POINTS}")
    points: NDArray[np.float64] = np.array(
        [(pose.pose.position.x, pose.pose.position.y) for pose in path.poses], dtype=np.float64
    )
    if not np.isfinite(points).all():
        raise Unusable("a path with a point that is not finite")
    is_new = np.append(True, np.any(np.diff(points, axis=0) != 0.0, axis=1))
    distinct: NDArray[np.float64] = points[is_new]
    return distinct


def pose_of(x: float, y: float, heading: float, frame: str) -> dict[str, Any]:
    """Values of a PoseStamped at x, y, m, heading, rad."""
    turned = {"z": math.sin(heading / 2.0), "w": math.cos(heading / 2.0)}
    return {"header": {"frame_id": frame}, "pose": {"position": {"x": x, "y": y}, "orientation": turned}}
