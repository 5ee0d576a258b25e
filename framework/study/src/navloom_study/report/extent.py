"""Which part of a world a picture shows: the tracks, and what stands near them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from navloom.geometry.frames import transform
from navloom.geometry.solids import box_corners
from navloom.geometry.world import Box, World
from numpy.typing import NDArray

__all__ = ["extent_of"]

Floats = NDArray[np.float64]
NEAR = 6.0
"""Distance within which obstacles round the tracks are shown, m: the walls of a corridor, but not all of a hall."""
EDGE = 0.3
"""Room beyond an obstacle, m."""


def extent_of(points: Floats, world: World | None, around: float) -> tuple[float, float, float, float]:
    """Lowest x, lowest y, highest x, highest y, m, map frame.

    Args:
        points: (n, 2) what the picture is of, m.
        world: The true world; None if it is not known.
        around: Margin around the points, m.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    # A wall is cut to its part near the points, so that a long one does not shrink them to a dot.
    first, last = low - NEAR, high + NEAR
    low, high = low - around, high + around
    for lows, highs in () if world is None else _standing(world):
        begin, end = np.maximum(lows, first), np.minimum(highs, last)
        is_near = (begin <= end).all(axis=1)
        if is_near.any():
            low = np.minimum(low, begin[is_near].min(axis=0) - EDGE)
            high = np.maximum(high, end[is_near].max(axis=0) + EDGE)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _standing(world: World) -> Iterator[tuple[Floats, Floats]]:
    """Lower and upper corners, (n, 2) each, m, of the boxes around obstacles, their ways, and occupied cells."""
    for obstacle in world.obstacles:
        if isinstance(obstacle, Box):
            corners = box_corners(obstacle)
        else:
            middle = np.array(obstacle.waypoints[0][1:] if obstacle.waypoints else obstacle.centre)
            corners = np.array([middle - obstacle.radius, middle + obstacle.radius])
        if obstacle.waypoints:
            corners = np.concatenate([corners, np.array(obstacle.waypoints)[:, 1:]])
        yield corners.min(axis=0)[None], corners.max(axis=0)[None]
    for actor in world.actors:
        places, radius = np.array(actor.places), actor.body.radius
        yield places.min(axis=0)[None] - radius, places.max(axis=0)[None] + radius
    if world.raster is not None:
        raster = world.raster
        motion = np.array([raster.origin.x, raster.origin.y, raster.origin.heading])
        middles = transform(motion, (np.argwhere(raster.occupied)[:, ::-1] + 0.5) * raster.resolution)
        half = 0.5 * raster.resolution
        yield middles - half, middles + half
