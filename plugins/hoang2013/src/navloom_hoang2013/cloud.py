"""The 3D image of one sweep as points, classified by their use in the 2D map (Hoang et al. 2013, II).

The code follows the paper and shares nothing with any mapper, so that the counts of a mapper can be checked against it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from navloom.geometry.frames import transform
from navloom.geometry.world import Box, World
from navloom.messages import Pose2D, Sweep
from numpy.typing import NDArray

__all__ = ["CLASSES", "Cloud", "cloud_of", "hits_by_box", "on_box", "on_floor", "rays_towards"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Geometry = Literal["paper", "rigid_pitch"]
CLASSES = ("no return", "floor", "overhead", "behind", "kept")
"""Classes of a pixel: no return; removed as floor; removed as higher than the robot (both step 3); an obstacle that is
not the nearest on its bearing; the nearest obstacle on its bearing (step 2)."""
ON = 1e-6
"""Tolerance for points on a box or the floor, m. The rays of a sweep without noise end on them."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """A sweep as points.

    Attributes:
        points: (frames, beams, 3) x, y, m, map frame, and height above the floor, m. Not finite if there is no return.
        classes: (frames, beams) index in `CLASSES`.
        ranges: (frames, beams) horizontal distance from the sensor, m.
    """

    points: Floats
    classes: NDArray[np.int64]
    ranges: Floats

    def of(self, *names: str) -> Floats:
        """(n, 3) points of the named classes, as in `points`."""
        return self.points[np.isin(self.classes, [CLASSES.index(name) for name in names])]

    @property
    def counts(self) -> dict[str, int]:
        """Pixels by class; they sum to frames x beams."""
        tally = np.bincount(self.classes.ravel(), minlength=len(CLASSES))
        return {name: int(number) for name, number in zip(CLASSES, tally, strict=True)}


def cloud_of(sweep: Sweep, base: Pose2D, floor_tolerance: float, z_limit: float, geometry: Geometry) -> Cloud:
    """The points of a sweep taken at standstill.

    Eq. (1) is x = R cosα cosβ, y = R cosα sinβ, z = R sinα with y forward. Here x is forward, and the bearing
    b = β - 90°. A planar laser pitched as a whole has x = R cos b cosα, y = R sin b, z = R cos b sinα instead.

    Args:
        sweep: Ranges, pitches α and bearings b.
        base: Pose of the robot in the map frame.
        floor_tolerance: Largest height of points that count as floor, m.
        z_limit: Height above which points are overhead, m.
        geometry: Which of the two formulas converts ranges to points.
    """
    pitch, bearing = sweep.pitches[:, None], sweep.bearings[None, :]
    with np.errstate(invalid="ignore"):  # no return: inf times 0
        if geometry == "paper":
            ahead, left = np.cos(pitch) * np.cos(bearing), np.cos(pitch) * np.sin(bearing)
            up = np.sin(pitch) * np.ones_like(bearing)
        else:
            ahead, left = np.cos(bearing) * np.cos(pitch), np.sin(bearing) * np.ones_like(pitch)
            up = np.cos(bearing) * np.sin(pitch)
        local = np.stack([sweep.ranges * ahead, sweep.ranges * left, sweep.ranges * up + sweep.z], axis=-1)
    level = np.hypot(local[..., 0], local[..., 1])
    is_return, height = np.isfinite(sweep.ranges), local[..., 2]
    classes = np.zeros(sweep.ranges.shape, dtype=np.int64)
    classes[is_return & (height <= floor_tolerance)] = CLASSES.index("floor")
    classes[is_return & (height > z_limit)] = CLASSES.index("overhead")
    is_obstacle = is_return & (height > floor_tolerance) & (height <= z_limit)
    classes[is_obstacle] = CLASSES.index("behind")
    nearest = np.where(is_obstacle, level, np.inf).argmin(axis=0)
    beams = np.flatnonzero(is_obstacle.any(axis=0))
    classes[nearest[beams], beams] = CLASSES.index("kept")
    in_base = local[..., :2] + (sweep.x, sweep.y)
    with np.errstate(invalid="ignore"):  # no return: inf - inf
        flat = transform(np.array([base.x, base.y, base.heading]), in_base.reshape(-1, 2))
    points = np.concatenate([flat.reshape(in_base.shape), local[..., 2:]], axis=-1)
    return Cloud(points, classes, level)


def on_floor(cloud: Cloud) -> Bools:
    """(frames, beams) True where a ray of a sweep without noise ended on the floor."""
    with np.errstate(invalid="ignore"):
        met: Bools = np.abs(cloud.points[..., 2]) <= ON
    return met


def on_box(cloud: Cloud, box: Box) -> Bools:
    """(frames, beams) True where a ray of a sweep without noise ended on a box, above the floor."""
    bounds = np.array([box.x, box.y, box.z])
    with np.errstate(invalid="ignore"):
        met = ((cloud.points >= bounds[:, 0] - ON) & (cloud.points <= bounds[:, 1] + ON)).all(axis=-1)
    above: Bools = met & ~on_floor(cloud)
    return above


def hits_by_box(cloud: Cloud, world: World) -> dict[str, int]:
    """How many rays of a sweep without noise ended on each box, on the floor, and nowhere; they sum to all rays."""
    hits = {"no return": cloud.counts["no return"], "floor": int(on_floor(cloud).sum())}
    is_left = np.ones(cloud.classes.shape, dtype=np.bool_)
    for box in world.obstacles:
        if isinstance(box, Box) and not box.appears_after_sweep:
            met = on_box(cloud, box) & is_left
            hits[box.name] = int(met.sum())
            is_left &= ~met
    return hits


def rays_towards(sweep: Sweep, base: Pose2D, box: Box) -> int:
    """How many rays of a sweep by eq. (1), taken at standstill, would meet the front of a box, whatever is before it.

    The front is the face with the lowest y, and the robot faces +y.
    """
    bearing = sweep.bearings[None, :] + base.heading
    along = (box.y[0] - base.y) / np.sin(bearing)
    x = base.x + along * np.cos(bearing)
    height = sweep.z + along * np.tan(sweep.pitches)[:, None]
    meets = (along > 0.0) & (x >= box.x[0]) & (x <= box.x[1]) & (height >= box.z[0]) & (height <= box.z[1])
    return int(meets.sum())
