"""Image pressure in plain numpy, stage by stage: the reference for tests of the fused pass, and the union of Fig. 7."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navloom_ipabd.pressure import TAU, Barriers, Bins, bins_of, settle
from navloom_ipabd.projection import project
from navloom_ipabd.rules import Filters, Rule
from navloom_ipabd.sweep import SweepImage
from navloom_ipabd.track import FrameMotion, standing

__all__ = ["bin_index", "classify", "points_in_reference", "press_numpy", "union"]

Floats = NDArray[np.float64]


def points_in_reference(sweep: SweepImage, motion: FrameMotion | None = None) -> Floats:
    """All points of a sweep, transformed to the reference frame.

    Returns:
        (frames, beams, 3) x, y, m, reference frame (see `FrameMotion`), and z above the floor.
    """
    if motion is None:
        motion = standing(sweep.pitches.size, (0.0, 0.0, 0.0))
    local = project(sweep) - np.array([sweep.mount[0], sweep.mount[1], 0.0])
    sin_t, cos_t = np.sin(motion.turns)[:, None], np.cos(motion.turns)[:, None]
    with np.errstate(invalid="ignore"):
        x = cos_t * local[..., 0] - sin_t * local[..., 1] + motion.shifts[:, 0:1]
        y = sin_t * local[..., 0] + cos_t * local[..., 1] + motion.shifts[:, 1:2]
    return np.stack([x, y, local[..., 2]], axis=-1)


def classify(sweep: SweepImage, heights: Floats, filters: Filters) -> NDArray[np.int64]:
    """Rule of every point before the minimum is taken: NOT_MINIMUM marks all obstacle points.

    Args:
        heights: (frames, beams) z above the floor, m.

    Returns:
        (frames, beams) values of `Rule`.
    """
    r, limits = sweep.ranges, filters.heights(sweep.mount[2])
    with np.errstate(invalid="ignore"):
        conditions = [
            np.isinf(r),
            r >= sweep.range_max - filters.max_range_tolerance,
            r < max(sweep.range_min, filters.min_range),
            heights < limits.below,
            (heights <= limits.low) & (heights >= limits.deep),
            heights > limits.high,
        ]
    return np.select(conditions, list(range(6)), default=int(Rule.NOT_MINIMUM))


def union(sweep: SweepImage, filters: Filters, motion: FrameMotion | None = None) -> Floats:
    """Step 1 and Fig. 7: every obstacle pixel pressed to the plane, with its height.

    Returns:
        (n, 3) x, y, m, reference frame, and z above the floor, m, of all points that are not outliers, not floor and
        not too high, in image order.
    """
    points = points_in_reference(sweep, motion)
    chosen: Floats = points[classify(sweep, points[..., 2], filters) == Rule.NOT_MINIMUM]
    return chosen


def press_numpy(
    sweep: SweepImage, filters: Filters, motion: FrameMotion | None = None, bin_width: float | None = None
) -> Barriers:
    """Same arguments and result as `pressure.press`."""
    points = points_in_reference(sweep, motion)
    rules = classify(sweep, points[..., 2], filters)
    if filters.order == "paper":
        rules[rules >= Rule.BELOW_FLOOR] = Rule.NOT_MINIMUM
    is_return = rules >= Rule.BELOW_FLOOR
    bins = bins_of(sweep, motion, bin_width)
    with np.errstate(invalid="ignore"):
        level = np.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2)
    index = bin_index(points, is_return, bins)
    seen = np.zeros(bins.size)
    # With `at`, since a plain assignment counts only one of several points of a bin.
    np.maximum.at(seen, index[is_return], level[is_return])
    nearest, chosen = _minimum(index, level, points, rules == Rule.NOT_MINIMUM, bins.size)
    return settle(bins, nearest, chosen, seen, np.bincount(rules.ravel(), minlength=7), filters,
                  sweep.mount[2])  # fmt: skip


def bin_index(points: Floats, is_return: NDArray[np.bool_], bins: Bins) -> NDArray[np.int64]:
    """Azimuth bin of every point; without a return it has no meaning. `points`: (frames, beams, 3), reference frame."""
    # Any direction will do where there is none; NaN cannot become an index.
    x, y = np.where(is_return, points[..., 0], 1.0), np.where(is_return, points[..., 1], 0.0)
    angle = np.arctan2(y, x) - bins.first + 0.5 * bins.step
    angle -= TAU * np.floor(angle / TAU)
    return np.minimum((angle / bins.step).astype(np.int64), bins.size - 1)


def _minimum(
    index: NDArray[np.int64], level: Floats, points: Floats, is_candidate: NDArray[np.bool_], size: int
) -> tuple[Floats, Floats]:
    """Smallest horizontal range of each bin, and its point; ties go to the first in image order."""
    nearest, chosen = np.full(size, math.inf), np.full((size, 3), math.nan)
    bins, levels, candidates = index[is_candidate], level[is_candidate], points[is_candidate]
    order = np.lexsort((np.arange(bins.size), levels, bins))
    first = order[np.unique(bins[order], return_index=True)[1]]
    nearest[bins[first]] = levels[first]
    chosen[bins[first]] = candidates[first]
    return nearest, chosen
