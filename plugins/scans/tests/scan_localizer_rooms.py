"""Rooms for scan matching, and an independent ray caster that meets the squares of cells exactly."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


def room(rows=60, columns=60, thickness=1):
    """A raster with walls on its rim: (rows, columns), all else free."""
    occupied = np.ones((rows, columns), dtype=np.bool_)
    occupied[thickness:-thickness, thickness:-thickness] = False
    return occupied


def ranges_in(occupied, cell, place, bearings, range_max=30.0):
    """Distance to the first occupied square from a pose in the raster's frame along (k,) bearings, m; +inf is none."""
    x, y, heading = place
    return _cast(occupied, x / cell, y / cell, heading + np.asarray(bearings), range_max / cell) * cell


@njit
def _cast(occupied, x, y, angles, reach):
    """Ranges in cells, from square to square along each ray (Amanatides & Woo 1987)."""
    ranges = np.full(len(angles), np.inf)
    for i, angle in enumerate(angles):
        dx, dy = math.cos(angle), math.sin(angle)
        column, row, at = int(x), int(y), 0.0
        step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        to_x = (column + (dx > 0.0) - x) / dx if dx != 0.0 else np.inf
        to_y = (row + (dy > 0.0) - y) / dy if dy != 0.0 else np.inf
        while at < reach and 0 <= row < occupied.shape[0] and 0 <= column < occupied.shape[1]:
            if occupied[row, column]:
                ranges[i] = at
                break
            if to_x < to_y:
                at, to_x, column = to_x, to_x + abs(1.0 / dx), column + step_x
            else:
                at, to_y, row = to_y, to_y + abs(1.0 / dy), row + step_y
    return ranges


def flat():
    """Two rooms of a flat of 8 m x 6 m, cells of 0.1 m, with a door and three cupboards; all else free."""
    walls = np.ones((60, 80), dtype=np.bool_)
    walls[1:-1, 1:-1] = False
    walls[:, 45] = True
    walls[20:29, 45] = False
    walls[1:12, 1:9] = True
    walls[40:43, 15:20] = True
    walls[50:54, 60:72] = True
    return walls


def fan(beams=181, degrees=270.0):
    """(beams,) bearings, rad, base frame."""
    return np.radians(np.linspace(-0.5 * degrees, 0.5 * degrees, beams))


def beams_of(ranges, bearings):
    """(n, 4) end point, m, and direction of the beams with an echo, base frame, for a laser at the base."""
    echo = np.isfinite(ranges)
    ways = np.column_stack((np.cos(bearings), np.sin(bearings)))[echo]
    return np.hstack((ranges[echo, None] * ways, ways))


def turned(place, origin):
    """A pose given in the raster's frame, in the map frame in which the raster has this origin."""
    x, y, heading = origin
    c, s = math.cos(heading), math.sin(heading)
    px, py, ph = place
    return np.array([x + c * px - s * py, y + s * px + c * py, math.remainder(ph + heading, math.tau)])
