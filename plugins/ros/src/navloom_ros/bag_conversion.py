"""Converts ROS messages of a bag to navloom's, in the base frame, for `bag_import`.

ROS ranges follow REP 117 and the comments of sensor_msgs: NaN, ±inf and values outside the limits have meanings.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from navloom import Odometry, Pose2D, RangeScan, Sweep, Twist2D
from numpy.typing import NDArray

from navloom_ros.base.readings import beams_of_ranges, check_range
from navloom_ros.errors import RosError, Unusable
from navloom_ros.frames import Mount, quaternion_matrix, wrap
from navloom_ros.times import ns_of

__all__ = ["TILTED", "ConversionError", "laser_scan", "odometry", "point_cloud", "range_reading", "yaw_of"]

Floats = NDArray[np.float64]
TILTED = math.radians(10.0)
"""Largest tilt of a planar scan, rad; beyond, projected ranges are off by more than 1.5 %."""
ELEVATION = math.radians(1.0)
AZIMUTH = math.radians(0.5)
"""Cell size of the raster for clouds without regular rows, rad."""
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""numpy's types for the `datatype` of a sensor_msgs/msg/PointField."""


class ConversionError(RosError):
    """A message that cannot be converted; the text says why."""


def laser_scan(message: Any, mount: Mount) -> RangeScan:
    """Converts a LaserScan. Raises ConversionError.

    +inf and ranges from range_max mean no echo. -inf means an object closer than range_min, and becomes range_min. NaN
    and ranges below range_min are no measurement; their beams are left out.
    """
    if mount.tilt > TILTED:
        raise ConversionError(f"its plane is tilted by {math.degrees(mount.tilt):.0f}°: not a planar scan")
    with np.errstate(invalid="ignore"):  # a signalling NaN is no more than a NaN
        ranges = np.asarray(message.ranges, dtype=np.float64)
    angles = message.angle_min + message.angle_increment * np.arange(len(ranges))
    offsets: Floats = np.arange(len(ranges), dtype=np.float64) * float(message.time_increment)
    ranges, is_kept = _ranges(ranges, float(message.range_min), float(message.range_max))
    directions = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))]) @ mount.rotation.T
    return RangeScan(
        ns_of(message.header.stamp),
        np.tile(mount.translation[:2], (int(is_kept.sum()), 1)),
        # By directions and not by angles: the sensor may hang upside down.
        wrap(np.arctan2(directions[is_kept, 1], directions[is_kept, 0])),
        np.zeros(int(is_kept.sum())),
        offsets[is_kept],
        ranges[is_kept],
        float(message.range_min),
        float(message.range_max),
    )


def range_reading(message: Any, mount: Mount) -> RangeScan:
    """Converts a Range to one beam as wide as its field of view, as `ros2_base` reads it. Raises ConversionError."""
    try:
        check_range(message)
    except Unusable as error:
        raise ConversionError(f"it is {error}") from error
    axis = mount.rotation[:, 0]
    if math.hypot(axis[0], axis[1]) < math.cos(TILTED):
        raise ConversionError("its beam is not parallel to the floor")
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = mount.rotation, mount.translation
    return RangeScan(ns_of(message.header.stamp), *beams_of_ranges([message], [base]))


def _ranges(ranges: Floats, range_min: float, range_max: float) -> tuple[Floats, NDArray[np.bool_]]:
    """Ranges with +inf for no echo, and which of them are measurements."""
    found = np.where(np.isneginf(ranges), range_min, ranges)
    with np.errstate(invalid="ignore"):
        is_kept = found >= range_min
        found = np.where(found >= range_max, np.inf, found)
    return np.where(is_kept, found, 0.0), is_kept


def point_cloud(message: Any, mount: Mount) -> Sweep:
    """Converts a PointCloud2 with fields x, y, z to a sweep of geometry "paper": ranges over elevation and azimuth.

    The cloud's rows and columns are kept if each row has one elevation and each column one azimuth, as from a level
    multi-ring scanner. Otherwise points are binned to 1° by 0.5°, and the nearest point of each cell counts. A point
    that is not finite is no echo. Raises ConversionError.
    """
    points = _points(message)
    rows, columns = int(message.height), int(message.width)
    points = points @ mount.rotation.T
    distance = np.sqrt((points**2).sum(axis=1))
    # Some drivers write (0, 0, 0) for no return.
    is_return = np.isfinite(distance) & (distance > 1e-6)
    if not is_return.any():
        raise ConversionError("it has no points")
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
        raise ConversionError(f"it has fields {', '.join(fields) or 'none'}, expected x, y and z")
    unknown = next((name for name in "xyz" if fields[name].datatype not in _NUMBERS), None)
    if unknown is not None:
        raise ConversionError(f"its field {unknown} has datatype {fields[unknown].datatype}, expected 1 to 8")
    order = ">" if message.is_bigendian else "<"
    kinds = [np.dtype(order + _NUMBERS[fields[name].datatype]) for name in "xyz"]
    offsets = [int(fields[name].offset) for name in "xyz"]
    height, width, size = int(message.height), int(message.width), int(message.point_step)
    # Some drivers leave it 0 if there is one row.
    step = int(message.row_step) or width * size
    if not height * width:
        raise ConversionError("it has no points")
    data = np.asarray(message.data, dtype=np.uint8).tobytes()
    ends = [offset + kind.itemsize for offset, kind in zip(offsets, kinds, strict=True)]
    overlap = height > 1 and width * size > step  # some drivers leave row_step wrong if there is one row
    if max(ends) > size or overlap or (height - 1) * step + width * size > len(data):
        raise ConversionError(
            f"its {len(data)} bytes do not hold {height} rows of {width} points, {size} bytes each, every {step} bytes"
        )
    kind = np.dtype({"names": list("xyz"), "formats": kinds, "offsets": offsets, "itemsize": size})
    # Row by row, as rows may be padded.
    cloud = np.concatenate([np.frombuffer(data, kind, width, row * step) for row in range(height)])
    return np.column_stack([cloud[name].astype(np.float64) for name in "xyz"])


def odometry(message: Any) -> Odometry:
    """Converts a nav_msgs/msg/Odometry: pose in the odometry frame, velocity in the base frame."""
    at, turn = message.pose.pose.position, message.pose.pose.orientation
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    pose = Pose2D(float(at.x), float(at.y), yaw_of(quaternion_matrix(turn.x, turn.y, turn.z, turn.w)))
    return Odometry(ns_of(message.header.stamp), pose, Twist2D(float(linear.x), float(linear.y), float(angular.z)))


def yaw_of(rotation: Floats) -> float:
    """Heading of a rotation matrix, rad in [-π, π)."""
    return float(wrap(np.asarray(math.atan2(rotation[1, 0], rotation[0, 0]))))
