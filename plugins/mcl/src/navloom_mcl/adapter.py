"""Monte Carlo localisation as a navloom localizer."""

from __future__ import annotations

import math

import numpy as np
from navloom import (
    ANYWHERE,
    Claim,
    Context,
    Hypotheses,
    Localizer,
    LocalizerInput,
    OccupancyGrid,
    Pose2D,
    PoseEstimate,
    RangeScan,
)
from navloom_scans import anywhere, beams
from navloom_scans.anywhere import MapSearch
from navloom_scans.maps import field_of_map, free_of_map, is_same_map
from navloom_scans.readings import beams_of
from navloom_scans.trail import OdometryTrail

from navloom_mcl import filter
from navloom_mcl.belief import Belief
from navloom_mcl.filter import ParticleFilter
from navloom_mcl.params import MclParams

__all__ = ["Mcl"]

_TELL_NS = 500_000_000
"""Longest time between two messages of the places, ns; longer than a tick, so that they do not fill a recording."""


class Mcl(Localizer[MclParams]):
    """Follows the robot on a known map with weighted samples of its pose, and finds it anywhere on that map."""

    name = "mcl"
    claims = {Claim.CORRECTS_DRIFT}
    accepts = (RangeScan,)
    needs_map = True
    needs_sensor = True
    can_search = True

    def __init__(self, params: MclParams, context: Context) -> None:
        super().__init__(params, context)
        self._known = self.context.map
        self._search = _search_of(self._known, params)
        self._random = context.stream("particles")
        self._first_draw = self._random.bit_generator.state
        self.reset()

    def reset(self) -> None:
        """Return to the start pose, or search for it; odometry has to begin there too."""
        if self._known is not self.context.map:
            self._known = self.context.map
            self._search = _search_of(self._known, self.params)
        self._random.bit_generator.state = self._first_draw
        particles = ParticleFilter(self._search.field, self.params.filter(), self._random)
        self._belief = Belief(particles, self._search, self.params.belief())
        self._stamp_ns: int | None = None
        self._trail = OdometryTrail(self.params.max_age, self.context.period)
        self._places: Hypotheses | None = None
        start, sigma = self.context.start, self.context.start_sigma
        if sigma is None:
            self.place(start)
        elif math.isinf(sigma[0]):
            self.search()
        else:
            self.search(start, sigma)

    def place(self, pose: Pose2D) -> None:
        self._belief.place(_row(pose))

    def search(self, near: Pose2D | None = None, sigma: tuple[float, float] = ANYWHERE) -> None:
        self._belief.forget(None if near is None else _row(near), sigma)

    def configure(self, params: MclParams) -> None:
        """Take new parameters and keep the particles."""
        self.params, belief = params, self._belief
        belief.settings, belief.filter.settings = params.belief(), params.filter()
        self._search = _search_of(self._known, params)
        belief.take_map(self._search)

    @classmethod
    def warm_up(cls) -> None:
        anywhere.warm_up()
        beams.warm_up()
        filter.warm_up()

    def hypotheses(self) -> Hypotheses | None:
        return self._places

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        if given.known is not None and given.known is not self._known:
            self._take_map(given.known)
        odometry, belief = given.odometry, self._belief
        # Before the first step a tick has passed, whatever the run clock shows.
        passed = self.context.period if self._stamp_ns is None else (odometry.stamp_ns - self._stamp_ns) / 1e9
        belief.predict(_row(odometry.pose), max(0.0, passed))
        self._stamp_ns = odometry.stamp_ns
        self._trail.add(odometry.stamp_ns, _row(odometry.pose))
        belief.correct(*beams_of(given.scans, odometry, self.params, self._trail))
        self._tell(odometry.stamp_ns)
        pose = Pose2D(*belief.pose.tolist())
        return PoseEstimate(odometry.stamp_ns, pose, odometry.twist, belief.covariance, belief.state, belief.reason)

    def _tell(self, stamp_ns: int) -> None:
        """Make a new message of the places where their number changes, and now and then."""
        belief, places = self._belief, self._belief.filter.hypotheses()
        count = 1 if belief.state == "tracking" else len(places.poses)
        last = self._places
        if last is None or len(last.poses) != count or stamp_ns - last.stamp_ns >= _TELL_NS:
            self._places = Hypotheses(stamp_ns, places.poses[:count], places.weights[:count])

    def _take_map(self, known: OccupancyGrid) -> None:
        """Match another known map from now on; another message of the same map changes nothing."""
        old, self._known = self._known, known
        if old is None or not is_same_map(old, known):
            self._search = _search_of(known, self.params)
            self._belief.take_map(self._search)


def _search_of(known: OccupancyGrid | None, params: MclParams) -> MapSearch:
    field = field_of_map(known, params)
    assert known is not None
    return MapSearch(field, free_of_map(known, params), params.search())


def _row(pose: Pose2D) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.array([pose.x, pose.y, pose.heading])
