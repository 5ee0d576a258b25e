"""The walls of a world as line obstacles, for actors that give way."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.frames import transform
from navloom.geometry.solids import box_corners, overlaps
from navloom.geometry.world import Box, Raster, World

__all__ = ["walls_of"]

Floats = NDArray[np.float64]
_CORNERS = 8
"""Corners of the polygon about a cylinder."""
_TALL = (0.0, 1.8)
"""Heights at which a walking person meets things, m."""


def walls_of(world: World) -> Floats:
    """(k, 4) ends x, y, x, y, m, map frame, of the outlines of what stands from the start in the way of people."""
    lines = [np.zeros((0, 4))]
    for obstacle in world.obstacles:
        if obstacle.waypoints or not overlaps(obstacle.z, _TALL):
            continue
        if isinstance(obstacle, Box):
            corners = box_corners(obstacle)
        else:
            turns = math.tau * (np.arange(_CORNERS) + 0.5) / _CORNERS
            reach = obstacle.radius / math.cos(math.pi / _CORNERS)
            corners = reach * np.column_stack([np.cos(turns), np.sin(turns)]) + obstacle.centre
        lines.append(np.column_stack([corners, np.roll(corners, -1, axis=0)]))
    if world.raster is not None and overlaps(world.raster.z, _TALL):
        lines.append(_rims(world.raster))
    return np.concatenate(lines)


def _rims(raster: Raster) -> Floats:
    """(k, 4) the rims between occupied and other cells, each straight piece as one line."""
    padded = np.pad(raster.occupied, 1)
    ends = []
    for across in (padded, padded.T):
        rim = across[1:] != across[:-1]
        # Where a run of rim cells begins and ends in each row.
        steps = np.diff(np.pad(rim.astype(np.int8), ((0, 0), (1, 1))), axis=1)
        (rows, begins), (_, stops) = np.nonzero(steps == 1), np.nonzero(steps == -1)
        pieces = np.column_stack([begins - 1, rows, stops - 1, rows]).astype(np.float64)
        ends.append(pieces if across is padded else pieces[:, [1, 0, 3, 2]])
    cells = np.concatenate(ends).reshape(-1, 2) * raster.resolution
    origin = np.array([raster.origin.x, raster.origin.y, raster.origin.heading])
    lines: Floats = transform(origin, cells).reshape(-1, 4)
    return lines
