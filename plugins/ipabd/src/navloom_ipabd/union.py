"""The union map of Fig. 7 (Hoang et al. 2013): all pixels of the 3D image pressed to the plane.

It is the result of step 1 of IPaBD without steps 2 to 4: floor and girders appear in it as walls.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navloom_ipabd.mapping import MapSettings, Outline
from navloom_ipabd.pressure import Barriers, bins_of
from navloom_ipabd.pressure_numpy import bin_index, classify, points_in_reference
from navloom_ipabd.rules import Rule
from navloom_ipabd.sweep import SweepImage
from navloom_ipabd.track import FrameMotion

__all__ = ["union_outline"]

Floats = NDArray[np.float64]


def union_outline(sweep: SweepImage, motion: FrameMotion, settings: MapSettings, keeps_floor: bool = True) -> Outline:
    """Every return as a point, whatever its height. Each cell keeps its first point in image order.

    Args:
        sweep: The 3D image.
        motion: Movement during the sweep.
        settings: Its filters for outliers and `z_limit` apply; with a `z_limit` of `math.inf` all heights are kept.
        keeps_floor: Whether floor points are kept, as in Fig. 7.

    Returns:
        Segments of zero length, map frame. `seen` is the distance of the farthest return of each azimuth: nearer
        obstacles do not limit it, since rays passed them at another height.
    """
    points = points_in_reference(sweep, motion)
    rules = classify(sweep, points[..., 2], settings.filters)
    is_return = rules >= Rule.BELOW_FLOOR
    is_floor = (rules == Rule.BELOW_FLOOR) | (rules == Rule.FLOOR)
    is_kept = (rules == Rule.NOT_MINIMUM) | (is_floor & keeps_floor)
    bins = bins_of(sweep, motion, settings.bin_width)
    index = bin_index(points, is_return, bins)
    seen = np.zeros(bins.size)
    np.maximum.at(seen, index[is_return], np.hypot(points[is_return, 0], points[is_return, 1]))
    tally = np.bincount(rules[~is_kept], minlength=len(Rule))
    counts = {rule: int(tally[rule]) for rule in Rule} | {Rule.KEPT: int(is_kept.sum())}
    nothing = np.full((bins.size, 3), math.nan)
    x, y, heading = motion.reference
    c, s = math.cos(heading), math.sin(heading)
    turn = np.array([[c, s], [-s, c]])
    sensor = np.array([x, y]) + np.array(sweep.mount[:2]) @ turn
    in_map = _one_a_cell(points[is_kept, :2] @ turn + sensor, settings.anchor, settings.resolution)
    barriers = Barriers(bins, np.full(bins.size, math.inf), nothing, seen, counts)
    return Outline(np.hstack([in_map, in_map]), (float(sensor[0]), float(sensor[1]), heading), barriers)


def _one_a_cell(points: Floats, anchor: tuple[float, float], resolution: float) -> Floats:
    """The first point of each cell, since further points of a cell add nothing. `points`: (n, 2), m, map frame."""
    cells = np.floor((points - anchor) / resolution + 0.5).astype(np.int64)
    first = np.unique(cells, axis=0, return_index=True)[1]
    chosen: Floats = points[np.sort(first)]
    return chosen
