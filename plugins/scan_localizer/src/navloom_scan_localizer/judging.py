"""Judges whether the tracker's pose can be trusted: tracking, searching or lost, and why."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from navloom_scans.poses import relative
from navloom_scans.search import candidates
from navloom_scans.sight import Sight, compare_views, look_along
from navloom_scans.small import inverse
from numpy.typing import NDArray

from navloom_scan_localizer.tracking import PoseTracker

__all__ = ["Judge", "distance_of", "position_sigma", "shift_to"]

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
_WIDE, _COARSE = 2.0, 2
"""Range in which a place to which the tracker moves must be the best, m, in every heading; spacing of that search."""
_BEAMS = 45
"""About how many beams of a scan are compared with the map; the next scan's are others."""
_MEMORY = 0.3
"""Time over which scans are averaged, s; shorter than `patience`."""
_EVERY = 0.1
"""Least time between two scans that are judged, s."""
_CONTINUED = 0.7
"""Share of the beams that continue the last scan as long as a robot drives past things; past people, most scans do."""
_SUDDEN, _LITTLE = 0.5, 0.1
"""Share of its sight of the map that a robot loses from one scan to the next if it is carried off; share of the beams
on the map below which it has no sight to lose."""
_BEYOND = 0.15
"""Share of the beams that pass through what was seen before, above which the robot is at another place."""
_STEP_TURN = math.radians(35.0)
"""Largest error of the heading in a step of odometry that a search undoes, rad."""
_LONG = (0.5, math.radians(45.0))
"""Motion between two scans beyond which their views need not agree, m and rad."""
_LEFT = 0.3
"""Way driven since the view was lost from which the robot may be anywhere, m."""
_MOVED_SIGMA = 0.3
"""Standard deviation of the position above which a moved pose is not trusted, m: it is some place along a corridor."""
_PROOF = 1.0
"""Drive along which scans must fit before a pose is proven, m: then an obstacle starts no search for another."""
_FEW = 0.15
"""Share of the beams to a mapped wall that may pass through it in that drive: maps have errors."""


def position_sigma(covariance: Floats, limit: float) -> float:
    """Largest standard deviation of the position in any direction, m; 0 where it is clearly below a limit, m.

    The trace is never less than the largest eigenvalue, so most scans need no eigenvalue decomposition.
    """
    if 1.01 * (covariance[0, 0] + covariance[1, 1]) < limit * limit:
        return 0.0
    half_sum, half_gap = 0.5 * (covariance[0, 0] + covariance[1, 1]), 0.5 * (covariance[0, 0] - covariance[1, 1])
    return math.sqrt(float(half_sum) + math.hypot(half_gap, covariance[1, 0]))


def shift_to(pose: Floats, other: Floats) -> Floats:
    """A pose (3,) less another one, the heading wrapped."""
    off: Floats = pose - other
    off[2] = math.remainder(off[2], math.tau)
    return off


def distance_of(off: Floats, information: Floats) -> float:
    """Square of the Mahalanobis distance of a shift (3,), by an inverse covariance (3, 3)."""
    return float((information * off[:, None] * off).sum())


def _is_apart(off: Floats, information: Floats) -> bool:
    """Whether a pose, a shift (3,) away, is another place: a bare corridor is one place with a large covariance."""
    return (math.hypot(off[0], off[1]) > _APART[0] or abs(off[2]) > _APART[1]) and distance_of(off, information) > 9.0


