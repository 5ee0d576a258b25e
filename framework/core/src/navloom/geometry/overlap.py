"""Depth of a robot's outline in an obstacle: it complements the clearance, which is 0 in contact."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.frames import compose, inverse, transform
from navloom.geometry.solids import box_corners, centre_at
from navloom.geometry.world import Box, Place, Raster, World

__all__ = ["overlap_depth"]

Floats = NDArray[np.float64]


def overlap_depth(footprint: Floats, pose: Place, world: World, name: str, time: float = 0.0) -> float:
    """The shortest motion that would clear an outline of one obstacle, m; 0 if they do not overlap.

    Exact for boxes and cylinders. For a raster it is the depth in the deepest single cell, which is at most the motion
    that clears one cell: the depth in a wall of several cells is not known.

    Args:
        footprint: (n, 2) corners of a convex polygon, counter-clockwise, m, base frame.
        pose: Pose of the base, map frame.
        world: The ground truth.
        name: Name of the obstacle or raster; for an unknown name the depth is 0.
        time: Run time, s, for moving obstacles.
    """
    base_to_map = np.array([pose.x, pose.y, pose.heading])
    if world.raster is not None and world.raster.name == name:
        return max(_depth_in_raster(footprint, base_to_map, world.raster), 0.0)
    outline = transform(base_to_map, footprint)
    depths = []
    for obstacle in world.obstacles:
        if obstacle.name != name:
            continue
        if isinstance(obstacle, Box):
            depths.append(_depth_in_polygon(outline, box_corners(obstacle, time)))
        else:
            depths.append(obstacle.radius + _depth_of_point(outline, np.array(centre_at(obstacle, time))))
    return max([0.0, *depths])


def _depth_in_polygon(outline: Floats, other: Floats) -> float:
    """Overlap depth of two convex polygons, m; <= 0 if they are disjoint: the minimum over all edge normals."""
    return min(_least_along_normals(outline, other), _least_along_normals(other, outline))


def _least_along_normals(polygon: Floats, other: Floats) -> float:
    edges = np.roll(polygon, -1, axis=0) - polygon
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=-1) / np.hypot(edges[:, 0], edges[:, 1])[:, None]
    reach = (normals * polygon).sum(axis=1)
    return float((reach - (normals @ other.T).min(axis=1)).min())


def _depth_of_point(outline: Floats, point: Floats) -> float:
    """Depth of a point in a convex polygon, m; outside, minus its distance."""
    edges = np.roll(outline, -1, axis=0) - outline
    offsets = point - outline
    inside = (edges[:, 0] * offsets[:, 1] - edges[:, 1] * offsets[:, 0]) / np.hypot(edges[:, 0], edges[:, 1])
    if inside.min() >= 0.0:
        return float(inside.min())
    share = np.clip((offsets * edges).sum(axis=1) / (edges * edges).sum(axis=1), 0.0, 1.0)
    gaps = offsets - share[:, None] * edges
    return -float(np.hypot(gaps[:, 0], gaps[:, 1]).min())


def _depth_in_raster(footprint: Floats, base_to_map: Floats, raster: Raster) -> float:
    """Depth of an outline in the deepest occupied cell under it, m."""
    origin = np.array([raster.origin.x, raster.origin.y, raster.origin.heading])
    outline = transform(compose(inverse(origin), base_to_map), footprint)
    edge = raster.resolution
    low, high = np.floor(outline.min(axis=0) / edge), np.ceil(outline.max(axis=0) / edge)
    rows, cols = raster.occupied.shape
    c0, r0 = np.clip(low, 0, (cols, rows)).astype(int).tolist()
    c1, r1 = np.clip(high, 0, (cols, rows)).astype(int).tolist()
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    depths = [
        _depth_in_polygon(outline, edge * (square + (c0 + c, r0 + r)))
        for r, c in np.argwhere(raster.occupied[r0:r1, c0:c1]).tolist()
    ]
    return max(depths, default=-math.inf)
