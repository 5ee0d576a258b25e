"""Converts ROS messages of a bag to navloom's, in the base frame, for `bag_import`.

Scans, ranges and odometry go through the checks of the live platform; clouds, which it does not read, are checked here.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from navloom import Odometry, Pose2D, RangeScan, Sweep, Twist2D
from numpy.typing import NDArray

from navloom_ros.base.readings import beams_of_laser, beams_of_ranges, check_level, check_range, motion_of
from navloom_ros.errors import Unusable
from navloom_ros.frames import Mount, wrap
from navloom_ros.times import ns_of

__all__ = ["laser_scan", "odometry", "point_cloud", "range_reading"]

Floats = NDArray[np.float64]
ELEVATION = math.radians(1.0)
AZIMUTH = math.radians(0.5)
"""Cell size of the raster for clouds without regular rows, rad."""
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""numpy's types for the `datatype` of a sensor_msgs/msg/PointField."""


def laser_scan(message: Any, mount: Mount) -> RangeScan:
    """Converts a LaserScan, as `beams_of_laser` does for a live robot. Raises Unusable."""
    beams = beams_of_laser(message, mount.matrix, is_far_below=False)
    if not len(beams.ranges):
        raise Unusable("no beam of the scan is a measurement")
    return RangeScan(ns_of(message.header.stamp), *beams)


def range_reading(message: Any, mount: Mount) -> RangeScan:
    """Converts a Range to one beam, as for a live robot. Raises Unusable."""
    check_range(message)
    check_level(mount.matrix)
    return RangeScan(ns_of(message.header.stamp), *beams_of_ranges([message], [mount.matrix]))


def point_cloud(message: Any, mount: Mount) -> Sweep:
    """Converts a PointCloud2 with fields x, y, z to a sweep of geometry "paper": ranges over elevation and azimuth.

    The cloud's rows and columns are kept if each row has one elevation and each column one azimuth, as from a level
    multi-ring scanner. Otherwise points are binned to 1° by 0.5°, and the nearest point of each cell counts. A point
    that is not finite is no echo. Raises Unusable.
    """
    points = _points(message)
    rows, columns = int(message.height), int(message.width)
    points = points @ mount.rotation.T
    distance = np.sqrt((points**2).sum(axis=1))
    # Some drivers write (0, 0, 0) for no return.
    is_return = np.isfinite(distance) & (distance > 1e-6)
    if not is_return.any():
        raise Unusable("it has no points")
    with np.errstate(invalid="ignore", divide="ignore"):
        elevation = np.arcsin(np.clip(points[:, 2] / distance, -1.0, 1.0))
        azimuth = np.arctan2(points[:, 1], points[:, 0])
    raster = None
    if rows > 1 and columns > 1:
        raster = _as_it_lies(distance, elevation, azimuth, is_return, rows, columns)
    if raster is None:
        raster = _binned(distance[is_return], elevation[is_return], azimuth[is_return])
    ranges, pitches, bearings = raster
    finite = ranges[np.isfinite(ranges)]
    return Sweep(
        ns_of(message.header.stamp), 0, ranges, pitches, np.zeros(len(pitches)), bearings, "paper",
        float(mount.translation[0]), float(mount.translation[1]), max(0.0, float(mount.translation[2])),
        0.0, float(finite.max()) * (1.0 + 1e-9),
    )  # fmt: skip


def _as_it_lies(
    distance: Floats, elevation: Floats, azimuth: Floats, is_return: NDArray[np.bool_], rows: int, columns: int
) -> tuple[Floats, Floats, Floats] | None:
    """Ranges, elevations and azimuths in the cloud's own rows and columns; None if these are not regular."""
    shape = (rows, columns)
    holes = ~is_return.reshape(shape)
    up = np.ma.masked_array(elevation.reshape(shape), holes)
    round_ = np.ma.masked_array(np.unwrap(np.where(holes, 0.0, azimuth.reshape(shape)), axis=0), holes)
    if up.count(axis=1).min() == 0 or up.count(axis=0).min() == 0:
        return None
    pitches, bearings = up.mean(axis=1), round_.mean(axis=0)
    if (
        np.abs(up - pitches[:, None]).max() > ELEVATION / 4.0
        or np.abs(round_ - bearings[None, :]).max() > AZIMUTH / 2.0
    ):
        return None
    ranges = np.where(holes, np.inf, distance.reshape(shape))
    order, place = np.argsort(pitches.data, kind="stable"), np.argsort(wrap(bearings.data), kind="stable")
    return ranges[np.ix_(order, place)], pitches.data[order], wrap(bearings.data)[place]


def _binned(distance: Floats, elevation: Floats, azimuth: Floats) -> tuple[Floats, Floats, Floats]:
    """Ranges of the nearest point in each cell of a raster, and its elevations and azimuths."""
    row = np.floor(elevation / ELEVATION).astype(np.int64)
    column = np.floor(azimuth / AZIMUTH).astype(np.int64)
    first_row, first_column = row.min(), column.min()
    ranges = np.full((int(row.max() - first_row) + 1, int(column.max() - first_column) + 1), np.inf)
    # `ufunc.at`, since several points may fall into one cell.
    np.minimum.at(ranges, (row - first_row, column - first_column), distance)
    pitches = (first_row + np.arange(ranges.shape[0]) + 0.5) * ELEVATION
    bearings = (first_column + np.arange(ranges.shape[1]) + 0.5) * AZIMUTH
    return ranges, pitches, bearings


def _points(message: Any) -> Floats:
    """Points of a cloud, (n, 3), m, in the frame of its sensor."""
    fields = {field.name: field for field in message.fields}
    if not {"x", "y", "z"} <= set(fields):
        raise Unusable(f"it has fields {', '.join(fields) or 'none'}, expected x, y and z")
    unknown = next((name for name in "xyz" if fields[name].datatype not in _NUMBERS), None)
    if unknown is not None:
        raise Unusable(f"its field {unknown} has datatype {fields[unknown].datatype}, expected 1 to 8")
    order = ">" if message.is_bigendian else "<"
    kinds = [np.dtype(order + _NUMBERS[fields[name].datatype]) for name in "xyz"]
    offsets = [int(fields[name].offset) for name in "xyz"]
    height, width, size = int(message.height), int(message.width), int(message.point_step)
    # Some drivers leave it 0 if there is one row.
    step = int(message.row_step) or width * size
    if not height * width:
        raise Unusable("it has no points")
    data = np.asarray(message.data, dtype=np.uint8).tobytes()
    ends = [offset + kind.itemsize for offset, kind in zip(offsets, kinds, strict=True)]
    overlap = height > 1 and width * size > step  # some drivers leave row_step wrong if there is one row
    if max(ends) > size or overlap or (height - 1) * step + width * size > len(data):
        raise Unusable(
            f"its {len(data)} bytes do not hold {height} rows of {width} points, {size} bytes each, every {step} bytes"
        )
    kind = np.dtype({"names": list("xyz"), "formats": kinds, "offsets": offsets, "itemsize": size})
    # Row by row, as rows may be padded.
    cloud = np.concatenate([np.frombuffer(data, kind, width, row * step) for row in range(height)])
    return np.column_stack([cloud[name].astype(np.float64) for name in "xyz"])


def odometry(message: Any) -> Odometry:
    """Converts a nav_msgs/msg/Odometry: pose in the odometry frame, velocity in the base frame. Raises Unusable."""
    motion = motion_of(message)
    return Odometry(ns_of(message.header.stamp), Pose2D(*motion.pose), Twist2D(*motion.twist))
