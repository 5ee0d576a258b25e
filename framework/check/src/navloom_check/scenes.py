"""Small worlds, and what range sensors see of them: enough for a unit test, without a simulator."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from navloom.config.tables import MapTable
from navloom.geometry.frames import inverse, transform
from navloom.geometry.grid import world_to_grid
from navloom.geometry.solids import centre_at, is_present
from navloom.geometry.world import Box, Cylinder, Obstacle, Place, Raster, World
from navloom.messages import OccupancyGrid, Pose2D
from numpy.typing import NDArray

__all__ = ["box", "cast", "closed", "corridor", "door", "grid", "open_floor", "room", "wall_ahead"]

Floats = NDArray[np.float64]
THICK = 0.2
"""Thickness of a wall, m."""
HEIGHT = (0.0, 2.4)
TOUCH = 1e-15
"""Distance at which a ray along a face of an obstacle touches it, m."""
RESOLUTION = MapTable().resolution
"""Edge of a cell of a map, m."""


def open_floor() -> World:
    """A floor without obstacles."""
    return World("open floor", bounds=(-5.0, -5.0, 15.0, 5.0))


def wall_ahead(distance: float = 1.0, width: float = 10.0) -> World:
    """A wall across the x axis, its face at a distance from the origin, m."""
    wall = Box("wall", (distance, distance + THICK), (-0.5 * width, 0.5 * width), HEIGHT)
    return World("wall ahead", (wall,), bounds=(-5.0, -5.0, 15.0, 5.0))


def corridor(width: float = 2.0, length: float = 14.0) -> World:
    """Two walls along the x axis that begin 2 m behind the origin; width and length in m."""
    half = 0.5 * width
    walls = (
        Box("left wall", (-2.0, length - 2.0), (half, half + THICK), HEIGHT),
        Box("right wall", (-2.0, length - 2.0), (-half - THICK, -half), HEIGHT),
    )
    return World("corridor", walls, bounds=(-3.0, -5.0, length, 5.0))


def closed(distance: float = 0.8) -> World:
    """Four walls round the origin, their faces at this distance, m: there is no way out."""
    far = distance + THICK
    walls = (
        Box("front wall", (distance, far), (-far, far), HEIGHT),
        Box("rear wall", (-far, -distance), (-far, far), HEIGHT),
        Box("left wall", (-far, far), (distance, far), HEIGHT),
        Box("right wall", (-far, far), (-far, -distance), HEIGHT),
    )
    return World("closed", walls, bounds=(-5.0, -5.0, 15.0, 5.0))


def door(width: float = 1.2, distance: float = 2.0, y: float = 0.0) -> World:
    """A wall across the x axis at a distance, with a door whose middle is at y; all in m."""
    half = 0.5 * width
    walls = (
        Box("wall left of the door", (distance, distance + THICK), (y + half, 5.0), HEIGHT),
        Box("wall right of the door", (distance, distance + THICK), (-5.0, y - half), HEIGHT),
    )
    return World("door", walls, bounds=(-5.0, -5.0, 15.0, 5.0))


def box(x: float = 2.0, y: float = 0.0, size: float = 0.4) -> World:
    """One upright box; its centre and side in m."""
    half = 0.5 * size
    return World(
        "box", (Box("box", (x - half, x + half), (y - half, y + half), HEIGHT),), bounds=(-5.0, -5.0, 15.0, 5.0)
    )


def room(length: float = 10.0, width: float = 6.0) -> World:
    """A room that begins 2 m behind the origin, with a pillar and a cupboard, so that no two views are alike; in m."""
    left, right, half = -2.0, length - 2.0, 0.5 * width
    solids: tuple[Obstacle, ...] = (
        Box("front wall", (right, right + THICK), (-half, half), HEIGHT),
        Box("rear wall", (left - THICK, left), (-half, half), HEIGHT),
        Box("left wall", (left, right), (half, half + THICK), HEIGHT),
        Box("right wall", (left, right), (-half - THICK, -half), HEIGHT),
        Box("cupboard", (0.4 * length, 0.4 * length + 0.8), (half - 0.6, half), HEIGHT),
        Cylinder("pillar", 0.3 * length, -0.25 * width, 0.3, HEIGHT),
    )
    return World("room", solids, bounds=(left - 0.5, -half - 0.5, right + 0.5, half + 0.5))


def grid(world: World, resolution: float = RESOLUTION, height: float = 0.6) -> OccupancyGrid:
    """A world as a raster map for a robot of this height; edge of a cell and height in m."""
    drawn = world_to_grid(world, resolution, (0.0, height))
    origin: Place = drawn.origin
    return OccupancyGrid(drawn.cells, drawn.resolution, Pose2D(origin.x, origin.y, origin.heading))


def cast(world: World, origins: Floats, ways: Floats, *, floor: bool = False, time: float = 0.0) -> Floats:
    """Distance along rays to the obstacles of a world at a run time.

    Args:
        world: Its boxes and cylinders, moving ones too, and its raster; not what appears after a sweep.
        origins: (n, 3) where each ray starts, m, map frame, z above the floor.
        ways: (n, 3) unit directions, map frame.
        floor: The floor at z = 0 counts too.
        time: Run time, s, at which obstacles have appeared and moved.

    Returns:
        (n,) m; +inf where a ray meets nothing.
    """
    there = [solid for solid in world.obstacles if is_present(solid, time, False)]
    boxes = [solid for solid in there if isinstance(solid, Box)]
    discs = [solid for solid in there if not isinstance(solid, Box)]
    best = np.full(len(ways), math.inf)
    steep = _no_zeros(ways)
    for solids, spans in ((boxes, _box_spans), (discs, _disc_spans)):
        if solids:
            enter, leave = spans(solids, np.array([centre_at(solid, time) for solid in solids]), origins, steep)
            meets = (enter <= leave) & (leave > 2.0 * TOUCH)
            best = np.minimum(best, np.where(meets, np.maximum(enter, 0.0), math.inf).min(axis=0))
    if world.raster is not None:
        best = np.minimum(best, _to_raster(world.raster, origins, ways))
    if floor:
        with np.errstate(divide="ignore", invalid="ignore"):
            down = np.where(ways[:, 2] < 0.0, -origins[:, 2] / ways[:, 2], math.inf)
        best = np.minimum(best, down)
    return best


def _no_zeros(ways: Floats) -> Floats:
    """Directions that meet every plane: those along a plane meet it so far away that another plane decides."""
    return np.where(ways == 0.0, 1e-300, ways)


def _slab(low: Floats, high: Floats, start: Floats, way: Floats) -> tuple[Floats, Floats]:
    """Where rays enter and leave the space between two planes, which is closed; no component of a way is 0."""
    one, other = (low - start - TOUCH) / way, (high - start + TOUCH) / way
    return np.minimum(one, other), np.maximum(one, other)


def _box_spans(solids: Sequence[Any], centres: Floats, origins: Floats, ways: Floats) -> tuple[Floats, Floats]:
    """(k, n) where n rays enter and leave k boxes with these centres (k, 2)."""
    cos, sin = (function([[solid.yaw] for solid in solids]) for function in (np.cos, np.sin))
    x, y = origins[:, 0] - centres[:, :1], origins[:, 1] - centres[:, 1:]
    half = 0.5 * np.array([(solid.x[1] - solid.x[0], solid.y[1] - solid.y[0]) for solid in solids])
    along = _no_zeros(cos * ways[:, 0] + sin * ways[:, 1])
    across = _no_zeros(cos * ways[:, 1] - sin * ways[:, 0])
    low, high = _slab(*_heights(solids), origins[:, 2], ways[:, 2])
    near_x, far_x = _slab(-half[:, :1], half[:, :1], cos * x + sin * y, along)
    near_y, far_y = _slab(-half[:, 1:], half[:, 1:], cos * y - sin * x, across)
    return np.maximum(np.maximum(near_x, near_y), low), np.minimum(np.minimum(far_x, far_y), high)


def _disc_spans(solids: Sequence[Any], centres: Floats, origins: Floats, ways: Floats) -> tuple[Floats, Floats]:
    """(k, n) where n rays enter and leave k cylinders with these centres (k, 2)."""
    x, y = origins[:, 0] - centres[:, :1], origins[:, 1] - centres[:, 1:]
    a = ways[:, 0] ** 2 + ways[:, 1] ** 2
    b = x * ways[:, 0] + y * ways[:, 1]
    root = b**2 - a * (x**2 + y**2 - np.array([[solid.radius**2] for solid in solids]))
    meets = (root >= 0.0) & (a > 0.0)
    a = np.where(a > 0.0, a, 1.0)
    half = np.sqrt(np.maximum(root, 0.0)) / a
    low, high = _slab(*_heights(solids), origins[:, 2], ways[:, 2])
    enter, leave = np.where(meets, -b / a - half, math.inf), np.where(meets, half - b / a, -math.inf)
    return np.maximum(low, enter), np.minimum(high, leave)


def _heights(solids: Sequence[Any]) -> tuple[Floats, Floats]:
    low, high = np.array([solid.z for solid in solids]).T[:, :, None]
    return low, high


def _to_raster(raster: Raster, origins: Floats, ways: Floats) -> Floats:
    """Distance along rays to the occupied cells of a raster, m: from cell to cell (Amanatides and Woo 1987)."""
    to_raster = inverse(np.array([raster.origin.x, raster.origin.y, raster.origin.heading]))
    starts = transform(to_raster, origins[:, :2]) / raster.resolution
    turned = transform(np.array([0.0, 0.0, to_raster[2]]), ways[:, :2]) / raster.resolution
    rows, columns = raster.occupied.shape
    steep, zero = _no_zeros(turned), np.zeros(1)
    spans = [_slab(zero, zero + n, starts[:, k], steep[:, k]) for k, n in enumerate((columns, rows))]
    low, high = _slab(zero + raster.z[0], zero + raster.z[1], origins[:, 2], _no_zeros(ways)[:, 2])
    at = np.maximum.reduce([spans[0][0], spans[1][0], low, np.zeros(len(ways))])
    end = np.minimum.reduce([spans[0][1], spans[1][1], high])
    found = np.full(len(ways), math.inf)
    live = np.flatnonzero(at <= end)
    # A little into the cell that begins here, so that rounding does not put the ray into the one before.
    cells = np.floor(starts + (np.where(np.isfinite(at), at, 0.0) + 1e-9)[:, None] * turned)
    step = np.sign(turned)
    while len(live):
        column, row = cells[live].astype(int).T
        is_inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        live, row, column = live[is_inside], row[is_inside], column[is_inside]
        is_hit = raster.occupied[row, column]
        found[live[is_hit]] = at[live[is_hit]]
        live = live[~is_hit]
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = (cells[live] + (step[live] > 0.0) - starts[live]) / turned[live]
        crossing[turned[live] == 0.0] = math.inf
        axis = crossing.argmin(axis=1)
        at[live] = crossing[np.arange(len(live)), axis]
        cells[live, axis] += step[live, axis]
        live = live[at[live] <= end[live]]
    return found
