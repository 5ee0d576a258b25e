"""Signed distance to the walls of a raster map, exact on a lattice of half cells.

A wall is the union of the closed squares of its cells. The point of a square nearest to a lattice node is a lattice
node itself (each coordinate is clamped to a multiple of half a cell), so a distance transform of the nodes is exact.
All nodes on a square's outline are 0, so bilinear interpolation is 0 on the whole outline, without a half-cell bias.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from hashlib import blake2b
from weakref import WeakValueDictionary

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

__all__ = ["DistanceField", "distance_field", "sample"]

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Place = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class DistanceField:
    """Signed distance to the nearest wall, on a lattice.

    Attributes:
        values: (2 rows + 1, 2 columns + 1) float32, m, at the corners, edges' middles and centres of the cells, row 0
            at the lowest y of the raster; negative inside walls; limited to ± the reach. Read-only.
        frame: (5,) x, y, m, of node (0, 0) in the map frame; cosine and sine of the raster's heading; spacing, m.
    """

    values: NDArray[np.float32]
    frame: Floats


_FIELDS: WeakValueDictionary[tuple[object, ...], DistanceField] = WeakValueDictionary()
"""Fields in use: robots of one process that match the same map share its field, 16 bytes a cell."""


def distance_field(occupied: Bools, resolution: float, origin: Place, reach: float) -> DistanceField:
    """Distance field of a raster; that of an equal raster as long as it is in use.

    Args:
        occupied: (rows, columns), row 0 has the lowest y.
        resolution: Edge of a cell, m.
        origin: x, y, m, and heading, rad, of the lower left corner of cell (0, 0), map frame.
        reach: Limit of the distances on both sides of a wall's outline, m.
    """
    content = blake2b(np.packbits(occupied).tobytes()).digest()
    key = (content, occupied.shape, resolution, origin, reach)
    if (known := _FIELDS.get(key)) is not None:
        return known
    field = _FIELDS[key] = _field(occupied, resolution, origin, reach)
    return field


def _field(occupied: Bools, resolution: float, origin: Place, reach: float) -> DistanceField:
    spacing = 0.5 * resolution
    outside, inside = _distances(occupied, spacing, reach), _distances(~occupied, spacing, reach)
    values = (outside - inside).astype(np.float32)
    values.flags.writeable = False
    x, y, heading = origin
    return DistanceField(values, np.array([x, y, math.cos(heading), math.sin(heading), spacing]))


def _distances(cells: Bools, spacing: float, reach: float) -> Floats:
    """Distance from each node to the closed squares of some cells, m, at most the reach."""
    rows, columns = cells.shape
    covered = np.zeros((2 * rows + 1, 2 * columns + 1), dtype=np.bool_)
    if not cells.any():
        return np.full(covered.shape, reach)
    for down in range(3):
        for across in range(3):
            # Each cell covers the nine nodes of its closed square.
            covered[down : down + 2 * rows : 2, across : across + 2 * columns : 2] |= cells
    distances: Floats = np.minimum(distance_transform_edt(~covered, sampling=spacing), reach)
    return distances


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def sample(values, frame, x, y):  # type: ignore[no-untyped-def]
    """Distance, m, and its gradient at a point x, y, m, both in the map frame, by bilinear interpolation.

    Args:
        values, frame: Attributes of a `DistanceField`.

    Returns:
        Distance, gradient along x, gradient along y, and whether the point is within the raster (else all are 0).
    """
    c, s, per_metre = frame[2], frame[3], 1.0 / frame[4]
    x, y = (x - frame[0]) * per_metre, (y - frame[1]) * per_metre
    u, v = c * x + s * y, c * y - s * x
    if not (0.0 <= u < values.shape[1] - 1.0 and 0.0 <= v < values.shape[0] - 1.0):
        return 0.0, 0.0, 0.0, False
    # Unsigned, so that numba leaves out the wrap of negative indices.
    column, row = np.uint64(u), np.uint64(v)
    a, b = u - np.float64(column), v - np.float64(row)
    right, above = column + np.uint64(1), row + np.uint64(1)
    corner, lower_right, upper_left = (
        float(values[row, column]),
        float(values[row, right]),
        float(values[above, column]),
    )
    along, across = lower_right - corner, upper_left - corner
    twist = float(values[above, right]) - lower_right - across
    distance = corner + a * along + b * (across + a * twist)
    along, across = (along + b * twist) * per_metre, (across + a * twist) * per_metre
    return distance, c * along - s * across, s * along + c * across, True
