"""A layer of seen obstacles over a known map: echoes that no known wall explains, marked, cleared and forgotten."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_scan_grid.grid import LogOddsGrid
from navloom_scan_grid.mapping import Beams, MapSettings, Placed, place
from navloom_scan_grid.mapping import warm_up as warm_up_mapping

__all__ = ["OCCUPIED_FROM", "LayerSettings", "ObstacleLayer", "ends_beyond", "near_walls", "outside", "warm_up"]

Bools = NDArray[np.bool_]
Cells = NDArray[np.int8]
Floats = NDArray[np.float64]

OCCUPIED_FROM = 50
"""Smallest occupancy of a wall on the known map, percent."""


@dataclass(frozen=True)
class LayerSettings:
    """Settings of the layer.

    Attributes:
        readings: How readings become log odds; `cell` and `extent` are replaced by those of the known map.
        wall_margin: An echo this near to a known wall is that wall, m.
        memory: How long an obstacle seen often stays after it was last seen, s; infinite: until seen through.
    """

    readings: MapSettings = field(default_factory=MapSettings)
    wall_margin: float = 0.2
    memory: float = math.inf


class ObstacleLayer:
    """Obstacles that are seen and are not on a known map. Its cells are those of the map.

    Args:
        known: (rows, columns) the known map.
        resolution: Edge of a cell, m.
        origin: x, y, m, and heading, rad, of the lower left corner of cell (0, 0) in the map frame.
        start: Start position of the robot, m, map frame.
        settings: Settings.
    """

    def __init__(
        self,
        known: Cells,
        resolution: float,
        origin: tuple[float, float, float],
        start: tuple[float, float],
        settings: LayerSettings,
    ) -> None:
        self.known, self.settings, self._origin = known, settings, origin
        x, y, _ = self._in_grid(np.array([[*start, 0.0]]))[0].tolist()
        self._readings = replace(settings.readings, cell=resolution, extent=(x, y, x, y))
        self._walls = near_walls(known >= OCCUPIED_FROM, settings.wall_margin / resolution)
        self._explained = self._readings.weights._replace(hit=0.0, cone_hit=0.0)
        established = self._readings.weights.highest / self._readings.occupied_from
        self._decay_time = settings.memory / math.log(established)
        self._recent: dict[str, Placed] = {}
        self.clear()

    def clear(self) -> None:
        """Forget every obstacle, except what the newest scan of each sensor shows."""
        self._grid = LogOddsGrid(self._readings.cell, self._readings.chunk, self._readings.extent)
        for placed in self._recent.values():
            self._add(placed)

    def insert(self, sensor: str, beams: Beams, stamps_ns: NDArray[np.int64], poses: Floats) -> None:
        """Add one scan of a sensor, with the track of poses that covers it; arguments as in `mapping.place`.

        Raises:
            DataError: The track does not cover the scan. The layer is unchanged.
        """
        if beams.ranges.size:
            self._recent[sensor] = place(beams, stamps_ns, self._in_grid(poses), self._readings)
            self._add(self._recent[sensor])

    def fade(self, duration: float) -> None:
        """Let a time pass, s: log odds decay towards 0, so that what is no longer seen is forgotten."""
        if duration > 0.0 and math.isfinite(self._decay_time):
            self._grid.odds *= np.float32(math.exp(-duration / self._decay_time))

    def cells(self) -> Cells:
        """(rows, columns) the known map with the obstacles of the layer as 100; a copy."""
        cells, bounds = self.known.copy(), self._grid.bounds
        rows, columns = cells.shape
        low, left = max(0, bounds.row), max(0, bounds.column)
        high, right = min(rows, bounds.row + bounds.rows), min(columns, bounds.column + bounds.columns)
        if low < high and left < right:
            seen = self._grid.odds[low - bounds.row : high - bounds.row, left - bounds.column : right - bounds.column]
            area = cells[low:high, left:right]
            area[(seen >= self._readings.occupied_from) & (area < OCCUPIED_FROM)] = 100
        return cells

    def _in_grid(self, poses: Floats) -> Floats:
        """(n, 3) poses of the map frame in the frame of the grid, which begins at the corner of cell (0, 0)."""
        x, y, heading = self._origin
        cosine, sine, moved = math.cos(heading), math.sin(heading), poses[:, :2] - (x, y)
        along, across = cosine * moved[:, 0] + sine * moved[:, 1], cosine * moved[:, 1] - sine * moved[:, 0]
        return np.stack([along, across, poses[:, 2] - heading], axis=1)

    def _add(self, placed: Placed) -> None:
        """Insert a placed scan: all readings clear, those that no known wall explains mark."""
        weights, reach = self._readings.weights, placed.limits[1]
        is_wall = _explained(placed.beams, self._walls, self._readings.cell, reach)
        self._grid.cover(placed.box)
        self._grid.insert(placed.beams[is_wall], placed.limits, self._explained)
        self._grid.insert(placed.beams[~is_wall], placed.limits, weights)


def near_walls(walls: Bools, reach: float) -> Bools:
    """(rows, columns) cells whose centre is within `reach` cells of a wall cell's centre."""
    grown, far = walls.copy(), math.floor(reach)
    rows, columns = walls.shape
    for down in range(-min(far, rows - 1), min(far, rows - 1) + 1):
        for right in range(-min(far, columns - 1), min(far, columns - 1) + 1):
            if 0 < down * down + right * right <= reach * reach:
                into = slice(max(0, down), rows + min(0, down)), slice(max(0, right), columns + min(0, right))
                of = slice(max(0, -down), rows + min(0, -down)), slice(max(0, -right), columns + min(0, -right))
                grown[into] |= walls[of]
    return grown


