"""Scan matching against a map, as a navloom localizer."""

from __future__ import annotations

import numpy as np
from navloom import (
    Claim,
    Context,
    Localizer,
    LocalizerInput,
    Odometry,
    Pose2D,
    PoseEstimate,
    RangeScan,
)
from navloom_scans import beams, matching, search, sight, small
from navloom_scans.maps import field_of_map, is_same_map
from navloom_scans.readings import beams_of, echoes_of, range_scans, silent_of
from navloom_scans.trail import OdometryTrail
from numpy.typing import NDArray

from navloom_scan_localizer.ambiguity import Ambiguity
from navloom_scan_localizer.judging import Judge
from navloom_scan_localizer.params import ScanMatchingParams
from navloom_scan_localizer.smoothing import SmoothPose
from navloom_scan_localizer.tracking import PoseTracker

__all__ = ["ScanMatching"]


class ScanMatching(Localizer[ScanMatchingParams]):
    """Corrects odometry by matching laser scans against a known map: its context's, or the mapper's that replaces it.

    It never matches what a mapper marks from the same scans.
    """

    name = "scan_matching"
    claims = {Claim.CORRECTS_DRIFT}
    accepts = (RangeScan,)
    needs_map = True
    needs_sensor = True

    def __init__(self, params: ScanMatchingParams, context: Context) -> None:
        super().__init__(params, context)
        self._known = self.context.map
        self._field = field_of_map(self._known, params)
        self.reset()

    def reset(self) -> None:
        """Return to the start pose; odometry has to begin there too."""
        start = self.context.start
        place = np.array([start.x, start.y, start.heading])
        self._tracker, self._stamp_ns = PoseTracker(self.params.settings(), self._field, place), 0
        self._trail = OdometryTrail(self.params.max_age, self.context.period)
        self._begin()

    def place(self, pose: Pose2D) -> None:
        """Move the estimate to a pose, with a new judge."""
        self._tracker.place(np.array([pose.x, pose.y, pose.heading]))
        self._begin()

    def _begin(self) -> None:
        tracker = self._tracker
        self._judge, self._ambiguity = Judge(tracker), Ambiguity(tracker)
        self._shown, self._is_smooth = SmoothPose(tracker.pose, tracker.odometry), True

    def configure(self, params: ScanMatchingParams) -> None:
        """Take new parameters and keep the pose."""
        self.params, self._tracker.settings = params, params.settings()
        self._take_field()

    @classmethod
    def warm_up(cls) -> None:
        beams.warm_up()
        matching.warm_up()
        search.warm_up()
        sight.warm_up()
        small.warm_up()

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        self._advance(given)
        self._see(given)
        return self._estimate(given.odometry)

    def _advance(self, given: LocalizerInput) -> None:
        """Take a new map, and move the pose by odometry."""
        # By identity, since a retained map arrives again when its publisher restarts.
        if given.known is not None and given.known is not self._known:
            old, self._known = self._known, given.known
            # Another message of the same map changes nothing.
            if old is None or not is_same_map(old, given.known):
                self._take_field()
        odometry = given.odometry
        pose, period_ns = odometry.pose, round(1e9 * self.context.period)
        row = np.array([pose.x, pose.y, pose.heading])
        self._passed = self._tracker.predict_since(self._stamp_ns, row, odometry.stamp_ns, period_ns)
        self._stamp_ns = odometry.stamp_ns
        self._trail.add(odometry.stamp_ns, self._tracker.odometry)

    def _beams(self, given: LocalizerInput) -> tuple[NDArray[np.float64], int]:
        """(n, 4) beams of the scans of this tick, first those with an echo, and the number of these."""
        return beams_of(given.scans, given.odometry, self.params, self._trail)

    def _see(self, given: LocalizerInput) -> None:
        """Correct the pose by the scans of this tick, and judge it."""
        odometry, tracker, scans = given.odometry, self._tracker, range_scans(given.scans)
        reading = odometry.stamp_ns, odometry.twist, self.params, self._trail
        points = echoes_of(scans, *reading)
        if not points:
            return
        echoes, time = points[0] if len(points) == 1 else np.concatenate(points), odometry.stamp_ns / 1e9
        if tracker.correct(echoes):
            self._ambiguity.look(echoes)
        if self._judge.is_due(time):
            silent = silent_of(scans, *reading)
            beams = np.concatenate((echoes, *silent)) if silent else echoes
            self._judge.look(beams, time, len(echoes))

    def _estimate(self, odometry: Odometry) -> PoseEstimate:
        tracker, shown, state, reason = self._tracker, self._shown, self._judge.state, self._judge.reason
        limits = tracker.settings.max_shift, tracker.settings.max_turn
        at_once = state != "tracking"
        self._is_smooth = shown.follow(tracker.pose, tracker.odometry, self._passed, limits, at_once=at_once)
        if not self._is_smooth:
            state, reason = "searching", "scans contradict odometry by more than can be corrected in motion"
        own = tracker.map_share * tracker.covariance
        covariance = own + self._ambiguity.spread + np.outer(shown.behind, shown.behind)
        return PoseEstimate(odometry.stamp_ns, Pose2D(*shown.pose.tolist()), odometry.twist, covariance, state, reason)

    def _take_field(self) -> None:
        """Match the known map, as the parameters read it, from now on."""
        self._field = self._tracker.field = field_of_map(self._known, self.params)
