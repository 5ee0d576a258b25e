"""Occupancy grids from importers, and rasterisation of worlds."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.frames import compose, inverse, transform
from navloom.geometry.solids import box_corners, is_fixed, overlaps
from navloom.geometry.world import Box, Cylinder, Interval, Place, Raster, World

__all__ = ["FREE", "MAX_CELLS", "OCCUPIED", "UNKNOWN", "GridMap", "world_to_grid"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
MAX_CELLS = 64_000_000
"""Largest map, in cells; larger ones are refused before memory is allocated."""

_TOUCH = 1e-9
"""Smallest overlap that marks a cell, m: a wall that ends on a cell's edge does not fill the next cell."""


@dataclass(frozen=True, eq=False)
class GridMap:
    """An occupancy grid.

    Attributes:
        cells: (rows, cols) int8: 0 free to 100 occupied, -1 unknown; row 0 has the lowest y, column 0 the lowest x.
        resolution: Edge of a cell, m.
        origin: Pose of the lower left corner of cell (0, 0) in the map frame.

    Raises:
        ValueError: The cells have another shape, type or value, or the resolution is not a positive length.
    """

    cells: NDArray[np.int8]
    resolution: float
    origin: Place = field(default_factory=lambda: Place(0.0, 0.0))

    def __post_init__(self) -> None:
        if self.cells.ndim != 2 or self.cells.dtype != np.int8 or not self.cells.size:
            raise ValueError(f"cells of {self.cells.dtype} {self.cells.shape}: expected int8 (rows, cols), not empty")
        if self.cells.min() < UNKNOWN or self.cells.max() > OCCUPIED:
            raise ValueError(f"cells of {self.cells.min()} to {self.cells.max()}: expected -1, or 0 to 100")
        if not (math.isfinite(self.resolution) and self.resolution > 0.0):
            raise ValueError(f"resolution = {self.resolution}: expected a length > 0 in metres")
        # The caller may go on writing into its array.
        cells = self.cells.copy() if self.cells.flags.writeable else self.cells
        cells.flags.writeable = False
        object.__setattr__(self, "cells", cells)


def world_to_grid(
    world: World,
    resolution: float,
    height_range: Interval,
    bounds: tuple[float, float, float, float] | None = None,
) -> GridMap:
    """Rasterise the obstacles of a world that exist from the start and never move.

    Every cell that an obstacle covers in any part is 100, all others are 0.

    Args:
        world: The ground truth.
        resolution: Edge of a cell, m.
        height_range: Lowest and highest height that counts, m: (0, height of the robot).
        bounds: Lowest x, lowest y, highest x, highest y, m, map frame; default: the world's. The grid covers them with
            whole cells from the lower left corner.

    Raises:
        ValueError: The resolution is not a positive length, the bounds have no area, or there are more than `MAX_CELLS`
            cells.
    """
    x0, y0, x1, y1 = world.bounds if bounds is None else bounds
    if not (math.isfinite(resolution) and resolution > 0.0):
        raise ValueError(f"resolution = {resolution}: expected a length > 0 in metres")
    if not (math.isfinite(x0 + y0 + x1 + y1) and x0 < x1 and y0 < y1):
        raise ValueError(f"bounds {(x0, y0, x1, y1)}: expected lowest x, lowest y, highest x, highest y in metres")
    # Less 1e-6: rounding must not add a row to bounds that are whole cells.
    wide, high = (x1 - x0) / resolution - 1e-6, (y1 - y0) / resolution - 1e-6
    if wide * high > MAX_CELLS:
        raise ValueError(f"{wide * high:.3g} cells of {resolution} m: expected at most {MAX_CELLS}; make cells larger")
    shape = (max(1, math.ceil(high)), max(1, math.ceil(wide)))
    occupied = np.zeros(shape, dtype=np.bool_)
    for obstacle in world.obstacles:
        if is_fixed(obstacle) and overlaps(obstacle.z, height_range):
            if isinstance(obstacle, Box):
                _draw_quads(occupied, ((box_corners(obstacle) - (x0, y0)) / resolution)[None], _TOUCH / resolution)
            else:
                _draw_disc(occupied, obstacle, (x0, y0), resolution)
    if world.raster is not None and overlaps(world.raster.z, height_range):
        _draw_raster(occupied, world.raster, Place(x0, y0), resolution)
    return GridMap(np.where(occupied, OCCUPIED, FREE).astype(np.int8), resolution, Place(x0, y0))


