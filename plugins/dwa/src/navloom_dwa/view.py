"""The scores of one tick by direction, for the diagnostics."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
TURN = 2.0 * np.pi
PIXEL = 0.1  # m: side of a cell of points_picture()
OCCUPIED = 15


def arc_directions(arcs: Floats) -> Floats:
    """(m,) bearing, rad, base frame, of the point on each arc after 1 m of u: half the turn up to that point."""
    return np.clip(0.5 * arcs[:, 1], -np.pi, np.pi)


def cost_by_direction(directions: Floats, costs: Floats, sectors: int) -> Floats:
    """Least cost of the arcs that lead into each sector, scaled: 0 for the best, 1 for the worst or for no free arc.

    Args:
        directions: (m,), rad, map frame. costs: (m, n), +inf where not admissible. sectors: Number in a full turn.

    Returns:
        (sectors,), 0 .. 1.
    """
    histogram = np.ones(sectors)
    best = costs.min(axis=1)
    free = np.isfinite(best)
    if free.any():
        low, high = best[free].min(), costs[np.isfinite(costs)].max()
        share = (best[free] - low) / (high - low) if high > low else np.zeros(int(free.sum()))
        sector = np.floor(directions[free] % TURN * sectors / TURN).astype(np.int64) % sectors
        np.minimum.at(histogram, sector, share)
    return histogram


def free_directions(directions: Floats, costs: Floats) -> Floats:
    """(k, 2) first and last direction, rad in [-pi, pi), of each run of neighbouring arcs with an admissible speed."""
    free = np.concatenate(([False], np.isfinite(costs).any(axis=1), [False]))
    edges = np.flatnonzero(free[1:] != free[:-1]).reshape(-1, 2)
    ends = np.column_stack((directions[edges[:, 0]], directions[edges[:, 1] - 1]))
    return (ends + np.pi) % TURN - np.pi


def occupied_picture(distance: NDArray[np.int32]) -> NDArray[np.uint8]:
    """(rows, cols) 15 where a cell of the field holds an obstacle, else 0."""
    picture = np.zeros(distance.shape, np.uint8)
    picture[distance == 0] = OCCUPIED
    return picture


def in_map(points: Floats, pose: tuple[float, float, float]) -> Floats:
    """(..., 2) points of the base frame in the map frame, m. pose: x, y, m, heading, rad, of the base."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = points[..., 0], points[..., 1]
    return np.stack([pose[0] + c * x - s * y, pose[1] + s * x + c * y], axis=-1)


def points_picture(
    obstacles: NDArray[np.float64], pose: tuple[float, float, float], reach: float
) -> tuple[NDArray[np.uint8], float, float, float]:
    """Picture of the obstacles around the robot.

    Args:
        obstacles: (n, >= 2) x, y, m, base frame. pose: x, y, m, heading, rad, map frame. reach: Half width, m.

    Returns:
        (rows, cols) 15 in cells with an obstacle, else 0; side of a cell, m; lower left corner x, y, m, map frame.
    """
    size = round(2.0 * reach / PIXEL)
    x, y = in_map(obstacles[:, :2], pose).T
    left, low = math.floor(pose[0] / PIXEL) - size // 2, math.floor(pose[1] / PIXEL) - size // 2
    columns, rows = np.floor(x / PIXEL).astype(np.int64) - left, np.floor(y / PIXEL).astype(np.int64) - low
    is_inside = (rows >= 0) & (rows < size) & (columns >= 0) & (columns < size)
    cells = np.zeros((size, size), np.uint8)
    cells[rows[is_inside], columns[is_inside]] = OCCUPIED
    return cells, PIXEL, left * PIXEL, low * PIXEL
