"""What a filter and a search together believe: the pose, the places that remain, and whether one can be trusted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from navloom_scans.anywhere import MapSearch
from navloom_scans.poses import compose, pose_of, relative
from navloom_scans.sight import look_along
from numpy.typing import NDArray

from navloom_mcl.filter import ParticleFilter
from navloom_mcl.finding import Finder, Found, History

__all__ = ["Belief", "BeliefSettings"]

Floats = NDArray[np.float64]

_FOUND = np.diag([0.08**2, 0.08**2, math.radians(2.5) ** 2])
"""Covariance of a place that the search has found and fitted, m² and rad²."""
_KNOWN = 0.02
"""Weight from which a place counts as one that the filter has."""
_APART = (0.5, math.radians(15.0))
"""Least distance of two places, m or rad."""
_SOFT = 0.1
"""Difference of two scores by which one place is e times as likely as the other."""
_RIVAL, _BETTER = 0.1, 0.15
"""Score of a new place, compared with the present one: it may be less by the first while the place is new; once it is
proven it must be more by the second."""
_SOFT_ALONG, _COMPARED = 0.02, 8
"""The same for the mean scores along the way, which are known better; number of new places that are compared."""
_LITTLE = 0.05
"""Likelihood, compared with that of the present place, below which a new place is left out."""
_POOR = 0.5
"""Score of the best place near a guess below which the guess may be wrong."""
_SHARE = 0.3
"""Share of the weight that new places get together."""
_WAY_PER_TURN = 0.3
"""Way that a turn of 1 rad counts as, m."""
_FIRST_SCANS = 3
"""Scans after a spread that are used without motion."""
_BEAMS = 60
"""About how many beams show whether the pose fits."""
_MEMORY = 0.5
"""Share of the earlier counts of beams that a new scan leaves."""
_EVERY = 0.2
"""Least time between two looks along the map, s."""
_LEAST_SIGMA = np.diag([0.005**2, 0.005**2, math.radians(0.15) ** 2])
"""Least covariance that is reported: the particles of a set may all come from one."""
_QUICK, _SLOW, _FALL = 0.5, 0.03, 0.7
"""Weight of a new scan in the quick and in the slow mean of the likelihood; share of the slow one below which the quick
one has fallen."""
_FEW = 20
"""Least number of echoes of a scan that is used."""
_PAUSE = 5.0
"""Longest time between two searches of a robot that does not know where it is, s."""


@dataclass(frozen=True, slots=True)
class BeliefSettings:
    """Settings, lengths in m, angles in rad; the README explains each."""

    start_sigma: float = 0.05
    start_turn_sigma: float = math.radians(2.0)
    update_way: float = 0.1
    update_turn: float = math.radians(5.0)
    candidates: int = 40
    search_work: int = 30_000
    search_way: float = 0.5
    sure_weight: float = 0.9
    prove_way: float = 1.0
    trusted_share: float = 0.6
    patience: float = 0.5
    lost_after: float = 60.0
    lost_sigma: float = 0.5


class Belief:
    """Follows the robot with particles, and searches the map whenever they do not show one place that fits.

    Attributes:
        state: "tracking", "searching", or "lost".
        reason: Why the state is not "tracking"; else empty.
        pose: (3,) mean of the likeliest place: x, y, m, heading, rad in [-π, π), map frame.
        covariance: (3, 3) mean square deviation of all particles from it.
        settings: May be replaced at any time.
    """

    state: Literal["tracking", "searching", "lost"]
    reason: str
    _guess: tuple[Floats, tuple[float, float]] | None
    """What the searches look near until the place is proven; None for the whole map."""
    _time: float
    """Time since the last start, s."""
    _since: float
    """Time from which the scans have contradicted the state, s."""
    _searching_since: float
    _proven: float
    """Way along which the present place has fitted, m."""
    _cleared: float
    """That way at the last search that found no other place."""
    _history: History
    _way: float
    _turn: float
    """Motion since the last scan that was used, m and rad."""
    _part: int
    """Part of the next scan's beams that is looked at."""
    _alarm: bool
    """Whether so many beams pass through walls that other places are searched."""
    _fast: float
    _slow: float
    """Mean likelihood of a beam, over a few and over many scans."""
    _counts: Floats
    """Recent counts of `look_along`."""

    def __init__(self, filter: ParticleFilter, search: MapSearch, settings: BeliefSettings) -> None:
        self.settings, self.filter = settings, filter
        self._search, self._finder = search, Finder(search, settings.candidates)
        self.odometry = np.zeros(3)
        self.place(np.zeros(3))

    def take_map(self, search: MapSearch) -> None:
        """Go on with another map: the particles stay where they are."""
        self.filter.field = search.field
        self._search, self._finder = search, Finder(search, self.settings.candidates)

    def place(self, pose: Floats) -> None:
        """Take a pose, (3,), as the robot's."""
        s = self.settings
        sigma = np.array([s.start_sigma, s.start_sigma, s.start_turn_sigma])
        self.filter.spread(pose[None, :], np.diag(sigma**2), None, self.filter.settings.least)
        self.pose, self.covariance = pose_of(*pose.tolist()), np.diag(sigma**2)
        self._restart("tracking", "")
        self._proven = self._cleared = s.prove_way

    def forget(self, near: Floats | None, sigma: tuple[float, float]) -> None:
        """Search for the robot, anywhere or near a guess, (3,) with standard deviations, m and rad."""
        self.filter.clear()
        self._restart("searching", "the place is not known: the map is searched")
        self._proven, self._cleared, self._guess = 0.0, 0.0, None if near is None else (near, sigma)
        rows, columns = self._search.shape
        wide = max(rows, columns) if near is None else min(sigma[0], max(rows, columns))
        turn = math.pi if near is None else min(sigma[1], math.pi)
        self.covariance = np.diag([wide**2, wide**2, turn**2])
        if near is not None:
            self.pose = pose_of(*near.tolist())

    def predict(self, odometry: Floats, time: float) -> None:
        """Follow odometry, (3,) x, y, m, heading, rad, odometry frame, over a time, s."""
        step, self.odometry = relative(self.odometry, odometry), odometry.copy()
        way = math.hypot(step[0], step[1])
        self._way, self._turn = self._way + way, self._turn + abs(float(step[2]))
        self._unproven_way += way + _WAY_PER_TURN * abs(float(step[2]))
        self._time += time
        self.filter.predict(step, time)
        if not len(self.filter.particles):
            self.pose = compose(self.pose, step)
        if self._guess is not None:
            near, sigma = self._guess
            self._guess = compose(near, step), sigma

    def correct(self, beams: Floats, echoes: int) -> None:
        """Take the beams of this tick, as for `ParticleFilter.correct`, and continue the search."""
        s = self.settings
        is_usable = echoes >= _FEW
        if is_usable and len(self.filter.particles) and self._is_due():
            self._compare(self.filter.correct(beams, echoes))
            self._way = self._turn = 0.0
            self._first -= 1
            self._history.add(self._search, beams, echoes, self.odometry)
            self._look(beams, echoes)
        elif is_usable and len(self.filter.particles) and self._time - self._looked >= _EVERY:
            self._look(beams, echoes)
        if is_usable and not self._finder.is_busy and self._wants_search():
            near, sigma = self._guess if self._guess is not None else (None, (math.inf, math.inf))
            self._finder.begin(beams, echoes, self.odometry, near, sigma)
            self._searched = self._time
        here = self.pose if len(self.filter.particles) else None
        if (found := self._finder.step(s.search_work, self.odometry, here)) is not None:
            self._take(found)
        self._estimate()
        self._judge()

    def _compare(self, likelihood: float) -> None:
        """Notice a sudden fall of the mean likelihood of a beam, as augmented Monte Carlo localisation does."""
        self._fast += _QUICK * (likelihood - self._fast)
        self._slow += _SLOW * (likelihood - self._slow)

    def _is_due(self) -> bool:
        s = self.settings
        return self._first > 0 or self._way >= s.update_way or self._turn >= s.update_turn

    def _wants_search(self) -> bool:
        if not len(self.filter.particles):
            return True
        if self.state == "tracking" and not self._alarm:
            return False
        step = relative(self._finder.odometry, self.odometry)
        way = math.hypot(step[0], step[1]) + _WAY_PER_TURN * abs(float(step[2]))
        return way >= self.settings.search_way or self._time - self._searched >= _PAUSE

    def _take(self, found: Found) -> None:
        """Use what a search has found."""
        if not len(found.poses) or found.scores[0] < _POOR:
            # The guess may be wrong: the next search looks everywhere.
            self._guess = None
        if not len(found.poses):
            if not len(self.filter.particles):
                self._doubt_text = "no place on the map fits what the robot sees"
            return
        if not len(self.filter.particles):
            weights = _likelihoods(found.scores)
            self.filter.spread(found.poses, _FOUND, weights)
            self._first, self._proven, self._unproven_way = _FIRST_SCANS, 0.0, 0.0
            self._counts[:] = 0.0
            return
        least = found.score_here + (_BETTER if self.state == "tracking" else -_RIVAL)
        places = self.filter.hypotheses()
        known = places.poses[places.weights >= _KNOWN]
        new = [
            k
            for k, pose in enumerate(found.poses)
            if found.scores[k] >= least and all(_is_apart(pose, other) for other in known)
        ]
        weights = self._weights_of(found, new)
        if not weights.any():
            self._cleared = self._proven
            return
        self.filter.inject(found.poses[new], _FOUND, weights, _SHARE * min(1.0, float(weights.sum())))
        self._first, self._cleared = _FIRST_SCANS, 0.0
        if found.scores[new[0]] > found.score_here + _BETTER:
            self._proven = 0.0
            self._history.clear()

    def _weights_of(self, found: Found, new: list[int]) -> Floats:
        """(k,) how likely new places, by index, are compared with the present one: by this scan and those of the way.

        A place where this scan fits far better is not compared along the way: the robot may have been carried there.
        """
        weights = np.zeros(len(new))
        here = self._history.score(self._search, self.pose, self.odometry)
        for n, k in enumerate(new[:_COMPARED]):
            better, along = float(found.scores[k] - found.score_here), 0.0
            if better < 2.0 * _BETTER:
                along = self._history.score(self._search, found.poses[k], self.odometry) - here
            weight = math.exp(min(better / _SOFT + along / _SOFT_ALONG, 3.0))
            weights[n] = weight if weight > _LITTLE else 0.0
        return weights

    def _look(self, beams: Floats, echoes: int) -> None:
        """Count what the beams see along the map from the likeliest place, and prove it by a drive."""
        self._looked = self._time
        top = self.filter.hypotheses()
        stride = max(1, len(beams) // _BEAMS)
        self._part = (self._part + 1) % stride
        self._counts *= _MEMORY
        gate = self.filter.settings.gate
        seen = look_along(self.filter.field, beams, echoes, top.poses[0], gate, (self._part, stride), self._counts)
        through = seen.through / max(seen.through + seen.fit, 1.0)
        self._through = through if seen.through > 0.05 * seen.total else 0.0
        s = self.settings
        self._alarm = self._through > 0.5 * (1.0 - s.trusted_share) or self._fast < _FALL * self._slow
        if self._alarm or top.weights[0] < s.sure_weight:
            self._proven = min(self._proven, s.prove_way) if self._proven >= s.prove_way else 0.0
        else:
            self._proven += self._unproven_way
        self._unproven_way = 0.0

    def _estimate(self) -> None:
        places = self.filter.hypotheses()
        if len(places.poses):
            self.pose = places.poses[0]
            self.covariance = self.filter.covariance(self.pose) + _LEAST_SIGMA

    def _doubt(self) -> str:
        """Why the pose cannot be trusted; empty if it can."""
        s, places = self.settings, self.filter.hypotheses()
        if not len(places.poses):
            return self._doubt_text
        if places.weights[0] < s.sure_weight:
            count = int((places.weights >= _KNOWN).sum())
            return f"{count} places fit, the likeliest with a weight of {places.weights[0]:.0%}"
        sigma = math.sqrt(max(self.covariance[0, 0], self.covariance[1, 1]))
        if sigma > s.lost_sigma:
            return f"the position has a standard deviation of {sigma:.2f} m, more than {s.lost_sigma:g} m"
        if self._through > 1.0 - s.trusted_share:
            return f"{self._through:.0%} of the beams to a wall of the map pass through it"
        if self._proven < s.prove_way or self._cleared < 0.5 * s.prove_way:
            return f"one place fits, along {self._proven:.1f} m of {s.prove_way:g} m so far"
        return ""

    def _judge(self) -> None:
        s, doubt = self.settings, self._doubt()
        is_tracking = self.state == "tracking"
        if bool(doubt) != is_tracking:
            self._since = self._time
        if doubt and not is_tracking:
            self.reason = doubt
        if self._time - self._since >= s.patience:
            self.state, self.reason = ("searching", doubt) if is_tracking else ("tracking", "")
            self._since = self._searching_since = self._time
            self._guess = None
            if self.state == "searching":
                self._proven = self._cleared = 0.0
        elif self.state == "searching" and self._time - self._searching_since >= s.lost_after:
            self.state = "lost"

    def _restart(self, state: Literal["tracking", "searching", "lost"], reason: str) -> None:
        self.state, self.reason = state, reason
        self._doubt_text = reason
        self._finder.stop()
        self._guess = None
        self._time = self._since = self._searching_since = 0.0
        self._looked = self._searched = -math.inf
        self._way = self._turn = self._unproven_way = self._through = 0.0
        self._first, self._part, self._alarm = _FIRST_SCANS, 0, False
        self._counts = np.zeros(6)
        self._fast = self._slow = 0.0
        self._history = History()


def _likelihoods(scores: Floats) -> Floats:
    """(k,) relative likelihoods of places from their scores."""
    most = float(scores.max())
    return np.array([math.exp((score - most) / _SOFT) for score in scores.tolist()])


def _is_apart(pose: Floats, other: Floats) -> bool:
    off, turned = math.hypot(pose[0] - other[0], pose[1] - other[1]), math.remainder(pose[2] - other[2], math.tau)
    return off > _APART[0] or abs(turned) > _APART[1]