def _window(low: Floats, high: Floats, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """First and last + 1 row, then column, of the cells that (2,) extents x, y, in cells, may touch."""
    c0, r0 = np.clip(np.floor(low), 0, shape[::-1]).astype(np.int64).tolist()
    c1, r1 = np.clip(np.floor(high) + 1, 0, shape[::-1]).astype(np.int64).tolist()
    return r0, r1, c0, c1


def _draw_quads(occupied: Bools, quads: Floats, touch: float) -> None:
    """Mark the cells that rectangles (k, 4, 2), in cells, counter-clockwise, overlap by more than `touch`, in cells."""
    for quad in quads:
        r0, r1, c0, c1 = _window(quad.min(axis=0), quad.max(axis=0), occupied.shape)
        x, y = np.arange(c0, c1)[None, :] + 0.5, np.arange(r0, r1)[:, None] + 0.5
        hit = (x + 0.5 > quad[:, 0].min() + touch) & (x - 0.5 < quad[:, 0].max() - touch)
        hit = hit & (y + 0.5 > quad[:, 1].min() + touch) & (y - 0.5 < quad[:, 1].max() - touch)
        for corner, side in ((quad[0], quad[1] - quad[0]), (quad[0], quad[3] - quad[0])):
            length = math.hypot(side[0], side[1])
            axis = side / length
            # Half the width of a cell's projection on the axis.
            shadow = 0.5 * (abs(axis[0]) + abs(axis[1])) - touch
            along = (x - corner[0]) * axis[0] + (y - corner[1]) * axis[1]
            hit = hit & (along > -shadow) & (along < length + shadow)
        occupied[r0:r1, c0:c1] |= hit


def _draw_disc(occupied: Bools, disc: Cylinder, corner: tuple[float, float], resolution: float) -> None:
    """Mark the cells that a cylinder's disc overlaps; `corner`: lower left of the grid, m, map frame."""
    x, y = (disc.x - corner[0]) / resolution, (disc.y - corner[1]) / resolution
    radius = (disc.radius - _TOUCH) / resolution
    low, high = np.array((x - radius, y - radius)), np.array((x + radius, y + radius))
    r0, r1, c0, c1 = _window(low, high, occupied.shape)
    gap_x = np.maximum(np.abs(np.arange(c0, c1)[None, :] + 0.5 - x) - 0.5, 0.0)
    gap_y = np.maximum(np.abs(np.arange(r0, r1)[:, None] + 0.5 - y) - 0.5, 0.0)
    occupied[r0:r1, c0:c1] |= np.hypot(gap_x, gap_y) < radius


def _draw_raster(occupied: Bools, raster: Raster, corner: Place, resolution: float) -> None:
    """Mark the cells that a raster's occupied cells overlap; `corner`: lower left of the grid, map frame."""
    origin = np.array([raster.origin.x, raster.origin.y, raster.origin.heading])
    origin_to_grid = compose(inverse(np.array([corner.x, corner.y, 0.0])), origin)
    # The usual case, without a loop over the cells.
    if origin_to_grid[2] == 0.0:
        rows = _covered(occupied.shape[0], raster.occupied.shape[0], origin_to_grid[1], raster.resolution, resolution)
        cols = _covered(occupied.shape[1], raster.occupied.shape[1], origin_to_grid[0], raster.resolution, resolution)
        # Sums over rectangles of the raster from its running sums (an integral image).
        sums = np.zeros((raster.occupied.shape[0] + 1, raster.occupied.shape[1] + 1), dtype=np.int64)
        np.cumsum(np.cumsum(raster.occupied, axis=0, dtype=np.int64), axis=1, out=sums[1:, 1:])
        low, high = sums[rows[0]], sums[rows[1]]
        occupied |= high[:, cols[1]] - high[:, cols[0]] - low[:, cols[1]] + low[:, cols[0]] > 0
        return
    r, c = np.nonzero(raster.occupied)
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    corners = raster.resolution * (np.stack([c, r], axis=-1)[:, None] + square)
    quads = transform(origin_to_grid, corners.reshape(-1, 2)).reshape(-1, 4, 2) / resolution
    extent = (quads.max(axis=1) >= 0.0).all(axis=1) & (quads.min(axis=1) <= occupied.shape[::-1]).all(axis=1)
    _draw_quads(occupied, quads[extent], _TOUCH / resolution)


def _covered(
    count: int, source_count: int, offset: float, source_edge: float, edge: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last + 1 cell of a source axis, shifted by `offset` m, that each of `count` cells overlaps."""
    starts = edge * np.arange(count) - offset
    first = np.floor((starts + _TOUCH) / source_edge)
    last = np.ceil((starts + edge - _TOUCH) / source_edge)
    return (
        np.clip(first, 0, source_count).astype(np.int64),
        np.clip(last, 0, source_count).astype(np.int64),
    )
