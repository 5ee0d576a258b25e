"""Groups the echoes of a scan that follow one another, and measures the groups."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

__all__ = ["ARC", "LEAST_RADIUS", "segments", "shapes"]

ARC = 0.785
"""Mean depth of the visible arc of a disc before its centre, in radii: π/4 over the disc's width."""
LEAST_RADIUS = 0.05
"""Radius of a group of one echo, m: that of a leg."""


@njit(cache=True, nogil=True, error_model="numpy")
def segments(points, far, step, gap, labels):  # type: ignore[no-untyped-def]
    """Numbers the groups of echoes that follow one another in a scan, from 0; returns how many there are.

    Args:
        points: (n, 2) echoes in the order of their bearings, m.
        far: (n,) distance from the sensor, m.
        step: Angle between neighbouring beams, rad.
        gap: Largest gap within a group, m; farther off it is that of two beams and a half.
        labels: (n,) output.
    """
    count = points.shape[0]
    if count == 0:
        return 0
    groups = 0
    labels[0] = 0
    for i in range(1, count):
        limit = max(gap, 2.5 * step * min(far[i], far[i - 1]))
        if math.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]) > limit:
            groups += 1
        labels[i] = groups
    # A scan of a full turn has no end: its first and its last group may be one.
    if groups > 0:
        limit = max(gap, 2.5 * step * min(far[0], far[count - 1]))
        if math.hypot(points[0, 0] - points[count - 1, 0], points[0, 1] - points[count - 1, 1]) <= limit:
            for i in range(count):
                if labels[i] == groups:
                    labels[i] = 0
            return groups
    return groups + 1


@njit(cache=True, nogil=True, error_model="numpy")
def shapes(points, marks, labels, x, y, step, rows):  # type: ignore[no-untyped-def]
    """Fills a row for each group.

    Args:
        points: (n, 2) echoes, m. marks: (n, 2) what is true of each, such as that nothing was there before.
        labels: (n,) group of each, from 0; below 0 for none.
        x, y: Place of the sensor, m. step: Angle between neighbouring beams, rad.
        rows: (groups, 9) output: centre x, y, m; radius, m; number of echoes; width across the line of sight, m; x, y
            of the echo nearest to their mean, m; share of the echoes with each mark.
    """
    groups = rows.shape[0]
    rows[:] = 0.0
    for i in range(points.shape[0]):
        k = labels[i]
        if k >= 0:
            rows[k, 0] += points[i, 0]
            rows[k, 1] += points[i, 1]
            rows[k, 3] += 1.0
            rows[k, 7] += marks[i, 0]
            rows[k, 8] += marks[i, 1]
    for k in range(groups):
        if rows[k, 3] > 0.0:
            rows[k, 0] /= rows[k, 3]
            rows[k, 1] /= rows[k, 3]
            rows[k, 7] /= rows[k, 3]
            rows[k, 8] /= rows[k, 3]
    low, high, best = np.zeros(groups), np.zeros(groups), np.full(groups, np.inf)
    for i in range(points.shape[0]):
        k = labels[i]
        if k < 0:
            continue
        dx, dy = rows[k, 0] - x, rows[k, 1] - y
        ox, oy = points[i, 0] - rows[k, 0], points[i, 1] - rows[k, 1]
        across = (oy * dx - ox * dy) / max(math.hypot(dx, dy), 1e-6)
        low[k], high[k] = min(low[k], across), max(high[k], across)
        away = math.hypot(ox, oy)
        if away < best[k]:
            # The mean of a corner's echoes is not on its surface, so the echo nearest to it stands for the group.
            best[k], rows[k, 5], rows[k, 6] = away, points[i, 0], points[i, 1]
    for k in range(groups):
        dx, dy = rows[k, 0] - x, rows[k, 1] - y
        far = max(math.hypot(dx, dy), 1e-6)
        # Each beam stands for the width of one step, so the outline lies up to half a step beyond the outer echoes.
        rows[k, 4] = high[k] - low[k] + 0.5 * step * far
        rows[k, 2] = max(0.5 * rows[k, 4], LEAST_RADIUS)
        rows[k, 0] += ARC * rows[k, 2] * dx / far
        rows[k, 1] += ARC * rows[k, 2] * dy / far
