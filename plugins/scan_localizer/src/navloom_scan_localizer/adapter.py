"""Scan matching as a navloom localizer."""

from __future__ import annotations

import math

import numpy as np
from navloom import (
    Context,
    Localizer,
    LocalizerInput,
    Odometry,
    Pose2D,
    PoseEstimate,
    RangeScan,
)
from numpy.typing import NDArray

from navloom_scan_localizer import beams, matching, search
from navloom_scan_localizer.judging import Judge
from navloom_scan_localizer.maps import field_of_map
from navloom_scan_localizer.params import ScanMatchingParams
from navloom_scan_localizer.tracking import PoseTracker

__all__ = ["ScanMatching"]


class ScanMatching(Localizer):
    """Corrects odometry by matching laser scans with the map of its context."""

    name = "scan_matching"
    accepts = (RangeScan,)
    needs_map = True
    needs_sensor = True
    Params = ScanMatchingParams

    def __init__(self, params: ScanMatchingParams, context: Context) -> None:
        super().__init__(params, context)
        self._field = field_of_map(self.context.map, params)
        self.reset()

    def reset(self) -> None:
        """Back to the start pose; odometry has to begin there too."""
        start = self.context.start
        place = np.array([start.x, start.y, start.heading])
        self._tracker, self._stamp_ns = PoseTracker(self.params.settings(), self._field, place), 0
        self._judge = Judge(self._tracker)

    def configure(self, params: ScanMatchingParams) -> None:
        """Take new parameters and stay where it is."""
        self._field = field_of_map(self.context.map, params)
        self.params, self._tracker.settings, self._tracker.field = params, params.settings(), self._field

    @classmethod
    def warm_up(cls) -> None:
        beams.warm_up()
        matching.warm_up()
        search.warm_up()

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        odometry, tracker = given.odometry, self._tracker
        seen, time = odometry.pose, (odometry.stamp_ns - self._stamp_ns) / 1e9
        tracker.predict(np.array([seen.x, seen.y, seen.heading]), time)
        self._stamp_ns = odometry.stamp_ns
        points = [self._points(scan, odometry) for scan in given.scans if isinstance(scan, RangeScan)]
        if points:
            joined = np.concatenate(points)
            tracker.correct(joined)
            self._judge.look(joined, odometry.stamp_ns / 1e9)
        state, reason = self._judge.state, self._judge.reason
        pose = Pose2D(*tracker.pose.tolist())
        return PoseEstimate(odometry.stamp_ns, pose, odometry.twist, tracker.covariance, state, reason)

    def _points(self, scan: RangeScan, odometry: Odometry) -> NDArray[np.float64]:
        p, twist, late = self.params, odometry.twist, (scan.stamp_ns - odometry.stamp_ns) / 1e9
        if abs(late) > p.max_age:
            return np.empty((0, 4))
        limits = np.array([scan.range_min, scan.range_max - p.limit_margin, math.radians(p.max_half_angle_deg)])
        rows, motion = np.empty((len(scan.ranges), 4)), np.array([twist.vx, twist.vy, twist.wz, late])
        given = (scan.origins, scan.bearings, scan.half_angles, scan.time_offsets, scan.ranges)
        return rows[: beams.beam_points(*given, limits, motion, rows)]
