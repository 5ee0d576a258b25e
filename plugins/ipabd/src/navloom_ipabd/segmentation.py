"""Step 4 of IPaBD: point-distance-based segmentation (PDBS) of the 2D image.

Neighbouring points belong to one object unless their distance exceeds a threshold that grows with range. There are four
published thresholds. All use the nominal step Δ between bearings, so that a missing column counts as distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from navloom_ipabd.errors import SettingError

__all__ = ["Segmentation", "SegmentationMethod", "adaptive_threshold", "dietmayer_threshold", "lee_ratio",
           "santos_threshold", "segment_starts"]  # fmt: skip

Floats = NDArray[np.float64]
SegmentationMethod = Literal["adaptive", "dietmayer", "santos", "lee"]


@dataclass(frozen=True)
class Segmentation:
    """Threshold of the segmentation and its parameters.

    Attributes:
        method: "adaptive" (Borges & Aldon), "dietmayer", "santos" or "lee".
        incidence: λ of the adaptive threshold: the smallest angle of incidence that still counts as one wall, rad.
        sigma: σ of the adaptive threshold: standard deviation of the range, m.
        noise: C0 of Dietmayer and Santos, m.
        santos_beta: β of Santos, rad.
        lee_limit: Largest ratio of Lee within one object, no unit.
        max_missing: Largest number of empty columns between two points of one object.
    """

    method: SegmentationMethod = "adaptive"
    incidence: float = math.radians(10.0)
    sigma: float = 0.02
    noise: float = 0.1
    santos_beta: float = math.radians(15.0)
    lee_limit: float = 0.05
    max_missing: int = 2


def adaptive_threshold(previous: Floats, step: float, incidence: float, sigma: float) -> Floats:
    """Adaptive breakpoint detector: D = r_{i-1} sinΔ / sin(λ - Δ) + 3σ (Borges & Aldon 2004, eq. 6).

    Args:
        previous: (n,) ranges r_{i-1}, m.
        step, incidence: Δ and λ, rad, λ > Δ.
        sigma: m.

    Raises:
        SettingError: λ <= Δ, with which walls and gaps cannot be distinguished, or λ >= 90°.
    """
    if not step < incidence < math.pi / 2:
        given = f"{math.degrees(incidence):g}° with a bearing step of {math.degrees(step):g}°"
        raise SettingError("segmentation.incidence", given, "step < λ < 90°")
    return previous * (math.sin(step) / math.sin(incidence - step)) + 3.0 * sigma


def dietmayer_threshold(nearer: Floats, step: float, noise: float) -> Floats:
    """D = C0 + C1 min(r_i, r_{i-1}), C1 = sqrt(2 (1 - cosΔ)) (Dietmayer et al. 2001).

    C1 min(r) is the chord at equal range, the smallest possible distance of two neighbours. C0 alone must therefore
    allow for noise *and* for oblique walls: a small C0 splits these into many objects.
    """
    return noise + math.sqrt(2.0 * (1.0 - math.cos(step))) * nearer


def santos_threshold(nearer: Floats, step: float, noise: float, beta: float) -> Floats:
    """D = C0 + C1 min(r_i, r_{i-1}) / (cot β (cos(Δ/2) - sin(Δ/2))) (Santos et al. 2003), 0 < β < 90°."""
    if not 0.0 < beta < math.pi / 2:
        raise SettingError("segmentation.santos_beta", f"{math.degrees(beta):g}°", "0 < β < 90°")
    chord = math.sqrt(2.0 * (1.0 - math.cos(step)))
    return noise + chord * nearer / ((math.cos(step / 2) - math.sin(step / 2)) / math.tan(beta))


def lee_ratio(current: Floats, previous: Floats) -> Floats:
    """|(r1 - r2) / (r1 + r2)| (Lee 2001), no unit. It does not detect gaps between points of equal range."""
    return np.abs((current - previous) / (current + previous))


def segment_starts(points: Floats, ranges: Floats, columns: NDArray[np.int64], step: float, s: Segmentation) -> (
    NDArray[np.int64]
):  # fmt: skip
    """Indices at which objects begin and end in the sequence of points.

    Args:
        points: (n, 2) x, y, m, in order of azimuth.
        ranges: (n,) horizontal ranges, m, > 0.
        columns: (n,) index of each point's azimuth.
        step: Δ, rad.

    Returns:
        (objects + 1,) indices: object i is points[starts[i]:starts[i + 1]].
    """
    if ranges.size == 0:
        return np.zeros(1, dtype=np.int64)
    previous, current = ranges[:-1], ranges[1:]
    if s.method == "lee":
        is_break = lee_ratio(current, previous) > s.lee_limit
    else:
        gaps = np.hypot(*np.diff(points, axis=0).T)
        is_break = gaps > _threshold(previous, np.minimum(previous, current), step, s)
    is_break |= np.diff(columns) > s.max_missing + 1
    return np.concatenate([[0], np.flatnonzero(is_break) + 1, [ranges.size]])


def _threshold(previous: Floats, nearer: Floats, step: float, s: Segmentation) -> Floats:
    if s.method == "adaptive":
        return adaptive_threshold(previous, step, s.incidence, s.sigma)
    if s.method == "dietmayer":
        return dietmayer_threshold(nearer, step, s.noise)
    if s.method == "santos":
        return santos_threshold(nearer, step, s.noise, s.santos_beta)
    raise SettingError("segmentation.method", repr(s.method), "'adaptive', 'dietmayer', 'santos' or 'lee'")
