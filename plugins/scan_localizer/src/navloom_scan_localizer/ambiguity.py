"""All places near the tracker's at which a scan fits: a covariance that spans them (Olson 2009 weighs places alike)."""

from __future__ import annotations

import math

import numpy as np
from navloom_scans.search import candidates
from navloom_scans.small import axes, inverse
from numpy.typing import NDArray

from navloom_scan_localizer.tracking import PoseTracker

__all__ = ["Ambiguity"]

Floats = NDArray[np.float64]

_SIGMAS = 3.0
"""Range around the pose in which other places are tried, in standard deviations."""
_NEAR, _FAR = 0.08, 1.5
"""Range below which there is no other place, and the largest range, m."""
_TURN = math.radians(30.0)
"""Largest range in heading, rad."""
_LOOSE = np.diag([0.1**2, 0.1**2, math.radians(4.0) ** 2])
"""Covariance with which a place that is tried is fitted, m² and rad²."""
_STEP, _TRIED = 0.1, 12
"""Spacing of the places along the direction that a scan shows least, m; number of the others."""
_SAME = (0.03, math.radians(1.0))
"""Difference of two places below which they are one, m and rad."""
_SINGLE = 0.02
"""Standard deviation between the places below which there is only one, m."""
_WAY, _TURNED = 0.3, math.radians(15.0)
"""Motion after which a scan is looked at again, m and rad: before, it says the same."""


class Ambiguity:
    """Finds out whether scans fit at other places too.

    Attributes:
        spread: (3, 3) covariance of those places about the tracker's, to be added to its covariance; m², m rad, rad².
    """

    def __init__(self, tracker: PoseTracker) -> None:
        self.spread = np.zeros((3, 3))
        self._tracker = tracker
        self._at: Floats | None = None

    def look(self, beams: Floats) -> None:
        """Compare the places at which current beams, (n, 4), might be, after a correction by them."""
        tracker = self._tracker
        here = tracker.odometry
        if self._at is not None and not tracker.is_contradicted:
            off = here - self._at
            turned = abs(math.remainder(off[2], math.tau))
            if math.hypot(off[0], off[1]) < _WAY and turned < _TURNED:
                return
        self._at = here
        places = self._places(beams)
        between, mixed, known = _mixture(tracker, beams, places)
        # The tracker also knows what earlier scans showed: only what the wider prior adds is added to its covariance.
        self.spread = _positive(between + mixed - known)
        if between[0, 0] + between[1, 1] < _SINGLE**2:
            tracker.prior = between + mixed

    def _places(self, beams: Floats) -> list[Floats]:
        """Poses (3,) at which the beams might fit too, within the prior."""
        tracker, prior = self._tracker, self._tracker.prior
        reach = min(_SIGMAS * math.sqrt(max(float(axes(prior[:2, :2])[0][1]), 0.0)), _FAR)
        if reach < _NEAR:
            return []
        turn = min(_SIGMAS * math.sqrt(prior[2, 2]), _TURN)
        found = list(candidates(tracker.field, beams, tracker.pose, reach, turn, _TRIED))
        _, _, inliers = tracker.fit(beams, tracker.pose, _LOOSE)
        if inliers:
            _, directions = axes(tracker.covariance[:2, :2])
            for k in range(1, int(reach / _STEP) + 1):
                for sign in (-1.0, 1.0):
                    shift = sign * k * _STEP * directions[:, 1]
                    found.append(tracker.pose + np.array([shift[0], shift[1], 0.0]))
        return found


def _mixture(tracker: PoseTracker, beams: Floats, places: list[Floats]) -> tuple[Floats, Floats, Floats]:
    """Covariances (3, 3) between the places that fit, and within them by the prior, and by the tracker's own.

    Each place weighs as its likelihood and the prior.
    """
    known, loose, own = inverse(tracker.prior), inverse(_LOOSE), inverse(tracker.covariance)
    modes: list[tuple[Floats, Floats, float]] = []
    for place in [tracker.pose, *places]:
        pose, fused, inliers = tracker.fit(beams, place, _LOOSE)
        if not inliers:
            continue
        off = pose - tracker.pose
        off[2] = math.remainder(off[2], math.tau)
        if any(math.hypot(*(off - m[0])[:2]) < _SAME[0] and abs(off[2] - m[0][2]) < _SAME[1] for m in modes):
            continue
        modes.append((off, fused - loose, tracker.misfit(beams, pose)))
    if not modes:
        return np.zeros((3, 3)), tracker.prior, tracker.covariance
    found = []
    for off, shown, misfit in modes:
        covariance = inverse(shown + known)
        middle = _times(covariance, _times(shown, off))
        # Of the product of two normal distributions: what is left of the prior's and of the scan's distance.
        left = off - middle
        cost = misfit + 0.5 * float((middle * _times(known, middle) + left * _times(shown, left)).sum())
        found.append((cost, middle, covariance, inverse(shown + own)))
    least, total, sums = min(place[0] for place in found), 0.0, np.zeros((3, 3, 3))
    for cost, middle, covariance, narrow in found:
        weight = math.exp(least - cost)
        total += weight
        sums += weight * np.array([np.outer(middle, middle), covariance, narrow])
    between, within, narrow = sums / total
    return between, within, narrow


def _times(matrix: Floats, vector: Floats) -> Floats:
    found: Floats = (matrix * vector).sum(axis=1)
    return found


def _positive(matrix: Floats) -> Floats:
    """The nearest positive semidefinite matrix."""
    values, ways = axes(0.5 * (matrix + matrix.T))
    found: Floats = (ways * np.maximum(values, 0.0) * ways[:, None, :]).sum(axis=-1)
    return found
