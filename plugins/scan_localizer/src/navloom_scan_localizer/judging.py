"""Judges whether the tracker's pose can be trusted: tracking, searching or lost, and why."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from navloom_scan_localizer.search import candidates
from navloom_scan_localizer.sight import look_along
from navloom_scan_localizer.small import inverse
from navloom_scan_localizer.tracking import PoseTracker

__all__ = ["Judge", "position_sigma"]

Floats = NDArray[np.float64]

_CANDIDATES = 8
"""Candidates of the coarse search that are fitted."""
_GOOD = 0.7
"""Least share of the echoes that fit at another pose for the tracker to move there."""
_BETTER = 0.1
"""Least gain in the score over the current pose for the tracker to move."""
_ALIKE = 0.02
"""Difference below which scores count as equal; of equal candidates, the one nearest to the pose is used."""
_RIVAL, _OTHER = 0.1, 9.0
"""Lead in the score over every other place, without which the tracker does not move; squared Mahalanobis distance from
which a pose is another place: a bare corridor is one place with a large covariance."""
_MOVES = 2
"""Most moves of a pose that is not proven: the second may refine the first."""
_BEAMS = 45
"""About how many beams of a scan are compared with the map; the next scan's are others."""
_MEMORY = 0.3
"""Time over which scans are averaged, s; shorter than `patience`."""
_SILENT = 0.5
"""Weight of a beam without an echo where the map has a wall: dark, slanted or glass walls give none either."""
_PROOF = 1.0
"""Drive along which scans must fit before a pose is proven, m: then an obstacle starts no search for another."""
_AT_REST = 0.02
"""Speed, m/s, and turn rate, rad/s, below which the robot counts as standing."""


def position_sigma(covariance: Floats, limit: float) -> float:
    """Largest standard deviation of the position in any direction, m; 0 where it is clearly below a limit, m.

    The trace is never less than the largest eigenvalue, so most scans need no eigenvalue decomposition.
    """
    if 1.01 * (covariance[0, 0] + covariance[1, 1]) < limit * limit:
        return 0.0
    half_sum, half_gap = 0.5 * (covariance[0, 0] + covariance[1, 1]), 0.5 * (covariance[0, 0] - covariance[1, 1])
    return math.sqrt(float(half_sum) + math.hypot(half_gap, covariance[1, 0]))


def _off(pose: Floats, other: Floats) -> Floats:
    """A pose (3,) less another one, the heading wrapped."""
    off: Floats = pose - other
    off[2] = math.remainder(off[2], math.tau)
    return off


def _distance(off: Floats, information: Floats) -> float:
    """Square of the Mahalanobis distance of a shift (3,), by an inverse covariance (3, 3)."""
    return float((information * off[:, None] * off).sum())


def _through(seen: Floats) -> float:
    """Weighted number of beams that pass through walls, by counts of `look_along`."""
    return float(seen[1] + _SILENT * seen[4])


def _score(seen: Floats) -> float:
    """How well counts of `look_along` support a pose: 1 if all beams fit; an occluded beam adds nothing."""
    return float((seen[0] - 2.0 * _through(seen)) / max(seen[:3].sum(), 1.0))


