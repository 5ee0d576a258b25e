"""Judges whether the tracker's pose can be trusted: tracking, searching or lost, and why."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from navloom_scan_localizer.search import candidates
from navloom_scan_localizer.small import inverse
from navloom_scan_localizer.tracking import PoseTracker

__all__ = ["Judge", "position_sigma"]

Floats = NDArray[np.float64]

_CANDIDATES = 8
"""Candidates of the coarse search that are fitted."""
_GOOD = 0.7
"""Least share of the echoes that fit at another pose for the tracker to move there."""
_BETTER = 0.1
"""Least gain in that share over the current pose for the tracker to move."""
_ALIKE = 0.02
"""Difference below which shares count as equal; of equal candidates, the one nearest to the pose is used."""


def position_sigma(covariance: Floats, limit: float) -> float:
    """Largest standard deviation of the position in any direction, m; 0 where it is clearly below a limit, m.

    The trace is never less than the largest eigenvalue, so most scans need no eigenvalue decomposition.
    """
    if 1.01 * (covariance[0, 0] + covariance[1, 1]) < limit * limit:
        return 0.0
    half_sum, half_gap = 0.5 * (covariance[0, 0] + covariance[1, 1]), 0.5 * (covariance[0, 0] - covariance[1, 1])
    return math.sqrt(float(half_sum) + math.hypot(half_gap, covariance[1, 0]))


def _distance(off: Floats, information: Floats) -> float:
    """Square of the Mahalanobis distance of a shift (3,), by an inverse covariance (3, 3)."""
    return float((information * off[:, None] * off).sum())


class Judge:
    """Judges a tracker by its scans and moves it to a better pose if there is one.

    The share of echoes that fit the map separates a right pose from a wrong one. If it is not high, other poses nearby
    are tried. If one of them fits clearly better, the odometry was wrong, and the tracker continues from that pose.

    Attributes:
        state: "tracking"; "searching" after the pose was moved or scans stopped fitting; "lost" when that lasts.
        reason: Why the state is not "tracking"; else empty.
    """

    def __init__(self, tracker: PoseTracker) -> None:
        self.state: Literal["tracking", "searching", "lost"] = "tracking"
        self.reason = ""
        self._tracker = tracker
        self._search_at = -math.inf
        """Time of the next search for another pose, s: at the first scan, later after scans have fitted badly."""
        self._since: float | None = None
        """Time from which scans have contradicted the state, s; None if the last one agreed with it."""
        self._searching_since = 0.0

    def look(self, beams: Floats, time: float) -> None:
        """Judge the pose after a correction.

        Args:
            beams: (n, 4) end point, m, and direction, base frame: the beams of that correction.
            time: Current time, s.
        """
        s, share = self._tracker.settings, self._tracker.share
        if share is not None and share >= s.sure_share:
            self._search_at = time + s.patience
        elif share is not None and time >= self._search_at:
            self._search_at = time + s.search_every
            if self._move(beams, share):
                self.state, self._since, self._searching_since = "searching", None, time
                return
        doubt = self._doubt()
        is_tracking = self.state == "tracking"
        if bool(doubt) != is_tracking:
            self._since = None
        elif self._since is None:
            self._since = time
        if doubt and not is_tracking:
            self.reason = doubt
        if self._since is not None and time - self._since >= s.patience:
            self.state, self.reason = ("searching", doubt) if is_tracking else ("tracking", "")
            self._since, self._searching_since = None, time
        elif self.state == "searching" and time - self._searching_since >= s.lost_after:
            self.state = "lost"

    def _doubt(self) -> str:
        """Why the pose cannot be trusted; empty if it can."""
        s, share = self._tracker.settings, self._tracker.share
        if share is not None and share < s.trusted_share:
            return f"{share:.0%} of the echoes fit the map, less than {s.trusted_share:.0%}"
        sigma = position_sigma(self._tracker.covariance, s.lost_sigma)
        if sigma > s.lost_sigma:
            return f"the position has a standard deviation of {sigma:.2f} m, more than {s.lost_sigma:g} m"
        return ""

    def _move(self, beams: Floats, share: float) -> bool:
        """Move to the best pose nearby if it fits well and clearly better; whether the tracker moved."""
        tracker, s = self._tracker, self._tracker.settings
        wide = np.diag([s.search_reach**2, s.search_reach**2, s.search_turn**2]) + tracker.covariance
        toward, fits = inverse(wide), []
        for place in candidates(tracker.field, beams, tracker.pose, s.search_reach, s.search_turn, _CANDIDATES):
            pose, fused, inliers = tracker.fit(beams, place, wide)
            off = pose - tracker.pose
            off[2] = math.remainder(off[2], math.tau)
            fits.append((inliers / len(beams), _distance(off, toward), pose, fused, off))
        best = max((fit[0] for fit in fits), default=0.0)
        if best < _GOOD or best < share + _BETTER:
            return False
        _, _, pose, fused, off = min((fit for fit in fits if fit[0] > best - _ALIKE), key=lambda fit: fit[1])
        tracker.relocate(pose, inverse(fused))
        moved, turned = math.hypot(off[0], off[1]), abs(math.degrees(off[2]))
        self.reason = (
            f"{best:.0%} of the echoes fit the map {moved:.2f} m and {turned:.0f} deg from where odometry leads, "
            f"{share:.0%} there"
        )
        return True
