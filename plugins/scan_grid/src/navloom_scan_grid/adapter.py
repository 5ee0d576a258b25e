"""The log-odds occupancy grid, alone and over a known map, as navloom mappers."""

from __future__ import annotations

import numpy as np
from navloom import Context, Count, InputError, Mapper, MapperInput, MapUpdate, OccupancyGrid, Pose2D, RangeScan
from navloom.geometry.echoes import beam_ends
from navloom.geometry.footprints import circumscribed_radius, inscribed_radius
from navloom_ipabd.errors import DataError
from numpy.typing import NDArray

from navloom_scan_grid import layer, mapping
from navloom_scan_grid.layer import ObstacleLayer
from navloom_scan_grid.mapping import COUNTS, Beams, ScanMap
from navloom_scan_grid.params import LayeredParams, ScanGridParams

__all__ = ["Layered", "ScanGrid"]


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


class Layered(Mapper[LayeredParams]):
    """Publishes the known map with the obstacles that range scans show and no known wall explains."""

    name = "layered"
    accepts = (RangeScan,)
    needs_map = True

    def __init__(self, params: LayeredParams, context: Context) -> None:
        super().__init__(params, context)
        if context.map is None:
            raise ValueError('layered: got no map, expected one; name it in [map], as in ref = "world"')
        self._known: OccupancyGrid = context.map
        footprint = context.robot.footprint
        self._radii = inscribed_radius(footprint), circumscribed_radius(footprint)
        self._interval_ns = round(1e9 / params.publish_rate_hz)
        self.reset()

    def reset(self) -> None:
        known, start = self._known, self.context.start
        origin = (known.origin.x, known.origin.y, known.origin.heading)
        self._layer = ObstacleLayer(known.cells, known.resolution, origin, (start.x, start.y), self.params.settings())
        self._published: OccupancyGrid | None = None
        self._looked_ns: int | None = None

    @classmethod
    def warm_up(cls) -> None:
        layer.warm_up()

    def known(self) -> OccupancyGrid:
        return self._known

    def update(self, given: MapperInput) -> MapUpdate | None:
        if self._looked_ns is not None and given.stamp_ns < self._looked_ns:
            self._looked_ns = None  # the run clock restarted
        scans = given.scans if given.is_tracking else ()  # at a wrong pose, walls would be marked in doors
        for scan, sensor in zip(scans, given.sensors or ("",) * len(given.scans), strict=False):
            try:
                self._insert(scan, sensor, given)
            except DataError as error:
                raise InputError(f"layered: {error}") from error
        if given.clear:
            self._layer.clear()
        elif self._looked_ns is not None and given.stamp_ns < self._looked_ns + self._interval_ns:
            return None
        if self._looked_ns is not None:
            self._layer.fade(1e-9 * (given.stamp_ns - self._looked_ns))
        self._looked_ns = given.stamp_ns
        return self._update(given)

    def _insert(self, scan: RangeScan, sensor: str, given: MapperInput) -> None:
        footprint, margin = self.context.robot.footprint, self.params.body_margin
        kept: NDArray[np.bool_] | slice = slice(None)
        # The usual case is that no beam ends near the robot, and needs no look at each.
        if not layer.ends_beyond(scan.origins, scan.ranges, self._radii, margin):
            kept = layer.outside(_ends(scan), footprint, margin)
        beams = Beams(scan.stamp_ns, scan.origins[kept], scan.bearings[kept], scan.half_angles[kept],
                      np.array(scan.time_offsets[kept]), scan.ranges[kept], scan.range_min, scan.range_max)  # fmt: skip
        self._layer.insert(sensor, beams, given.track.stamps_ns, given.track.poses)

    def _update(self, given: MapperInput) -> MapUpdate | None:
        """The current map; None if it equals the one last published and no clear request asks for it."""
        cells, before = self._layer.cells(), self._published
        if before is not None and not given.clear and np.array_equal(before.cells, cells):
            return None
        cells.flags.writeable = False
        self._published = OccupancyGrid(cells, self._known.resolution, self._known.origin)
        return MapUpdate(given.stamp_ns, self._published, np.empty((0, 4)), ())


def _ends(scan: RangeScan) -> NDArray[np.float64]:
    """(n, 2) ends of a scan's beams, m, base frame; far away for no echo."""
    return beam_ends(scan.origins, scan.bearings, np.minimum(scan.ranges, 1e6))
