"""Common parts of the schemes of raster maps."""

from __future__ import annotations

import math

import numpy as np

from navloom.geometry.frames import transform
from navloom.geometry.world import Interval, Raster
from navloom.worlds.world_errors import WorldError

__all__ = ["length_of", "raster_bounds", "wall_height"]


def length_of(reference: str, key: str, text: str) -> float:
    """The length of an option in a reference, m.

    Raises:
        WorldError: It is not a length from 0.001 to 1000 m.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    # Negated, so that NaN is refused too.
    if not 1e-3 <= value <= 1e3:
        raise WorldError(f"{reference}: {key}={text}: expected a length from 0.001 to 1000 in metres")
    return value


def wall_height(reference: str, text: str) -> Interval:
    """Height interval of a map's walls, m, from the text of an option.

    Raises:
        WorldError: It is not a length.
    """
    return 0.0, length_of(reference, "height", text)


def raster_bounds(raster: Raster) -> tuple[float, float, float, float]:
    """Lowest x, lowest y, highest x, highest y of a raster, m, map frame."""
    rows, cols = raster.occupied.shape
    origin = raster.origin
    corners = np.array([(0, 0), (cols, 0), (cols, rows), (0, rows)]) * raster.resolution
    turned = transform((origin.x, origin.y, origin.heading), corners)
    (x0, y0), (x1, y1) = turned.min(axis=0).tolist(), turned.max(axis=0).tolist()
    return x0, y0, x1, y1
