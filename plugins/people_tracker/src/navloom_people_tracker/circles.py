"""Fits circles to groups of echoes: a visible arc tells the centre of a body better than the mean of its echoes."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from navloom_people_tracker.clusters import LEAST_RADIUS

__all__ = ["RADIUS_SIGMA", "arcs", "on_circles"]

ARC_ECHOES, ARC_STEPS, ARC_MISFIT = 4, 4, 2.0
"""Fewest echoes of an arc, steps of its fit, and largest misfit, in standard deviations of a range."""
ROUND = 12.0
"""How much worse a straight line fits than the circle, in variances of a range: a part of a wall is no disc."""
RADIUS_SIGMA = 0.2
"""Standard deviation of the radius that the width tells, m: a part may be hidden."""


@njit(cache=True, nogil=True, error_model="numpy")
def _off_line(points, labels, k):  # type: ignore[no-untyped-def]
    """Sum of the squared distances of a group's echoes from the straight line that fits best, m²."""
    n, x, y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(points.shape[0]):
        if labels[i] == k:
            dx, dy = points[i, 0] - points[0, 0], points[i, 1] - points[0, 1]
            n, x, y, xx, xy, yy = n + 1.0, x + dx, y + dy, xx + dx * dx, xy + dx * dy, yy + dy * dy
    xx, xy, yy = xx - x * x / n, xy - x * y / n, yy - y * y / n
    return 0.5 * (xx + yy - math.hypot(xx - yy, 2.0 * xy))


@njit(cache=True, nogil=True, error_model="numpy")
def arcs(points, labels, sigma, least, widest, rows, fits):  # type: ignore[no-untyped-def]
    """Fits a circle to each group, by Gauss-Newton steps from its row of `shapes`, whose radius is the prior.

    Args:
        points, labels: As those of `shapes`.
        sigma: Standard deviation of a range, m.
        least, widest: Least and largest width of a group that is fitted, m.
        rows: (groups, 9) as filled by `shapes`; centre and radius are replaced where a circle fits.
        fits: (groups, 6) output: covariance xx, xy, yy of the centre for a known radius, m²; shift x, y of the centre
            for each m of radius; standard deviation of the radius, m. 0 where no circle fits.
    """
    fits[:] = 0.0
    for k in range(rows.shape[0]):
        if rows[k, 3] < ARC_ECHOES or rows[k, 4] < least or rows[k, 4] > widest:
            continue
        cx, cy, r, prior = rows[k, 0], rows[k, 1], rows[k, 2], rows[k, 2]
        xx, xy, yy, leanx, leany, left, squares = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        weight = (sigma / RADIUS_SIGMA) ** 2
        for _ in range(ARC_STEPS):
            # A short arc hardly tells where its centre is to the side; the small start keeps the step finite.
            axx, axy, ayy, axr, ayr, arr = 1e-4, 0.0, 1e-4, 0.0, 0.0, weight
            bx, by, br, squares = 0.0, 0.0, -weight * (r - prior), 0.0
            for i in range(points.shape[0]):
                if labels[i] != k:
                    continue
                ux, uy = cx - points[i, 0], cy - points[i, 1]
                far = max(math.hypot(ux, uy), 1e-6)
                off, ux, uy = far - r, ux / far, uy / far
                squares += off * off
                axx, axy, ayy = axx + ux * ux, axy + ux * uy, ayy + uy * uy
                axr, ayr, arr = axr - ux, ayr - uy, arr + 1.0
                bx, by, br = bx - ux * off, by - uy * off, br + off
            determinant = axx * ayy - axy * axy
            xx, xy, yy = ayy / determinant, -axy / determinant, axx / determinant
            leanx, leany = -(xx * axr + xy * ayr), -(xy * axr + yy * ayr)
            left = max(arr + axr * leanx + ayr * leany, 1e-9)
            step = (br + leanx * bx + leany * by) / left
            cx, cy = cx + xx * bx + xy * by + leanx * step, cy + xy * bx + yy * by + leany * step
            r += step
        misfit = math.sqrt(squares / rows[k, 3])
        is_near = math.hypot(cx - rows[k, 0], cy - rows[k, 1]) < rows[k, 2]
        variance = max(sigma, misfit) ** 2
        is_round = _off_line(points, labels, k) - squares > ROUND * variance
        if not (misfit < ARC_MISFIT * sigma and is_round and is_near and LEAST_RADIUS < r < 0.5 * widest):
            continue
        rows[k, 0], rows[k, 1], rows[k, 2] = cx, cy, r
        fits[k, 0], fits[k, 1], fits[k, 2] = variance * xx, variance * xy, variance * yy
        fits[k, 3], fits[k, 4], fits[k, 5] = leanx, leany, math.sqrt(variance / left)


@njit(cache=True, nogil=True, error_model="numpy")
def on_circles(points, labels, groups, circles, sigmas, sigma, priors, found):  # type: ignore[no-untyped-def]
    """Fits the centres of circles of known radii, of which a part may be hidden, to one group of echoes each.

    Args:
        points, labels: As those of `shapes`. groups: (n,) group of each circle.
        circles: (n, 3) expected centre and radius, m. sigmas: (n,) standard deviation of the radius, m.
        sigma: Standard deviation of a range, m.
        priors: (n,) standard deviation of the expected centre, m: it counts where the echoes tell nothing.
        found: (n, 5) output: centre, m, and covariance xx, xy, yy of it, m²; NaN where the circle does not fit.
    """
    for k in range(groups.shape[0]):
        cx, cy, r, prior = circles[k, 0], circles[k, 1], circles[k, 2], (sigma / priors[k]) ** 2
        axx, axy, ayy, axr, ayr, squares, count = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0
        for _ in range(ARC_STEPS):
            axx, axy, ayy, axr, ayr, squares, count = prior, 0.0, prior, 0.0, 0.0, 0.0, 0
            bx, by = prior * (circles[k, 0] - cx), prior * (circles[k, 1] - cy)
            for i in range(points.shape[0]):
                if labels[i] != groups[k]:
                    continue
                ux, uy = cx - points[i, 0], cy - points[i, 1]
                far = max(math.hypot(ux, uy), 1e-6)
                off, ux, uy = far - r, ux / far, uy / far
                squares, count = squares + off * off, count + 1
                axx, axy, ayy, axr, ayr = axx + ux * ux, axy + ux * uy, ayy + uy * uy, axr + ux, ayr + uy
                bx, by = bx - ux * off, by - uy * off
            determinant = axx * ayy - axy * axy
            cx, cy = cx + (ayy * bx - axy * by) / determinant, cy + (axx * by - axy * bx) / determinant
        found[k] = np.nan
        if count == 0 or math.sqrt(squares / count) > ARC_MISFIT * sigma + sigmas[k]:
            continue
        determinant = axx * ayy - axy * axy
        xx, xy, yy = ayy / determinant, -axy / determinant, axx / determinant
        leanx, leany, spread = xx * axr + xy * ayr, xy * axr + yy * ayr, sigmas[k] ** 2
        found[k, 0], found[k, 1] = cx, cy
        found[k, 2] = sigma**2 * xx + spread * leanx * leanx
        found[k, 3] = sigma**2 * xy + spread * leanx * leany
        found[k, 4] = sigma**2 * yy + spread * leany * leany