class Judge:
    """Judges a tracker by its scans and moves it to a better pose if there is one.

    An echo before a mapped wall comes from something that the map lacks and says nothing about the pose. Beams that
    pass through mapped walls contradict it. As long as the pose is not proven by a drive, other poses nearby are tried
    whenever not all echoes fit. If one of them fits clearly better, the tracker continues from there.

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
        self._seen, self._part = np.zeros(5), 0
        """Recent counts of `look_along`, and the part of the next scan's beams that is counted."""
        self._time: float | None = None
        self._last_pose = tracker.pose.copy()
        self._blind, self._proven = math.inf, 0.0
        """Time driven since the map was last seen, s, infinite before that; way driven with scans that fit, m."""
        self._moves, self._rival = 0, ""
        """Moves since the pose was last proven; why the last search did not move it though others fit better."""

    def look(self, beams: Floats, time: float, echoes: int | None = None) -> None:
        """Judge the pose after a correction.

        Args:
            beams: (n, 4) end point, m, and direction, base frame: the beams of that correction, then those without
                an echo, which end at the range of the sensor.
            time: Current time, s.
            echoes: Number of beams with an echo; all by default.
        """
        s, tracker, count = self._tracker.settings, self._tracker, len(beams) if echoes is None else echoes
        self._observe(beams, count, time)
        share = tracker.share
        if share is not None and (share >= s.sure_share or self._proven >= _PROOF):
            self._search_at, self._rival = time + s.patience, ""
        elif share is not None and time >= self._search_at:
            self._search_at = time + s.search_every
            if self._move(beams, count):
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

    def _observe(self, beams: Floats, echoes: int, time: float) -> None:
        """Count what a scan sees, and how far the robot has driven with and without seeing the map."""
        tracker, s = self._tracker, self._tracker.settings
        passed = 0.0 if self._time is None else max(time - self._time, 0.0)
        off = np.abs(tracker.pose - self._last_pose)
        way, turn = math.hypot(off[0], off[1]), min(off[2], math.tau - off[2])
        self._time, self._last_pose = time, tracker.pose.copy()
        self._seen *= math.exp(-passed / _MEMORY)
        if len(beams):
            stride = max(1, len(beams) // _BEAMS)
            self._part = (self._part + 1) % stride
            gate = 2.0 * s.robust_scale
            self._seen += look_along(tracker.field, beams, echoes, tracker.pose, gate, (self._part, stride))
        total = self._seen.sum()
        if total - self._seen[2] >= s.least_seen * total:
            self._blind = 0.0
        elif max(way, turn) > _AT_REST * passed:
            self._blind += passed
        through = _through(self._seen)
        is_fit = self._blind == 0.0 and through <= (1.0 - s.sure_share) * (through + self._seen[0])
        self._proven = self._proven + way if is_fit and self.state == "tracking" else 0.0
        if self._proven >= _PROOF:
            self._moves = 0

    def _doubt(self) -> str:
        """Why the pose cannot be trusted; empty if it can."""
        s, through = self._tracker.settings, _through(self._seen)
        reached, total = through + self._seen[0], self._seen.sum()
        most = (0.5 if self._moves else 1.0) * (1.0 - s.trusted_share)
        if through > most * reached and through > 0.5 * s.least_seen * total:
            share = through / reached
            return f"{share:.0%} of the beams to a wall of the map pass through it, more than {most:.0%}"
        if self._blind > s.blind_after:
            since = f"for {self._blind:.1f} s of driving" if self._blind < math.inf else "at this place"
            return f"less than {s.least_seen:.0%} of the beams have seen the map {since}"
        sigma = position_sigma(self._tracker.covariance, s.lost_sigma)
        if sigma > s.lost_sigma:
            return f"the position has a standard deviation of {sigma:.2f} m, more than {s.lost_sigma:g} m"
        return self._rival

    def _move(self, beams: Floats, echoes: int) -> bool:
        """Move to the best pose nearby if it fits well and clearly better; whether the tracker moved."""
        tracker, s, points = self._tracker, self._tracker.settings, beams[:echoes]
        wide = np.diag([s.search_reach**2, s.search_reach**2, s.search_turn**2]) + tracker.covariance
        toward, fits, gate = inverse(wide), [], 2.0 * s.robust_scale
        here = look_along(tracker.field, beams, echoes, tracker.pose, gate)
        for place in candidates(tracker.field, points, tracker.pose, s.search_reach, s.search_turn, _CANDIDATES):
            pose, fused, _ = tracker.fit(points, place, wide)
            seen = look_along(tracker.field, beams, echoes, pose, gate)
            off = _off(pose, tracker.pose)
            if seen[0] >= _GOOD * echoes:
                fits.append((_score(seen), _distance(off, toward), pose, fused, off, seen[0] / echoes))
        best = max((fit[0] for fit in fits), default=-math.inf)
        self._rival = ""
        if best < _score(here) + _BETTER:
            return False
        _, _, pose, fused, off, share = min((fit for fit in fits if fit[0] > best - _ALIKE), key=lambda fit: fit[1])
        others = [fit for fit in fits if fit[0] > best - _RIVAL and _distance(_off(fit[2], pose), fused) > _OTHER]
        if others or self._moves == _MOVES:
            self._rival = f"{share:.0%} of the echoes fit the map at {1 + len(others)} other places"
            return False
        self._moves += 1
        tracker.relocate(pose, inverse(fused))
        self._seen, self._proven, self._blind, self._last_pose = np.zeros(5), 0.0, math.inf, tracker.pose.copy()
        moved, turned = math.hypot(off[0], off[1]), abs(math.degrees(off[2]))
        self.reason = (
            f"{share:.0%} of the echoes fit the map {moved:.2f} m and {turned:.0f} deg from where odometry leads, "
            f"{here[0] / echoes:.0%} there"
        )
        return True
