"""Scan matching as a navloom localizer."""

from __future__ import annotations

import math

import numpy as np
from navloom import (
    Context,
    InputError,
    Localizer,
    LocalizerInput,
    OccupancyGrid,
    Odometry,
    Pose2D,
    PoseEstimate,
    RangeScan,
)
from numpy.typing import NDArray

from navloom_scan_localizer import beams, matching
from navloom_scan_localizer.field import DistanceField, distance_field
from navloom_scan_localizer.params import ScanMatchingParams
from navloom_scan_localizer.tracking import PoseTracker

__all__ = ["ScanMatching"]

_MAX_CELLS = 16_000_000
"""A larger map is refused: its field, with four nodes a cell, would need some gigabytes to be made."""


class ScanMatching(Localizer):
    """Corrects odometry by matching laser scans with the map of its context."""

    name = "scan_matching"
    accepts = (RangeScan,)
    needs_map = True
    Params = ScanMatchingParams

    def __init__(self, params: ScanMatchingParams, context: Context) -> None:
        super().__init__(params, context)
        self._field = self._field_of(params)
        self.reset()

    def reset(self) -> None:
        """Back to the start pose; odometry has to begin there too."""
        start = self.context.start
        place = np.array([start.x, start.y, start.heading])
        self._tracker, self._stamp_ns = PoseTracker(self.params.settings(), self._field, place), 0

    def configure(self, params: ScanMatchingParams) -> None:
        """Take new parameters and stay where it is."""
        self._field = self._field_of(params)
        self.params, self._tracker.settings, self._tracker.field = params, params.settings(), self._field

    @classmethod
    def warm_up(cls) -> None:
        beams.warm_up()
        matching.warm_up()

    def localize(self, given: LocalizerInput) -> PoseEstimate:
        odometry, tracker = given.odometry, self._tracker
        seen, time = odometry.pose, (odometry.stamp_ns - self._stamp_ns) / 1e9
        tracker.predict(np.array([seen.x, seen.y, seen.heading]), time)
        self._stamp_ns = odometry.stamp_ns
        points = [self._points(scan, odometry) for scan in given.scans if isinstance(scan, RangeScan)]
        if points:
            tracker.correct(np.concatenate(points))
        return PoseEstimate(odometry.stamp_ns, Pose2D(*tracker.pose.tolist()), odometry.twist, tracker.covariance)

    def _points(self, scan: RangeScan, odometry: Odometry) -> NDArray[np.float64]:
        p, twist, late = self.params, odometry.twist, (scan.stamp_ns - odometry.stamp_ns) / 1e9
        if abs(late) > p.max_age:
            return np.empty((0, 4))
        limits = np.array([scan.range_min, scan.range_max - p.limit_margin, math.radians(p.max_half_angle_deg)])
        rows, motion = np.empty((len(scan.ranges), 4)), np.array([twist.vx, twist.vy, twist.wz, late])
        given = (scan.origins, scan.bearings, scan.half_angles, scan.time_offsets, scan.ranges)
        return rows[: beams.beam_points(*given, limits, motion, rows)]

    def _field_of(self, params: ScanMatchingParams) -> DistanceField:
        grid: OccupancyGrid | None = self.context.map
        if grid is None:
            raise InputError('scan_matching: got no map, expected one; name it in [map], as in ref = "world"')
        if not 0 < grid.cells.size <= _MAX_CELLS or not grid.resolution > 0.0:
            given = f"a map of {grid.cells.shape} cells of {grid.resolution:g} m"
            raise InputError(f"scan_matching: got {given}, expected 1 to {_MAX_CELLS} cells of more than 0 m")
        walls = grid.cells >= params.occupied_from
        if params.unknown_is_wall:
            walls |= grid.cells < 0
        origin = (grid.origin.x, grid.origin.y, grid.origin.heading)
        return distance_field(walls, grid.resolution, origin, 2.0 * params.reach)
