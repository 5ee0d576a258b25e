"""Map a 3D image to 2D with all steps of IPaBD (Hoang et al. 2013, II.B), and combine the maps of several sweeps."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from navloom_ipabd import lines, pressure, raster, track
from navloom_ipabd.raster import Cells, Extent, Lattice, RasterMethod
from navloom_ipabd.rules import Filters
from navloom_ipabd.segmentation import Segmentation, segment_starts
from navloom_ipabd.sweep import SweepImage
from navloom_ipabd.track import FrameMotion

__all__ = ["GridMap", "MapSettings", "Outline", "draw", "merge", "outline", "renew", "warm_up"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MapSettings:
    """How points become lines and lines become cells.

    Attributes:
        line_tolerance: T of the iterative end-point fit, m.
        resolution: Edge of a cell, m.
        anchor: Point that is the centre of a cell, m, map frame: the start position S.
        extent: Lowest x, y, highest x, y of the map, m, map frame; None: the area that was seen, and the anchor.
        free_range: Distance from the sensor beyond which no cell is marked free, m.
        raster, paper_t: See `raster.mark_occupied`.
        bin_width: Width of an azimuth bin, rad; None: the bearing step.
    """

    filters: Filters = field(default_factory=Filters)
    segmentation: Segmentation = field(default_factory=Segmentation)
    line_tolerance: float = 0.06
    resolution: float = 0.40
    anchor: tuple[float, float] = (0.0, 0.0)
    extent: Extent | None = None
    free_range: float = 20.0
    raster: RasterMethod = "distance"
    paper_t: float = 0.8
    bin_width: float | None = None


@dataclass(frozen=True, eq=False)
class Outline:
    """Outlines of the obstacles, as seen by one sweep.

    Attributes:
        segments: (n, 4) x1, y1, x2, y2, m, map frame.
        sensor: x, y of the sensor, m, and heading of base, rad, at the reference pose, map frame.
        barriers: The 2D image that the segments were extracted from.
    """

    segments: Floats
    sensor: tuple[float, float, float]
    barriers: pressure.Barriers


@dataclass(frozen=True, eq=False)
class GridMap:
    """A map: cells and the outlines in them.

    Attributes:
        lattice: Position and size of the grid.
        cells: (rows, columns) int8: 0 free, 100 occupied, -1 unknown; row 0 has the lowest y.
        segments: (n, 4) x1, y1, x2, y2, m, map frame.
    """

    lattice: Lattice
    cells: Cells
    segments: Floats


def outline(sweep: SweepImage, motion: FrameMotion, settings: MapSettings) -> Outline:
    """Steps 1 to 4: press the image, segment it into objects and fit their lines, in the map frame."""
    barriers = pressure.press(sweep, settings.filters, motion, settings.bin_width)
    columns = np.flatnonzero(np.isfinite(barriers.ranges))
    x, y, heading = motion.reference
    c, s = math.cos(heading), math.sin(heading)
    sensor_x = x + c * sweep.mount[0] - s * sweep.mount[1]
    sensor_y = y + s * sweep.mount[0] + c * sweep.mount[1]
    local = barriers.points[columns, :2]
    points = local @ np.array([[c, s], [-s, c]]) + (sensor_x, sensor_y)
    starts = segment_starts(points, barriers.ranges[columns], columns, barriers.bins.step, settings.segmentation)
    segments = lines.extract_lines(points, starts, settings.line_tolerance)
    return Outline(segments, (sensor_x, sensor_y, heading), barriers)


def draw(shown: Outline, settings: MapSettings) -> GridMap:
    """Map of one sweep: cells are occupied on a line, free where a ray passed, and unknown elsewhere."""
    seen = np.minimum(shown.barriers.seen, settings.free_range)
    extent = settings.extent or _extent_of(shown, seen, settings.anchor)
    lattice = Lattice.covering(extent, settings.resolution, settings.anchor)
    cells = lattice.unknown()
    raster.mark_seen(cells, lattice, shown.sensor, shown.barriers.bins, seen)
    raster.mark_occupied(cells, lattice, shown.segments, settings.raster, settings.paper_t)
    return GridMap(lattice, cells, shown.segments)


def merge(known: GridMap, new: GridMap, tolerance: float) -> GridMap:
    """Merge two maps with the same anchor and resolution. No observation is dropped."""
    lattice, old_cells, new_cells = _on_one_lattice(known, new)
    segments = lines.fresh_segments(known.segments, new.segments, tolerance)
    return GridMap(lattice, raster.merge_cells(old_cells, new_cells), segments)


def renew(known: GridMap, new: GridMap) -> GridMap:
    """The new map, completed by the known one where the new one is unknown. Both share anchor and resolution."""
    lattice, old_cells, new_cells = _on_one_lattice(known, new)
    kept = raster.parts_in_unknown(known.segments, new_cells, lattice)
    cells = np.where(new_cells == raster.UNKNOWN, old_cells, new_cells)
    return GridMap(lattice, cells, np.concatenate([kept, new.segments]))


def _on_one_lattice(known: GridMap, new: GridMap) -> tuple[Lattice, Cells, Cells]:
    pairs = zip(known.lattice.extent, new.lattice.extent, strict=True)
    low_x, low_y, high_x, high_y = (max(pair) if i > 1 else min(pair) for i, pair in enumerate(pairs))
    lattice = Lattice.covering((low_x, low_y, high_x, high_y), new.lattice.resolution, new.lattice.anchor)
    old_cells = raster.move_cells(known.cells, known.lattice, lattice)
    return lattice, old_cells, raster.move_cells(new.cells, new.lattice, lattice)


def _extent_of(shown: Outline, seen: Floats, anchor: tuple[float, float]) -> Extent:
    """Bounding box of the anchor, the sensor, all segments and the observed area, m, map frame."""
    angles = shown.barriers.bins.azimuths + shown.sensor[2]
    x = np.concatenate([[anchor[0], shown.sensor[0]], shown.segments[:, 0::2].ravel(),
                        shown.sensor[0] + seen * np.cos(angles)])  # fmt: skip
    y = np.concatenate([[anchor[1], shown.sensor[1]], shown.segments[:, 1::2].ravel(),
                        shown.sensor[1] + seen * np.sin(angles)])  # fmt: skip
    return float(x.min()), float(y.min()), float(x.max()), float(y.max())


def warm_up() -> None:
    """Compile every kernel of the package."""
    track.warm_up()
    pressure.warm_up()
    lines.warm_up()
    raster.warm_up()
