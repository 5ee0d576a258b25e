"""Builders of messages with defaults, for unit tests: inputs of plugins and a mapper's map, in one line.

Everything is in SI units. A pose is given as (x, y) or (x, y, heading).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from navloom.geometry.frames import transform
from navloom.geometry.world import World
from navloom.messages import (
    AvoiderDiagnostics,
    MapUpdate,
    OccupancyGrid,
    Pose2D,
    PoseEstimate,
    PoseTrack,
    RangeScan,
    Sweep,
    Trajectory,
    Twist2D,
)
from numpy.typing import ArrayLike

from navloom_check.scenes import RESOLUTION, cast, grid

__all__ = ["empty_diagnostics", "estimate", "map_update", "pose", "scan", "sweep", "track", "trajectory"]

Place = Sequence[float]
"""x, y, m, and, where it is a pose, heading, rad."""


def ns(seconds: float) -> int:
    """Seconds as a stamp."""
    return round(seconds * 1e9)


def pose(place: Place = (0.0, 0.0)) -> Pose2D:
    """A pose of (x, y) or (x, y, heading); the heading is wrapped."""
    x, y, heading = (*place, 0.0)[:3]
    return Pose2D(x, y, math.remainder(heading, math.tau))


def scan(
    seen: World | ArrayLike = math.inf,
    at: Place = (0.0, 0.0),
    *,
    beams: int = 181,
    field_of_view: float = math.radians(270.0),
    half_angle: float = 0.0,
    mount: Place = (0.0, 0.0, 0.0),
    height: float = 0.3,
    range_min: float = 0.05,
    range_max: float = 10.0,
    stamp: float = 0.0,
) -> RangeScan:
    """A planar scan.

    Args:
        seen: A world, seen from `at`; or ranges, m: a list, or one number for every beam.
        at: Pose of base in the map.
        beams: Number of beams; not used with a list of ranges.
        field_of_view: Angle from the first beam to the last, rad, with the middle straight ahead.
        half_angle: Half the opening of a beam, rad; 0 for a laser.
        mount: Pose of the sensor in the base frame.
        height: Height of the scan plane, m.
        range_min, range_max: Range limits, m. Anything at range_max or farther gives no echo.
        stamp: Run clock, s.
    """
    given = None if isinstance(seen, World) else np.asarray(seen, dtype=np.float64)
    count = beams if given is None or given.ndim == 0 else len(given)
    placed = pose(mount)
    bearings = placed.heading + (np.linspace(-0.5, 0.5, count) * field_of_view if count > 1 else np.zeros(count))
    if isinstance(seen, World):
        base = pose(at)
        base_to_map = np.array([base.x, base.y, base.heading])
        origin = np.full((count, 3), height)
        origin[:, :2] = transform(base_to_map, np.array([placed.x, placed.y]))
        angles = bearings + base.heading
        ranges = cast(seen, origin, np.column_stack((np.cos(angles), np.sin(angles), np.zeros(count))), time=stamp)
        ranges = np.where(ranges >= range_max, math.inf, np.maximum(ranges, range_min))
    else:
        assert given is not None
        ranges = np.full(count, given) if given.ndim == 0 else given
    return RangeScan(
        ns(stamp), np.full((count, 2), (placed.x, placed.y)), bearings, np.full(count, half_angle), np.zeros(count),
        ranges, range_min, range_max,
    )  # fmt: skip


def sweep(
    seen: World | ArrayLike = math.inf,
    at: Place = (0.0, 0.0),
    *,
    frames: int = 40,
    beams: int = 61,
    field_of_view: float = math.radians(100.0),
    pitches: tuple[float, float] = (math.radians(-25.0), math.radians(15.0)),
    height: float = 0.4,
    duration: float = 1.25,
    request_id: int = 1,
    range_min: float = 0.1,
    range_max: float = 30.0,
    stamp: float = 0.0,
) -> Sweep:
    """One sweep of a planar laser that is pitched as a whole, on a stopped robot.

    Args:
        seen: A world, seen from `at`; or ranges, m, (frames, beams) or one number for all.
        at: Pose of base in the map.
        frames, beams: Number of frames, and of beams in each.
        field_of_view: Angle from the first beam to the last, rad.
        pitches: Pitch of the first and of the last frame, rad, up positive.
        height: Height of the sensor above the floor, m.
        duration: Duration of the sweep, s.
        request_id: The request that it answers; 0 for a continuous sweep.
        range_min, range_max: Range limits, m.
        stamp: Run clock at which it begins, s.
    """
    if not isinstance(seen, World):
        given = np.asarray(seen, dtype=np.float64)
        frames, beams = given.shape if given.ndim == 2 else (frames, beams)
    bearings = np.linspace(-0.5, 0.5, beams) * field_of_view if beams > 1 else np.zeros(beams)
    tilts = np.linspace(*pitches, frames)
    if isinstance(seen, World):
        base = pose(at)
        ahead, left = np.cos(bearings)[None, :], np.broadcast_to(np.sin(bearings), (frames, beams))
        in_base = np.stack((ahead * np.cos(tilts)[:, None], left, ahead * np.sin(tilts)[:, None]), axis=2).reshape(
            -1, 3
        )
        ways = in_base.copy()
        ways[:, :2] = transform(np.array([0.0, 0.0, base.heading]), in_base[:, :2])
        ranges = cast(seen, np.full((len(ways), 3), (base.x, base.y, height)), ways, floor=True, time=stamp)
        ranges = np.where(ranges >= range_max, math.inf, np.maximum(ranges, range_min)).reshape(frames, beams)
    else:
        ranges = np.full((frames, beams), given) if given.ndim == 0 else given
    times = np.linspace(0.0, duration, frames)
    return Sweep(ns(stamp), request_id, ranges, tilts, times, bearings, "rigid_pitch", 0.0, 0.0, height, range_min,
                 range_max)  # fmt: skip


def estimate(at: Place = (0.0, 0.0), moving: tuple[float, float] = (0.0, 0.0), stamp: float = 0.0) -> PoseEstimate:
    """A pose in the map, and the velocity (m/s, rad/s)."""
    return PoseEstimate(ns(stamp), pose(at), Twist2D(moving[0], 0.0, moving[1]), np.diag((1e-4, 1e-4, 1e-4)))


def track(poses: Sequence[Place] = ((0.0, 0.0, 0.0),), stamps: Sequence[float] | None = None) -> PoseTrack:
    """Poses over time; by default one pose at the origin, from -1 s to 10 s."""
    if stamps is None:
        stamps = (-1.0, 10.0) if len(poses) == 1 else [0.05 * k for k in range(len(poses))]
    if len(poses) == 1:
        poses = [poses[0]] * len(stamps)
    rows = np.array([(one.x, one.y, one.heading) for one in map(pose, poses)], dtype=np.float64).reshape(-1, 3)
    return PoseTrack(np.array([ns(stamp) for stamp in stamps], dtype=np.int64), rows)


def map_update(world: World | OccupancyGrid, resolution: float = RESOLUTION, stamp: float = 0.0) -> MapUpdate:
    """A mapper's map of a world, or of a given raster, without segments."""
    cells = world if isinstance(world, OccupancyGrid) else grid(world, resolution)
    return MapUpdate(ns(stamp), cells, np.empty((0, 4)), ())


def trajectory(length: float = 5.0, curvature: float = 0.0, speed: float = 0.3, path_id: int = 1) -> Trajectory:
    """A trajectory from the origin along the x axis: a line, or an arc to the left with a curvature, 1/m."""
    s = np.linspace(0.0, length, max(2, round(length / 0.02) + 1))
    heading = np.remainder(curvature * s + math.pi, math.tau) - math.pi
    if curvature == 0.0:
        x, y = s, np.zeros_like(s)
    else:
        x, y = np.sin(curvature * s) / curvature, (1.0 - np.cos(curvature * s)) / curvature
    return Trajectory(path_id, np.column_stack((s, x, y, heading, np.full_like(s, curvature), np.full_like(s, speed))))


def empty_diagnostics(why: str = "") -> AvoiderDiagnostics:
    """Empty diagnostics of an avoider; `why` is a phrase for people."""
    return AvoiderDiagnostics(np.zeros((0, 0), np.uint8), 0.0, 0.0, 0.0, np.zeros(0), 0.0, np.zeros((0, 2)), None, why)
