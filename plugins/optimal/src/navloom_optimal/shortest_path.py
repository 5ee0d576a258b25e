"""The any-angle shortest path of the robot's inscribed disc in the true world: exact, by the tangent graph.

The occupied cells of a raster are boxes too: rows of cells, merged with equal rows beside them.
"""

from __future__ import annotations

import math

import numpy as np
from navloom.geometry.frames import inverse, transform
from navloom.geometry.solids import centre_at, is_fixed, overlaps
from navloom.geometry.world import Box, Obstacle, Place, Raster, World
from numpy.typing import NDArray

from navloom_optimal.buckets import buckets_of, segment_is_free
from navloom_optimal.circles import ShortestPath, circles_of
from navloom_optimal.shapes import TOLERANCE, Shapes
from navloom_optimal.tangent_search import TangentSearch

__all__ = ["length_to_reach", "optimal_length", "optimal_path", "warm_up"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def optimal_length(world: World, start: Place, goal: Place, radius: float, height: float) -> float | None:
    """Length of the shortest path of a disc, m, or None if there is none.

    Args:
        world: The true world; only static obstacles that are present from the start count.
        start, goal: Positions in the map frame; headings are not used.
        radius: Radius of the disc, m, > 0; touching an obstacle is allowed.
        height: Height of the robot, m; obstacles at or above it do not count.

    Raises:
        ValueError: The radius is not a length.
    """
    path = optimal_path(world, start, goal, radius, height)
    return None if path is None else path.length


def optimal_path(world: World, start: Place, goal: Place, radius: float, height: float) -> ShortestPath | None:
    """The shortest path itself, in the map frame. For arguments and errors see `optimal_length`.

    Boxes and cylinders are in an open plane, whatever the world's bounds; a path does not leave a raster.
    """
    if not (math.isfinite(radius) and radius > 0.0):
        raise ValueError(f"radius = {radius}: expected a length > 0 in metres")
    solid = [o for o in world.obstacles if is_fixed(o) and overlaps(o.z, (0.0, height))]
    ends = np.array([(start.x, start.y), (goal.x, goal.y)])
    if world.raster is None or not overlaps(world.raster.z, (0.0, height)):
        return _among_shapes(_shapes(solid, Place(0.0, 0.0), radius), ends)
    origin = world.raster.origin
    origin_to_map = np.array([origin.x, origin.y, origin.heading])
    ends = transform(inverse(origin_to_map), ends)
    if (ends < -TOLERANCE).any() or (ends > _size(world.raster) + TOLERANCE).any():
        return None
    path = _among_shapes(_with_cells(_shapes(solid, origin, radius), world.raster), ends)
    return None if path is None else ShortestPath(path.length, transform(origin_to_map, path.points))


def length_to_reach(path: ShortestPath, reach: float) -> float:
    """Length of a shortest path up to the point where it first comes within a distance of its end, m.

    If the disc of that radius around the end is free, this is the length of the shortest path to the disc.

    Args:
        path: The path.
        reach: Distance from its end, m, >= 0.
    """
    end, points = path.points[-1], path.points
    within = np.hypot(*(points - end).T) <= reach
    first = int(np.argmax(within))
    if first == 0:
        return 0.0
    outside, inside = points[first - 1], points[first]
    # Where the segment enters the disc: |inside + t (outside - inside) - end| = reach with 0 <= t <= 1.
    along, off = outside - inside, inside - end
    a, b, c = float(along @ along), float(along @ off), float(off @ off) - reach**2
    t = (-b + math.sqrt(max(b * b - a * c, 0.0))) / a
    steps = np.hypot(*np.diff(points[first:], axis=0).T)
    return max(path.length - t * math.sqrt(a) - float(steps.sum()), 0.0)


def warm_up() -> None:
    """Compile all kernels: run one search."""
    shapes = (Box("box", (0.3, 0.4), (0.0, 0.3)),)
    optimal_length(World("shapes", shapes), Place(0.05, 0.05), Place(0.75, 0.35), 0.02, 1.0)


def _shapes(obstacles: list[Obstacle], origin: Place, radius: float) -> Shapes:
    """Obstacles, transformed to the frame of an origin."""
    origin_to_map = np.array([origin.x, origin.y, origin.heading])
    boxes, discs = [], []
    for obstacle in obstacles:
        x, y = transform(inverse(origin_to_map), centre_at(obstacle, 0.0)).tolist()
        if isinstance(obstacle, Box):
            half = 0.5 * (obstacle.x[1] - obstacle.x[0]), 0.5 * (obstacle.y[1] - obstacle.y[0])
            yaw = obstacle.yaw - origin.heading
            boxes.append((x, y, *half, math.cos(yaw), math.sin(yaw)))
        else:
            discs.append((x, y, obstacle.radius))
    return Shapes(np.array(boxes).reshape(-1, 6), np.array(discs).reshape(-1, 3), radius)


def _with_cells(shapes: Shapes, raster: Raster) -> Shapes:
    """Shapes in a raster's frame, with boxes for its occupied cells and round it, so that the centre stays on it."""
    left, right, low, high = raster.resolution * _rectangles(raster.occupied)
    far, r = raster.resolution + shapes.radius, shapes.radius
    width, height = _size(raster)
    left = np.append(left, (-far, width + r, -far, -far))
    right = np.append(right, (-r, width + far, width + far, width + far))
    low = np.append(low, (-far, -far, -far, height + r))
    high = np.append(high, (height + far, height + far, -r, height + far))
    half_x, half_y, flat = 0.5 * (right - left), 0.5 * (high - low), np.zeros_like(left)
    cells = np.stack([left + half_x, low + half_y, half_x, half_y, flat + 1.0, flat], axis=-1)
    return Shapes(np.concatenate([shapes.boxes, cells]), shapes.discs, r)


def _size(raster: Raster) -> Floats:
    """(2,) width and height of a raster, m."""
    size: Floats = raster.resolution * np.array(raster.occupied.shape[::-1])
    return size


def _rectangles(occupied: Bools) -> NDArray[np.int64]:
    """(4, n) first column, last + 1, first row, last + 1 of rectangles that cover the occupied cells once."""
    steps = np.diff(np.pad(occupied, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (rows, left), right = np.nonzero(steps == 1), np.nonzero(steps == -1)[1]
    order = np.lexsort((rows, right, left))
    rows, left, right = rows[order], left[order], right[order]
    begins = (np.diff(left, prepend=-1) != 0) | (np.diff(right, prepend=-1) != 0) | (np.diff(rows, prepend=-1) != 1)
    first = np.flatnonzero(begins)
    heights = np.diff(np.append(first, len(rows)))
    return np.stack([left[first], right[first], rows[first], rows[first] + heights])


def _among_shapes(shapes: Shapes, ends: Floats) -> ShortestPath | None:
    buckets = buckets_of(shapes)
    (ax, ay), (bx, by) = ends.tolist()
    if not (segment_is_free(ax, ay, ax, ay, buckets) and segment_is_free(bx, by, bx, by, buckets)):
        return None
    if segment_is_free(ax, ay, bx, by, buckets):
        return ShortestPath(math.hypot(bx - ax, by - ay), ends)
    return TangentSearch(circles_of(shapes, ends), buckets).run()
