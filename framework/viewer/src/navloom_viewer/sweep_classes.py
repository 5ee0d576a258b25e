"""Classifies the points of a sweep by the rules of IPaBD (Hoang et al. 2013, II.B), for colours and exports."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from navloom.geometry import echoes
from navloom.geometry.echoes import Geometry
from navloom.geometry.frames import transform
from navloom.messages import Sweep
from numpy.typing import NDArray

if TYPE_CHECKING:
    from navloom_viewer.picture_setup import SweepRule

__all__ = ["CLASSES", "KEPT", "classify_sweep", "sweep_points"]

Floats = NDArray[np.float64]
CLASSES = ("none", "below", "floor", "overhead", "behind", "kept")
"""Names of the classes, by number: no usable range; below the floor; floor; above the robot; an obstacle that is not
the nearest on its bearing; the nearest obstacle, which goes into the map."""
NONE, BELOW, FLOOR, OVERHEAD, BEHIND, KEPT = range(6)
STILL = 1e-6
"""Largest movement during a sweep that counts as rounding, m and rad."""


def sweep_points(sweep: Sweep, rule: SweepRule, poses: Floats | None = None) -> Floats:
    """(frames, beams, 3) points: x, y, m, map frame, and height above the floor, m; NaN without a return.

    Args:
        sweep: The published sweep.
        rule: Rule whose geometry may override that of the sweep.
        poses: (frames, 3) x, y, m, heading, rad, of base in the map frame; None gives the points in the base frame.
    """
    points = echoes.sweep_points(sweep, _geometry_of(sweep, rule))
    if poses is not None:
        points[..., :2] = transform(poses, points[..., :2])
    return points


def classify_sweep(sweep: Sweep, rule: SweepRule, poses: Floats | None = None) -> NDArray[np.uint8]:
    """(frames, beams) index in CLASSES of each point. The counts agree with those of the mapper `ipabd`.

    Args:
        sweep, rule, poses: See `sweep_points`; with poses the nearest point is that from the sensor's last position.
    """
    points = sweep_points(sweep, rule, poses)
    usable = (sweep.ranges >= max(sweep.range_min, rule.min_range)) & (
        sweep.ranges < sweep.range_max - rule.max_range_tolerance
    )
    z = np.where(usable, points[..., 2], math.nan)
    classes = np.full(z.shape, BEHIND, dtype=np.uint8)
    classes[~usable] = NONE
    classes[z <= rule.floor_tolerance] = FLOOR
    classes[z < -rule.floor_tolerance] = BELOW
    classes[z > rule.z_limit] = OVERHEAD
    candidates = usable if rule.minimum_first else classes == BEHIND
    nearest = _nearest(sweep, rule, points, poses, candidates)
    if rule.minimum_first:
        kept = nearest & (classes == BEHIND)
        classes[usable & ~nearest] = BEHIND
        classes[kept] = KEPT
    else:
        classes[nearest] = KEPT
    return classes


def _geometry_of(sweep: Sweep, rule: SweepRule) -> Geometry:
    return sweep.geometry if rule.geometry == "as_sweep" else rule.geometry


def _nearest(
    sweep: Sweep, rule: SweepRule, points: Floats, poses: Floats | None, candidates: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """(frames, beams) mask of the first candidate with the smallest horizontal range on each bearing."""
    origin = np.array([sweep.x, sweep.y])
    heading = 0.0
    if poses is not None:
        last = poses[int(np.argmax(sweep.frame_times))]
        heading = float(last[2])
        cosine, sine = math.cos(heading), math.sin(heading)
        origin = last[:2] + np.array([cosine * sweep.x - sine * sweep.y, sine * sweep.x + cosine * sweep.y])
    seen = points[..., :2] - origin
    level = np.where(candidates, np.hypot(seen[..., 0], seen[..., 1]), math.inf)
    found = np.zeros(level.shape, dtype=np.bool_)
    if _geometry_of(sweep, rule) == "paper" and (poses is None or np.ptp(poses, axis=0).max() <= STILL):
        rows = np.argmin(level, axis=0)
        columns = np.flatnonzero(np.isfinite(level[rows, np.arange(level.shape[1])]))
        found[rows[columns], columns] = True
        return found
    flat = np.flatnonzero(np.isfinite(level))
    step = float(np.ptp(sweep.bearings)) / max(1, sweep.bearings.size - 1) or math.radians(1.0)
    first = float(sweep.bearings.min())
    azimuth = np.arctan2(seen[..., 1], seen[..., 0]).ravel()[flat] - heading
    size = max(1, math.ceil(math.tau / step - 1e-9))
    bins = np.minimum((np.mod(azimuth - first + 0.5 * step, math.tau) / step).astype(np.int64), size - 1)
    order = np.lexsort((flat, level.ravel()[flat], bins))
    firsts = order[np.unique(bins[order], return_index=True)[1]]
    found.ravel()[flat[firsts]] = True
    return found
