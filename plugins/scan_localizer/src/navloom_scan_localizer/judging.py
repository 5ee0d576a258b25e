"""Judges whether the tracker's pose can be trusted: tracking, searching or lost, and why."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from navloom_scan_localizer.search import candidates
from navloom_scan_localizer.sight import Sight, look_along
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
_SURE = 0.75
"""Least score of a pose to which the tracker moved for it to be trusted before a drive has proven it."""
_RIVAL, _APART = 0.05, (0.3, math.radians(10.0))
"""Lead in the score over other places for the same; least distance of another place, m and rad."""
_BEAMS = 45
"""About how many beams of a scan are compared with the map; the next scan's are others."""
_MEMORY = 0.3
"""Time over which scans are averaged, s; shorter than `patience`."""
_SUDDEN = 0.5
"""Share of its sight of the map that a robot loses from one scan to the next only if it is carried or shut in."""
_MOVED_SIGMA = 0.3
"""Standard deviation of the position above which a moved pose is not trusted, m: it is some place along a corridor."""
_PROOF = 1.0
"""Drive along which scans must fit before a pose is proven, m: then an obstacle starts no search for another."""
_FEW = 0.15
"""Share of the beams to a mapped wall that may pass through it in that drive: maps have errors."""
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


def _is_apart(off: Floats, information: Floats) -> bool:
    """Whether a pose, a shift (3,) away, is another place: a bare corridor is one place with a large covariance."""
    return (math.hypot(off[0], off[1]) > _APART[0] or abs(off[2]) > _APART[1]) and _distance(off, information) > 9.0


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
        self._seen, self._part = Sight(), 0
        """Recent counts, and the part of the next scan's beams that is counted."""
        self._time = -math.inf
        self._last_pose = tuple(tracker.pose.tolist())
        self._support, self._wanted = 0.0, tracker.settings.least_seen
        """Share of the last scan's beams that saw the map, and the share that is wanted for `_blind` to end."""
        self._blind: float | None = None
        """Time driven since the sight of the map was lost at once, s; infinite if it was never seen; else None."""
        self._proven = 0.0
        """Way driven with scans that fit, m."""
        self._is_moved, self._is_carried, self._rival = False, False, ""
        """Until a drive proves the pose: whether the tracker was moved to it; when the map had just gone out of sight;
        why it is not trusted then."""

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
            self._search_at = time + s.patience
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
        passed, (x, y, heading), (last_x, last_y, last) = time - self._time, tracker.pose.tolist(), self._last_pose
        way, turn = math.hypot(x - last_x, y - last_y), abs(math.remainder(heading - last, math.tau))
        self._time, self._last_pose = time, (x, y, heading)
        if len(beams):
            stride = max(1, len(beams) // _BEAMS)
            self._part = (self._part + 1) % stride
            part, gate = (self._part, stride), 2.0 * s.robust_scale
            seen = look_along(tracker.field, beams, echoes, tracker.pose, gate, part)
            self._seen = self._seen.then(seen, math.exp(-passed / _MEMORY))
            support, before, self._support = seen.support, self._support, seen.support
            if self._blind is None and support < (1.0 - _SUDDEN) * before and before >= s.least_seen:
                self._blind, self._wanted = 0.0, (1.0 - _SUDDEN) * before
            elif min(support, self._seen.support) >= self._wanted:
                self._blind = None
            elif self._blind is None and not tracker.is_proven and self._seen.support < s.least_seen:
                self._blind, self._wanted = math.inf, s.least_seen
        if self._blind is not None and max(way, turn) > _AT_REST * passed:
            self._blind += passed
        through = self._seen.through
        is_fit = self._blind is None and through <= _FEW * (through + self._seen.fit)
        self._proven = self._proven + way if is_fit else 0.0
        if self._proven >= _PROOF:
            tracker.is_proven, self._is_moved, self._is_carried, self._rival = True, False, False, ""

    def _doubt(self) -> str:
        """Why the pose cannot be trusted; empty if it can."""
        s, seen = self._tracker.settings, self._seen
        is_doubtful = self._is_moved or self._blind is not None
        through, most = seen.through, (0.5 if is_doubtful else 1.0) * (1.0 - s.trusted_share)
        if through > most * (through + seen.fit) and through > s.least_seen * seen.total:
            share = through / (through + seen.fit)
            return f"{share:.0%} of the beams to a wall of the map pass through it, more than {most:.0%}"
        if self._blind is not None and self._blind > s.blind_after:
            since = f"for {self._blind:.1f} s of driving" if self._blind < math.inf else "at this place"
            return f"less than {self._wanted:.0%} of the beams have seen the map {since}"
        limit = min(s.lost_sigma, _MOVED_SIGMA) if self._is_moved else s.lost_sigma
        sigma = position_sigma(self._tracker.covariance, limit)
        if sigma > limit:
            return f"the position has a standard deviation of {sigma:.2f} m, more than {limit:g} m"
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
            if seen.fit >= _GOOD * echoes:
                fits.append((seen.score, _distance(off, toward), pose, fused, off, seen.fit / echoes))
        best = max((fit[0] for fit in fits), default=-math.inf)
        if best < here.score + _BETTER:
            return False
        score, _, pose, fused, off, share = min((fit for fit in fits if fit[0] > best - _ALIKE), key=lambda fit: fit[1])
        others = sum(fit[0] > score - _RIVAL and _is_apart(_off(fit[2], pose), fused) for fit in fits)
        self._is_moved, self._rival = True, ""
        self._is_carried |= self._blind is not None and self._blind < math.inf
        if self._is_carried:
            self._rival = "the map went out of sight at once: the robot may have been carried anywhere"
        elif others or score < _SURE:
            self._rival = f"{share:.0%} of the echoes fit the map here, and {others} places nearby are as good"
        tracker.relocate(pose, inverse(fused))
        self._seen, self._last_pose, self._proven = Sight(), tuple(tracker.pose.tolist()), 0.0
        self._blind, self._support, self._wanted = None, 0.0, s.least_seen
        moved, turned = math.hypot(off[0], off[1]), abs(math.degrees(off[2]))
        self.reason = (
            f"{share:.0%} of the echoes fit the map {moved:.2f} m and {turned:.0f} deg from where odometry leads, "
            f"{here.fit / echoes:.0%} there"
        )
        return True
