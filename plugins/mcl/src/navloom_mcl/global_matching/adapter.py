"""The localizer `global_matching`: scan matching tracks, and a search over the map finds the robot."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from navloom import ANYWHERE, Context, Hypotheses, LocalizerInput, Pose2D, PoseEstimate
from navloom_scan_localizer.adapter import ScanMatching
from navloom_scans import anywhere
from navloom_scans.anywhere import MapSearch
from navloom_scans.maps import free_of_map
from numpy.typing import NDArray

from navloom_mcl import likelihood
from navloom_mcl.finding import Finder
from navloom_mcl.global_matching.params import GlobalMatchingParams
from navloom_mcl.global_matching.places import Place
from navloom_mcl.global_matching.supervisor import Guess, Search
from navloom_mcl.global_matching.watch import Watch

__all__ = ["GlobalMatching"]

Floats = NDArray[np.float64]

_DOUBTED = 0.7
"""Time without tracking after which the map is searched, s: until then, scan matching looks nearby."""
_NEAR = (1.0, math.radians(30.0))
"""Standard deviations of the place of a robot that is no longer tracked, m and rad."""
_PROVEN, _STARTED, _LEFT = 10.0, 2.0, 1.0
"""How much likelier than any other place the tracked one is, as a logarithm: if a drive had proven it, if it had not,
and if the view has changed at once."""
_EVERY, _OFTEN = 1.0, 0.2
"""Time from one message of hypotheses to the next, s: while the robot is tracked, and while it is searched."""


class GlobalMatching(ScanMatching):
    """Tracks like `scan_matching`, and finds the robot on the map if it is not where it is believed to be."""

    name = "global_matching"
    can_search = True
    Params = GlobalMatchingParams
    params: GlobalMatchingParams
    _searching: Search | None
    _doubted_at: float
    """Time since which the pose has been doubted, s; infinite while it is tracked."""
    _hypotheses: Hypotheses | None

    def __init__(self, params: GlobalMatchingParams, context: Context) -> None:
        self._map: MapSearch | None = None
        super().__init__(params, context)

    def reset(self) -> None:
        """Return to the start, or search for it; odometry has to begin there too."""
        super().reset()
        start, sigma = self.context.start, self.context.start_sigma
        if sigma is not None:
            self.search(None if math.isinf(sigma[0]) else start, sigma)

    def search(self, near: Pose2D | None = None, sigma: tuple[float, float] = ANYWHERE) -> None:
        place = None if near is None or math.isinf(sigma[0]) else np.array([near.x, near.y, near.heading])
        self._searching = self._search_from(None if place is None else (place, sigma))
        self._sigma = sigma if place is not None else self._extent()
        if place is not None:
            self._tracker.place(place)

    def hypotheses(self) -> Hypotheses | None:
        return self._hypotheses

    @classmethod
    def warm_up(cls) -> None:
        super().warm_up()
        anywhere.warm_up()
        likelihood.warm_up()

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        self._advance(given)
        time = given.odometry.stamp_ns / 1e9
        if self._searching is None:
            self._see(given)
            self._guard(given, time)
        if self._searching is not None:
            return self._seek(given, time)
        self._doubted_at = time if self._judge.state == "tracking" else self._doubted_at
        if time - self._told_at >= _EVERY:
            self._tell(given.odometry.stamp_ns, self._shown.pose[None, :], np.ones(1))
        return self._estimate(given.odometry)

    def _begin(self) -> None:
        super()._begin()
        self._searching = None
        self._sigma = _NEAR
        self._watch = Watch(Finder(self._map_search(), self.params.candidates), self.params.search_work)
        self._doubted_at = self._searching_at = math.inf
        self._told_at = -math.inf
        self._hypotheses = None

    def _take_field(self) -> None:
        super()._take_field()
        self._map = None
        if self._searching is not None:
            self._searching.take_map(self._map_search())
        self._watch = Watch(Finder(self._map_search(), self.params.candidates), self.params.search_work)

    def _map_search(self) -> MapSearch:
        if self._map is None:
            assert self._known is not None
            self._map = MapSearch(self._field, free_of_map(self._known, self.params), self.params.search())
        return self._map

    def _extent(self) -> tuple[float, float]:
        """Standard deviations of a robot that may be anywhere, m and rad."""
        assert self._known is not None
        return self._known.resolution * max(self._known.cells.shape), math.pi

    def _guard(self, given: LocalizerInput, time: float) -> None:
        """Begin a search if the pose is no longer trusted, or if the map has a place that fits better."""
        judge, tracker = self._judge, self._tracker
        if tracker.is_bridged:
            tracker.is_bridged = False
            self._watch.suspect()
        self._doubted_at = min(self._doubted_at, time)
        beams, echoes = None, 0
        if self._watch.wants(judge, time):
            beams, echoes = self._beams(given)
        better = self._watch.step(judge, tracker, time, beams, echoes)
        is_doubted = judge.state != "tracking" and (judge.is_elsewhere or time - self._doubted_at >= _DOUBTED)
        if is_doubted or better or not self._is_smooth:
            trust = _LEFT if judge.is_elsewhere else _PROVEN if judge.was_proven else _STARTED
            self._searching = self._search_from((tracker.pose, _NEAR), (tracker.pose, tracker.covariance, trust))
            self._sigma = _NEAR

    def _search_from(self, guess: Guess | None, kept: tuple[Floats, Floats, float] | None = None) -> Search:
        """A new search, see `Search`."""
        self._searching_at = math.inf
        settings, odometry = self._tracker.settings, self._tracker.odometry
        return Search(self._map_search(), settings, self.params.limits(), odometry, guess, kept)

    def _seek(self, given: LocalizerInput, time: float) -> PoseEstimate:
        """Continue the search; track again once it has found the robot."""
        odometry, search, tracker = given.odometry, self._searching, self._tracker
        assert search is not None
        self._searching_at = min(self._searching_at, time)
        beams, echoes = self._beams(given)
        found = search.step(tracker.odometry, self._passed, beams, echoes)
        if found is not None:
            self._take(found)
            self._tell(odometry.stamp_ns, tracker.pose[None, :], np.ones(1))
            return self._estimate(odometry)
        places = search.places.found
        if places:
            pose = places[0].tracker.pose
            tracker.relocate(pose, places[0].tracker.covariance)
            covariance = search.places.covariance(pose)
        else:
            covariance = np.diag([self._sigma[0] ** 2, self._sigma[0] ** 2, self._sigma[1] ** 2])
        if time - self._told_at >= _OFTEN or self._hypotheses is None:
            poses = np.array([place.tracker.pose for place in places]).reshape(-1, 3)
            self._tell(odometry.stamp_ns, poses, np.array([place.weight for place in places]))
        self._shown.follow(tracker.pose, tracker.odometry, self._passed, (0.0, 0.0), at_once=True)
        is_lost = time - self._searching_at >= self.params.give_up_after
        state: Literal["lost", "searching"] = "lost" if is_lost else "searching"
        pose2d = Pose2D(*tracker.pose.tolist())
        return PoseEstimate(odometry.stamp_ns, pose2d, odometry.twist, covariance, state, search.reason)

    def _take(self, found: Place) -> None:
        """Track from a place that a drive has proven."""
        tracker = self._tracker
        tracker.relocate(found.tracker.pose, found.tracker.covariance)
        tracker.prior = found.tracker.covariance.copy()
        self._begin()
        self._judge.trust()
        self._shown.follow(tracker.pose, tracker.odometry, self._passed, (0.0, 0.0), at_once=True)

    def _tell(self, stamp_ns: int, poses: Floats, weights: Floats) -> None:
        self._hypotheses = Hypotheses(stamp_ns, poses.copy(), weights)
        self._told_at = stamp_ns / 1e9
