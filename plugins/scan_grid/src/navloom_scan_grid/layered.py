"""A known map with the obstacles that the sensors see, as a navloom mapper."""

from __future__ import annotations

import math

import numpy as np
from navloom import Context, InputError, Mapper, MapperInput, MapUpdate, OccupancyGrid, Params, RangeScan
from navloom.geometry.echoes import beam_ends
from navloom.geometry.frames import compose, inverse, transform
from navloom_ipabd.errors import DataError
from numpy.typing import NDArray
from pydantic import Field

from navloom_scan_grid import layer
from navloom_scan_grid.layer import LayerSettings, ObstacleLayer
from navloom_scan_grid.mapping import Beams, MapSettings

__all__ = ["Layered", "LayeredParams"]


class LayeredParams(Params):
    """Lengths in m, times in s."""

    max_range: float = Field(10.0, gt=0.0, le=1000.0, description="Readings are used up to this range, m.")
    wall_margin: float = Field(
        0.2, ge=0.0, le=2.0, description="An echo this near to a wall of the known map is that wall, m."
    )
    body_margin: float = Field(
        0.02, ge=0.0, le=1.0, description="An echo this near to the robot's footprint is the robot itself, m."
    )
    memory: float | None = Field(
        300.0,
        gt=0.0,
        description="How long an obstacle stays after it was last seen, s; none: until a sensor sees through it.",
    )
    publish_rate_hz: float = Field(
        1.0, gt=0.0, le=1000.0, description="Highest rate at which the map is published, Hz."
    )

    def settings(self) -> LayerSettings:
        """These parameters as settings of the pure module."""
        memory = math.inf if self.memory is None else self.memory
        return LayerSettings(MapSettings(max_range=self.max_range), self.wall_margin, memory)


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
        origin = self._known.origin
        self._map_to_grid = inverse([origin.x, origin.y, origin.heading])
        self._interval_ns = round(1e9 / params.publish_rate_hz)
        self.reset()

    def reset(self) -> None:
        start = transform(self._map_to_grid, (self.context.start.x, self.context.start.y)).tolist()
        known = self._known
        self._layer = ObstacleLayer(known.cells, known.resolution, (start[0], start[1]), self.params.settings())
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
        for scan, sensor in zip(given.scans, given.sensors, strict=True):
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
        kept = layer.outside(_ends(scan), self.context.robot.footprint, self.params.body_margin)
        beams = Beams(scan.stamp_ns, scan.origins[kept], scan.bearings[kept], scan.half_angles[kept],
                      scan.time_offsets[kept], scan.ranges[kept], scan.range_min, scan.range_max)  # fmt: skip
        self._layer.insert(sensor, beams, given.track.stamps_ns, compose(self._map_to_grid, given.track.poses))

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
