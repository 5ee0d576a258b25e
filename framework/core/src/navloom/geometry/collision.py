"""Distance between a robot's outline and the true world, and depth in contact: exact, in plain numpy.

It is used to check start and goal before the first tick, and to verify faster kernels.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.frames import compose, inverse, transform
from navloom.geometry.solids import box_corners, centre_at, is_present, overlaps
from navloom.geometry.world import Box, Place, Raster, World

__all__ = ["clearance", "gaps_to_points", "overlap_depth", "unknown_remedy"]

Floats = NDArray[np.float64]

_FIRST_MARGIN = 1.0
"""First margin around the robot in which raster cells are searched, m; doubled until one is found."""


def clearance(
    footprint: Floats,
    pose: Place,
    world: World,
    *,
    height: float,
    time: float = 0.0,
    sweep_ended: bool = False,
) -> tuple[float, str | None]:
    """Distance between a robot and the nearest obstacle that reaches into its height, and that obstacle's name.

    Args:
        footprint: (n, 2) corners of a convex polygon, counter-clockwise, m, base frame.
        pose: Pose of the base, map frame.
        world: The ground truth.
        height: Height of the robot, m: obstacles that begin at this height or above do not count.
        time: Run time, s.
        sweep_ended: The first stop-and-scan sweep is over.

    Returns:
        The distance, m: exactly 0 where the two touch or overlap, and infinity in an empty world. The name of the
        nearest obstacle, the first in the world's order among equals, or None in an empty world.
    """
    base_to_map = np.array([pose.x, pose.y, pose.heading])
    outline = transform(base_to_map, footprint)
    best, nearest = math.inf, None
    for distance, name in _distances(outline, footprint, base_to_map, world, height, time, sweep_ended):
        if distance < best:
            best, nearest = distance, name
    return best, nearest


def unknown_remedy(footprint: Floats, pose: Place, world: World, height: float) -> str:
    """What to do about a pose in unknown cells of a map, or where no obstacle but these touches the robot; else empty.

    For the arguments see `clearance`.
    """
    raster = world.raster
    if raster is None or raster.unknown is None or clearance(footprint, pose, world, height=height)[0] > 0.0:
        return ""
    seen = replace(world, raster=replace(raster, occupied=raster.occupied & ~raster.unknown, unknown=None))
    is_inside, is_alone = _is_unknown(raster, pose), clearance(footprint, pose, seen, height=height)[0] > 0.0
    if not (is_inside or is_alone):
        return ""
    told = f"{raster.name} is unknown {'there' if is_inside else 'beside it'}, which counts as an obstacle"
    return told + (
        f"; {raster.name}?unknown=free leaves it free" if is_alone else ", and a known obstacle is beside it"
    )


def _is_unknown(raster: Raster, place: Place) -> bool:
    """Whether a place is in an unknown cell."""
    origin = np.array([raster.origin.x, raster.origin.y, raster.origin.heading])
    at = transform(inverse(origin), np.array([[place.x, place.y]]))[0] / raster.resolution
    col, row = np.floor(at).astype(np.int64).tolist()
    is_inside = 0 <= row < raster.occupied.shape[0] and 0 <= col < raster.occupied.shape[1]
    return raster.unknown is not None and is_inside and bool(raster.unknown[row, col])


def _distances(
    outline: Floats, footprint: Floats, base_to_map: Floats, world: World, height: float, time: float, sweep_ended: bool
) -> Iterator[tuple[float, str]]:
    tall = (0.0, height)
    there = [o for o in world.obstacles if overlaps(o.z, tall) and is_present(o, time, sweep_ended)]
    is_box = np.array([isinstance(o, Box) for o in there], dtype=np.bool_)
    distances = np.zeros(len(there))
    if is_box.any():
        corners = np.stack([box_corners(o, time) for o in there if isinstance(o, Box)])
        distances[is_box] = _to_quads(outline, corners)
    if not is_box.all():
        discs = [o for o in there if not isinstance(o, Box)]
        gaps = gaps_to_points(outline, np.array([centre_at(o, time) for o in discs])) - [o.radius for o in discs]
        distances[~is_box] = np.maximum(gaps, 0.0)
    yield from zip(distances.tolist(), (o.name for o in there), strict=True)
    if world.raster is not None and overlaps(world.raster.z, tall):
        yield _to_raster(footprint, base_to_map, world.raster), world.raster.name


def _to_quads(outline: Floats, quads: Floats) -> Floats:
    """Distances (k,) between a convex polygon (n, 2) and convex quadrilaterals (k, 4, 2), all counter-clockwise.

    Two convex polygons are disjoint exactly if an edge normal of one of them separates them; then the nearest pair of
    points includes a corner.
    """
    apart = _separated(np.broadcast_to(outline, (len(quads), *outline.shape)), quads) | _separated(
        quads, np.broadcast_to(outline, (len(quads), *outline.shape))
    )
    distances = np.zeros(len(quads))
    if apart.any():
        others = quads[apart]
        flat = others.reshape(-1, 2)
        starts, ends = flat, np.roll(others, -1, axis=1).reshape(-1, 2)
        outline_ends = np.roll(outline, -1, axis=0)
        to_their_edges = _point_segment(outline[None], starts[:, None], ends[:, None]).min(axis=1)
        to_our_edges = _point_segment(flat[:, None], outline[None], outline_ends[None]).min(axis=1)
        distances[apart] = np.minimum(to_their_edges, to_our_edges).reshape(-1, others.shape[1]).min(axis=1)
    return distances


def _separated(polygons: Floats, others: Floats) -> NDArray[np.bool_]:
    """(k,) whether an edge of `polygons` (k, n, 2) has all corners of `others` (k, m, 2) strictly on its outside."""
    edges = np.roll(polygons, -1, axis=1) - polygons
    offsets = others[:, None] - polygons[:, :, None]
    outside = edges[:, :, None, 1] * offsets[..., 0] - edges[:, :, None, 0] * offsets[..., 1]
    # Strictly: touching counts as contact.
    apart: NDArray[np.bool_] = np.any(np.all(outside > 0.0, axis=2), axis=1)
    return apart


def gaps_to_points(outline: Floats, points: Floats) -> Floats:
    """Distances between a convex polygon (n, 2), counter-clockwise, and points (k, 2): (k,), 0 inside."""
    ends = np.roll(outline, -1, axis=0)
    edges = ends - outline
    offsets = points[:, None] - outline[None]
    inside = (edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0] >= 0.0).all(axis=1)
    distances: Floats = _point_segment(points[:, None], outline[None], ends[None]).min(axis=1)
    return np.where(inside, 0.0, distances)


def _point_segment(points: Floats, starts: Floats, ends: Floats) -> Floats:
    """Distances of points (..., 2) from segments (..., 2), broadcast together."""
    along = ends - starts
    squared = (along * along).sum(axis=-1)
    # Two equal corners make a segment of no length.
    share = ((points - starts) * along).sum(axis=-1) / np.where(squared > 0.0, squared, 1.0)
    gap = points - starts - np.clip(share, 0.0, 1.0)[..., None] * along
    distances: Floats = np.hypot(gap[..., 0], gap[..., 1])
    return distances


def _to_raster(footprint: Floats, base_to_map: Floats, raster: Raster) -> float:
    """Distance between a footprint (n, 2), base frame, and the occupied cells of a raster, m."""
    origin_to_map = np.array([raster.origin.x, raster.origin.y, raster.origin.heading])
    outline = transform(compose(inverse(origin_to_map), base_to_map), footprint)
    rows, cols = raster.occupied.shape
    edge = raster.resolution
    margin = max(_FIRST_MARGIN, 2.0 * edge)
    while True:
        low = np.floor((outline.min(axis=0) - margin) / edge).astype(np.int64)
        high = np.ceil((outline.max(axis=0) + margin) / edge).astype(np.int64)
        c0, r0 = np.clip(low, 0, (cols, rows)).tolist()
        c1, r1 = np.clip(high, 0, (cols, rows)).tolist()
        r, c = np.nonzero(raster.occupied[r0:r1, c0:c1])
        best = math.inf
        if r.size:
            corners = edge * (np.stack([c + c0, r + r0], axis=-1)[:, None] + _SQUARE)
            best = float(_to_quads(outline, corners).min())
        # Every cell nearer than the margin was in the window.
        if best <= margin or ((low <= 0).all() and high[0] >= cols and high[1] >= rows):
            return best
        margin *= 2.0


_SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


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
