"""The log-odds occupancy grid as a navloom mapper."""

from __future__ import annotations

import numpy as np
from navloom import Context, Count, InputError, Mapper, MapperInput, MapUpdate, OccupancyGrid, Pose2D, RangeScan
from navloom_ipabd.errors import DataError

from navloom_scan_grid import mapping
from navloom_scan_grid.mapping import COUNTS, Beams, ScanMap
from navloom_scan_grid.params import ScanGridParams

__all__ = ["ScanGrid"]


class ScanGrid(Mapper[ScanGridParams]):
    """Builds an occupancy grid from range scans (Moravec & Elfes 1985; Thrun et al. 2005, ch. 9)."""

    name = "scan_grid"
    accepts = (RangeScan,)

    def __init__(self, params: ScanGridParams, context: Context) -> None:
        super().__init__(params, context)
        self._settings = params.settings((context.start.x, context.start.y))
        self._interval_ns = round(1e9 / params.publish_rate_hz)
        self.reset()

    def reset(self) -> None:
        self._map = ScanMap(self._settings)
        self._published: OccupancyGrid | None = None
        self._due_ns: int | None = None
        self._newest_ns: int | None = None

    @classmethod
    def warm_up(cls) -> None:
        mapping.warm_up()

    def update(self, given: MapperInput) -> MapUpdate | None:
        if self._due_ns is not None and given.stamp_ns < self._due_ns - self._interval_ns:
            self._due_ns = self._newest_ns = None  # the run clock restarted
        if given.clear:
            self._forget(given)
        for scan in given.scans:
            try:
                self._insert(scan, given)
            except DataError as error:
                raise InputError(f"scan_grid: {error}") from error
        if given.clear or ((self._due_ns is None or given.stamp_ns >= self._due_ns) and self._newest_ns is not None):
            return self._update(given)
        return None

    def _forget(self, given: MapperInput) -> None:
        """Clear the whole map, or only the part near the robot.

        A false obstacle blocks the robot only if it is near, and walls learned elsewhere are worth keeping.
        """
        radius = self.params.clear_radius
        if radius is None or not len(given.track.poses):
            self.reset()
            return
        x, y, _ = given.track.poses[-1].tolist()
        self._map.grid.forget(x, y, radius)
        self._published = None

    def _insert(self, scan: RangeScan, given: MapperInput) -> None:
        beams = Beams(scan.stamp_ns, scan.origins, scan.bearings, scan.half_angles, scan.time_offsets, scan.ranges,
                      scan.range_min, scan.range_max)  # fmt: skip
        self._map.insert(beams, given.track.stamps_ns, given.track.poses)
        self._newest_ns = max(self._newest_ns or 0, beams.end_ns)

    def _update(self, given: MapperInput) -> MapUpdate | None:
        """The current map; None if it equals the one last published."""
        grid = OccupancyGrid(self._map.cells(), self._map.settings.cell, Pose2D(*self._map.grid.origin, 0.0))
        self._due_ns = given.stamp_ns + self._interval_ns
        before = self._published
        if before is not None and before.origin == grid.origin and np.array_equal(before.cells, grid.cells):
            return None
        self._published = grid
        counts = tuple(Count(name, self._map.counts[name]) for name in COUNTS)
        self._map.counts.clear()
        stamp_ns = given.stamp_ns if self._newest_ns is None else self._newest_ns
        return MapUpdate(stamp_ns, grid, np.empty((0, 4)), counts)
