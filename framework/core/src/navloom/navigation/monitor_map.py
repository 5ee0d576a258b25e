"""Surfaces of the known map near a robot: a second limit of gate and hand-over, beside that of the scans.

Scans show a surface more exactly than a map does, which adds the localizer's error and that of the raster. A robot in
a door that is little wider than itself would stop for that error. So a mapped surface counts only where no echo shows
it: behind a laser of 270°, or where a laser sees through glass. Free cells of the map say nothing: what no sensor has
seen stays unseen.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom.messages import OccupancyGrid, Pose2D
from navloom.navigation.blocked_trajectory import OCCUPIED_FROM

__all__ = ["NO_SURFACES", "shown_aside", "surfaces_without_echo", "warm_up"]

Floats = NDArray[np.float64]

STEP = 0.025
"""Largest distance between two points of a surface, m: a square corner of a robot enters between them by half of it."""
DEPTH = 0.15
"""Largest distance, across a surface, of echoes that show it, m: a cell of 5 cm and an error of 10 cm of the pose."""
ALONG = 0.05
"""Largest distance, along a surface, of echoes that show a point of it, m: one cell, so that a wall whose front part
is seen still counts behind the last beam."""
ASTRAY = 0.1
"""Error of the pose, m."""
ENOUGH = 3
"""Number of echoes that show a point: a single one may be several centimetres too far."""
NO_SURFACES = np.empty((0, 2))


def surfaces_without_echo(grid: OccupancyGrid, base: Pose2D, reach: float, echoes: Floats) -> Floats:
    """Points of mapped surfaces within reach that no echo shows: (k, 2) m, base frame, at most STEP apart.

    A surface is an edge between an occupied cell and one that is not.

    Args:
        grid: The map. base: Pose of the robot in the map frame.
        reach: m, from the base.
        echoes: (n, 2) m, base frame.
    """
    if not grid.cells.size:
        return NO_SURFACES
    dx, dy = grid.origin.x - base.x, grid.origin.y - base.y
    cos, sin = math.cos(base.heading), math.sin(base.heading)
    frame = np.array([cos * dx + sin * dy, cos * dy - sin * dx, grid.origin.heading - base.heading, grid.resolution])
    # A copy: a kernel is compiled for each layout of an array, and a robot that drives must not wait for that.
    found: Floats = _surfaces(grid.cells, frame, reach, np.array(echoes, order="C"))
    return found


def shown_aside(surfaces: Floats, echoes: Floats, cell: float) -> NDArray[np.bool_]:
    """(k,) which points of surfaces (k, 2) have enough echoes (n, 2), m, about them, at most a cell and 10 cm away.

    They belong to an object that is seen, as the flanks of a post whose front a laser sees. Where the laser looks at
    them too, the object ends where its echoes end, and the raster is up to a cell wrong.
    """
    if not len(surfaces):
        return np.zeros(0, np.bool_)
    apart = np.hypot(surfaces[:, None, 0] - echoes[:, 0], surfaces[:, None, 1] - echoes[:, 1])
    shown: NDArray[np.bool_] = (apart <= cell + ASTRAY).sum(axis=1) >= ENOUGH
    return shown


@njit(cache=True, nogil=True, error_model="numpy")
def _surfaces(cells, frame, reach, echoes):  # type: ignore[no-untyped-def]
    """As above; `frame` is x, y, m, heading, rad, of the corner of cell (0, 0) in the base frame, and its edge, m."""
    rows, columns = cells.shape
    cos, sin, cell = math.cos(frame[2]), math.sin(frame[2]), frame[3]
    x, y = -(cos * frame[0] + sin * frame[1]) / cell, (sin * frame[0] - cos * frame[1]) / cell
    first_row, last_row = max(0, math.floor(y - reach / cell)), min(rows - 1, math.floor(y + reach / cell))
    first_column, last_column = max(0, math.floor(x - reach / cell)), min(columns - 1, math.floor(x + reach / cell))
    # Rounding must not add a point to cells of exactly a whole number of steps.
    parts = math.ceil(cell / STEP - 1e-9)
    found, count = np.empty((64, 2)), 0
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            if cells[row, column] < OCCUPIED_FROM:
                continue
            for side in range(4):  # right, upper, left, lower edge, each with the cell on its left
                out_x, out_y = (1, 0, -1, 0)[side], (0, 1, 0, -1)[side]
                # The inside of a wall is never touched first.
                if _is_occupied(cells, row + out_y, column + out_x):
                    continue
                normal_x, normal_y = cos * out_x - sin * out_y, sin * out_x + cos * out_y
                for part in range(parts):
                    along = part / parts - 0.5
                    u = (column + 0.5 + 0.5 * out_x - along * out_y) * cell
                    v = (row + 0.5 + 0.5 * out_y + along * out_x) * cell
                    px, py = frame[0] + cos * u - sin * v, frame[1] + sin * u + cos * v
                    if px * px + py * py > reach * reach or _is_shown(px, py, normal_x, normal_y, echoes):
                        continue
                    # Grown by hand, since a list of tuples is slow in a kernel.
                    if count == found.shape[0]:
                        more = np.empty((2 * count, 2))
                        # Row by row: to assign a whole array compiles numba's message for unequal shapes, 2.5 s.
                        for k in range(count):
                            more[k, 0], more[k, 1] = found[k, 0], found[k, 1]
                        found = more
                    found[count, 0], found[count, 1] = px, py
                    count += 1
    # A copy, so that the buffer of twice the size is freed.
    return found[:count].copy()


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _is_occupied(cells, row, column):  # type: ignore[no-untyped-def]
    # Negative indices would read the other side of the map.
    is_inside = 0 <= row < cells.shape[0] and 0 <= column < cells.shape[1]
    return is_inside and cells[row, column] >= OCCUPIED_FROM


@njit(cache=True, nogil=True, error_model="numpy")
def _is_shown(px, py, normal_x, normal_y, echoes):  # type: ignore[no-untyped-def]
    """Whether enough echoes lie before or behind a point of a surface."""
    count = 0
    for k in range(echoes.shape[0]):
        dx, dy = echoes[k, 0] - px, echoes[k, 1] - py
        if abs(dx * normal_x + dy * normal_y) <= DEPTH and abs(dy * normal_x - dx * normal_y) <= ALONG:
            count += 1
            if count == ENOUGH:
                return True
    return False


def warm_up() -> None:
    """Compile the kernels for the array types of messages."""
    grid = OccupancyGrid(np.full((2, 2), 100, np.int8), 0.1, Pose2D(0.0, 0.0, 0.0))
    surfaces_without_echo(grid, Pose2D(0.0, 0.0, 0.0), 1.0, NO_SURFACES)