def ends_beyond(origins: Floats, ranges: Floats, radii: tuple[float, float], margin: float) -> bool:
    """Whether all beams end farther from the base than `outside` reaches; no for a base that is not within its body.

    Args:
        origins: (n, 2) m, base frame. ranges: (n,) m.
        radii: Of the largest disc about the base within the body, and of the smallest one about it, m.
        margin: See `outside`.
    """
    inner, outer = radii
    if not ranges.size or inner <= 0.0:
        return False
    # Sides that are moved outward by the margin lie within the body enlarged about the base by this factor.
    reach = outer * (1.0 + margin / inner)
    return bool(ranges.min() > reach + math.sqrt((origins * origins).sum(axis=1).max()) + 1e-6)


def outside(points: Floats, footprint: Floats, margin: float) -> Bools:
    """(n,) whether points are farther than a margin from the robot's own body.

    Args:
        points: (n, 2) m, base frame.
        footprint: (k, 2) corners of a convex polygon, m, base frame, counter-clockwise.
        margin: m.
    """
    edges = np.roll(footprint, -1, axis=0) - footprint
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.hypot(edges[:, 0], edges[:, 1])[:, None]
    distances = points @ outward.T - (footprint * outward).sum(axis=1)
    is_inside: Bools = (distances <= margin).all(axis=1)
    return ~is_inside


@njit(cache=True, nogil=True, error_model="numpy")
def _explained(placed, walls, cell, reach):  # type: ignore[no-untyped-def]
    """(n,) whether a known wall explains a reading: the wall is near the beam's echo, or near the arc of a cone's."""
    found = np.zeros(placed.shape[0], np.bool_)
    rows, columns = walls.shape
    for i in range(placed.shape[0]):
        x, y, cos_axis, sin_axis, reading, half_angle = placed[i]
        if reading > reach:
            continue
        steps = math.ceil(half_angle * reading / cell)
        for step in range(-steps, steps + 1):
            angle = half_angle * step / steps if steps > 0 else 0.0
            cos_a, sin_a = math.cos(angle), math.sin(angle)
            column = math.floor((x + reading * (cos_axis * cos_a - sin_axis * sin_a)) / cell)
            row = math.floor((y + reading * (sin_axis * cos_a + cos_axis * sin_a)) / cell)
            if 0 <= row < rows and 0 <= column < columns and walls[row, column]:
                found[i] = True
                break
    return found


def warm_up() -> None:
    """Compile every kernel of the layer."""
    warm_up_mapping()
    layer = ObstacleLayer(np.zeros((2, 2), np.int8), 0.5, (0.0, 0.0, 0.0), (0.0, 0.0), LayerSettings())
    beams = Beams(0, np.zeros((2, 2)), np.zeros(2), np.array([0.0, 0.1]), np.zeros(2), np.ones(2), 0.1, 2.0)
    layer.insert("laser", beams, np.zeros(1, np.int64), np.zeros((1, 3)))