class Judge:
    """Judges a tracker by its scans and moves it to a better pose if there is one.

    An echo before a mapped wall comes from something that the map lacks and says nothing about the pose. Beams that
    pass through mapped walls contradict it. As long as the pose is not proven by a drive, other poses nearby are tried
    whenever not all echoes fit. If one of them fits clearly better, the tracker continues from there. A robot whose
    view changes at once, and with it that of the map, has been carried: no pose is trusted until it has the view again,
    or a drive has proven one.

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
        self._counts, self._seen, self._has_seen = np.zeros(6), Sight(), False
        """Recent counts, as numbers and by name, and whether the map was seen at this place."""
        self._part = 0
        """Part of the next scan's beams that is counted."""
        self._time = -math.inf
        self._view: tuple[Floats, int] | None = None
        """Beams and number of echoes of the last scan that continued the one before; None if no pose was trusted."""
        self._view_from, self._view_at = tracker.odometry, tracker.pose
        self._last = tracker.odometry
        self._before: tuple[Floats, int, Floats] | None = None
        """Pose of that scan, odometry frame and map frame, and of the last one, odometry frame; beams, number of echoes
        and pose, map frame, of the scan before it."""
        self._is_cut, self._continued, self._beyond, self._way = False, 1.0, 0.0, 0.0
        """Whether that view is lost; shares of the last scan's beams that continue it, and pass through it; way driven
        since, m."""
        self._proven = 0.0
        """Way driven with scans that fit, m."""
        self._is_moved, self._rival = False, ""
        """Until a drive proves the pose: whether the tracker was moved to it; why it is not trusted then."""

    @property
    def _gate(self) -> float:
        """Largest distance of an echo from its wall, m."""
        return 2.0 * self._tracker.settings.robust_scale

    @property
    def is_proven(self) -> bool:
        """Whether a drive has proven the pose."""
        return self._proven >= _PROOF

    @property
    def was_proven(self) -> bool:
        """Whether a drive has proven the pose, though scans may contradict it now."""
        return self._tracker.is_proven

    @property
    def through(self) -> float:
        """Share of the beams to a mapped wall that pass through it, of recent scans; 0 where few do."""
        through, s = self._seen.through, self._tracker.settings
        return through / (through + self._seen.fit) if through > s.least_seen * self._seen.total else 0.0

    def trust(self) -> None:
        """Take the pose as proven by a drive."""
        self._proven, self._has_seen, self._tracker.is_proven = _PROOF, True, True

    def is_due(self, time: float) -> bool:
        """Whether a scan at a time, s, is judged."""
        return time - self._time > _EVERY - 1e-3

    def look(self, beams: Floats, time: float, echoes: int | None = None) -> None:
        """Judge the pose after a correction.

        Args:
            beams: (n, 4) end point, m, and direction, base frame: the beams of that correction, then those without
                an echo, which end at the range of the sensor.
            time: Current time, s.
            echoes: Number of beams with an echo; all by default.
        """
        if not self.is_due(time):
            return
        s, tracker, count = self._tracker.settings, self._tracker, len(beams) if echoes is None else echoes
        self._observe(beams, count, time)
        share, is_broken = tracker.share, self._continued < _CONTINUED
        if share is not None and (share >= s.sure_share or (self._proven >= _PROOF and not is_broken)):
            self._search_at = time + s.patience
        elif share is not None and (time >= self._search_at or is_broken):
            self._search_at = time + s.search_every
            if self._move(beams, count, max(s.search_turn, _STEP_TURN) if is_broken else s.search_turn):
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
        """Count what a scan sees, and the way along which scans have fitted."""
        tracker, s, passed, self._time = self._tracker, self._tracker.settings, time - self._time, time
        if not len(beams):
            return
        now = tracker.odometry
        step, way = relative(self._view_from, now), math.dist(self._last[:2], now[:2])
        self._way, self._last = math.hypot(step[0], step[1]), now
        stride = max(1, len(beams) // _BEAMS)
        # Other beams in each scan, so that over some scans all are compared.
        self._part = (self._part + 1) % stride
        part = (self._part, stride)
        self._compare(beams, echoes, step, part)
        if not self._is_cut:
            self._before = (*self._view, self._view_at) if self._view is not None else None
            self._view = (beams, echoes) if self.state == "tracking" else None
            self._view_from, self._view_at = now, tracker.pose
        # By time and not by scan: sensors differ in rate.
        self._counts *= math.exp(-passed / _MEMORY)
        self._seen = look_along(tracker.field, beams, echoes, tracker.pose, self._gate, part, self._counts)
        self._has_seen = self._has_seen or self._seen.support >= s.least_seen
        through = self._seen.through
        is_fit = self._has_seen and through <= _FEW * (through + self._seen.fit)
        self._proven = self._proven + way if is_fit else 0.0
        if self._proven >= _PROOF:
            tracker.is_proven, self._is_moved, self._rival = True, False, ""
            if self._is_cut:
                self._is_cut, self._view = False, None

    def _compare(self, beams: Floats, echoes: int, step: Floats, part: tuple[int, int]) -> None:
        """Compare a scan with the last view. It is lost if the scan sees another one, and far less of the map."""
        if self._view is None:
            return
        if math.hypot(step[0], step[1]) > _LONG[0] or abs(step[2]) > _LONG[1]:
            self._is_cut = False
            return
        self._continued, self._beyond = compare_views(*self._view, beams, echoes, step, self._gate, part)
        if self._continued < _CONTINUED and not self._is_cut:
            # Odometry may be wrong and the scan right.
            moved = relative(self._view_at, self._tracker.pose)
            shares = compare_views(*self._view, beams, echoes, moved, self._gate, part)
            if shares[0] >= _CONTINUED:
                self._continued, self._beyond = shares
        if self._continued >= _CONTINUED:
            self._is_cut = False
        elif not self._is_cut:
            seen = look_along(self._tracker.field, beams, echoes, self._tracker.pose, self._gate)
            if seen.support < max(_SUDDEN * self._seen.support, _LITTLE):
                self._is_cut, self._proven = True, 0.0

    @property
    def is_elsewhere(self) -> bool:
        """Whether the view has changed at once, not only by things that came close to a robot that stands."""
        return self._is_cut and (self._beyond > _BEYOND or self._way > _LEFT)

    def _doubt(self) -> str:
        """Why the pose cannot be trusted; empty if it can."""
        s, seen = self._tracker.settings, self._seen
        if self.is_elsewhere:
            return f"{self._continued:.0%} of the beams continue the view of before: the robot was carried or shut in"
        through, most = seen.through, (0.5 if self._is_moved else 1.0) * (1.0 - s.trusted_share)
        if through > most * (through + seen.fit) and through > s.least_seen * seen.total:
            share = through / (through + seen.fit)
            return f"{share:.0%} of the beams to a wall of the map pass through it, more than {most:.0%}"
        if not self._has_seen and seen.total:
            return f"less than {s.least_seen:.0%} of the beams have seen the map at this place"
        limit = min(s.lost_sigma, _MOVED_SIGMA) if self._is_moved else s.lost_sigma
        sigma = position_sigma(self._tracker.covariance, limit)
        if sigma > limit:
            return f"the position has a standard deviation of {sigma:.2f} m, more than {limit:g} m"
        return self._rival

    def _move(self, beams: Floats, echoes: int, turn: float) -> bool:
        """Move to the best pose nearby if it fits well and clearly better; whether the tracker moved.

        Args:
            beams, echoes: As for `look`.
            turn: Largest change of heading, rad.
        """
        tracker, s, points = self._tracker, self._tracker.settings, beams[:echoes]
        wide = np.diag([s.search_reach**2, s.search_reach**2, turn**2]) + tracker.covariance
        toward, fits, gate = inverse(wide), [], self._gate
        here = look_along(tracker.field, beams, echoes, tracker.pose, gate)
        for place in candidates(tracker.field, points, tracker.pose, s.search_reach, turn, _CANDIDATES):
            pose, fused, _ = tracker.fit(points, place, wide)
            seen = look_along(tracker.field, beams, echoes, pose, gate)
            off = shift_to(pose, tracker.pose)
            if seen.fit >= _GOOD * echoes:
                fits.append((seen.score, distance_of(off, toward), pose, fused, off, seen.fit / echoes))
        best = max((fit[0] for fit in fits), default=-math.inf)
        if best < here.score + _BETTER:
            return False
        score, _, pose, fused, off, share = min((fit for fit in fits if fit[0] > best - _ALIKE), key=lambda fit: fit[1])
        others = sum(fit[0] > score - _RIVAL and _is_apart(shift_to(fit[2], pose), fused) for fit in fits)
        if not others and self._continues(beams, echoes, pose, score):
            # The scan continues the last one there: odometry was wrong, and the robot is where it was tracked.
            tracker.bridge(pose, inverse(fused))
            self._view_at, self._is_cut, self._continued = tracker.pose, False, 1.0
            self._counts, self._seen = np.zeros(6), here
            return False
        self._is_moved, self._rival = True, ""
        if others or score < _SURE:
            self._rival = f"{share:.0%} of the echoes fit the map here, and {others} places nearby are as good"
        elif self._is_better_elsewhere(beams, echoes, pose, score):
            self._rival = f"{share:.0%} of the echoes fit the map here, but more within {_WIDE:g} m"
        tracker.relocate(pose, inverse(fused))
        self._counts, self._seen, self._has_seen, self._proven = np.zeros(6), Sight(), False, 0.0
        moved, turned = math.hypot(off[0], off[1]), abs(math.degrees(off[2]))
        self.reason = (
            f"{share:.0%} of the echoes fit the map {moved:.2f} m and {turned:.0f} deg from where odometry leads, "
            f"{here.fit / echoes:.0%} there"
        )
        return True

    def _continues(self, beams: Floats, echoes: int, pose: Floats, score: float) -> bool:
        """Whether a scan at a pose, (3,), of a given score continues the last view of a pose that was trusted.

        Views of scans that are seconds apart cannot be compared: then the pose must be the best one around.
        """
        if self._before is None or self.state != "tracking":
            return False
        view, heard, at = self._before
        step = relative(at, pose)
        if math.hypot(step[0], step[1]) > _LONG[0] or abs(step[2]) > _LONG[1]:
            is_sure = self._tracker.is_proven and score >= _SURE
            return is_sure and not self._is_better_elsewhere(beams, echoes, pose, score)
        same, beyond = compare_views(view, heard, beams, echoes, step, self._gate)
        return same >= _CONTINUED and beyond <= _BEYOND

    def _is_better_elsewhere(self, beams: Floats, echoes: int, pose: Floats, score: float) -> bool:
        """Whether beams fit better at another place or heading in a wide range round a pose, (3,), of a given score."""
        tracker, points = self._tracker, beams[:echoes]
        loose = np.diag([_APART[0] ** 2, _APART[0] ** 2, _APART[1] ** 2])
        for place in candidates(tracker.field, points, pose, _WIDE, math.pi, _CANDIDATES, _COARSE):
            other, _, _ = tracker.fit(points, place, loose)
            if look_along(tracker.field, beams, echoes, other, self._gate).score > score + _ALIKE:
                return True
        return False
