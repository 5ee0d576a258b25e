"""The any-angle shortest path of the robot's inscribed disc in the true world.

Worlds of boxes and cylinders: exact, by the tangent graph (see `tangents`). Worlds with a raster: Lazy Theta* on a
lattice of half a cell or finer chooses the side on which to pass each obstacle; the tangent graph of all corners along
that path then pulls it taut against the true squares of the cells. The result is the exact shortest path of its
neighbourhood. So its length is an upper bound of the optimum, and exceeds it only if the search chose a longer side.
"""

from __future__ import annotations

import math

import numpy as np
from navloom.geometry.frames import inverse, transform
from navloom.geometry.polylines import Polyline
from navloom.geometry.solids import centre_at, is_fixed, overlaps
from navloom.geometry.world import Box, Obstacle, Place, Raster, World
from numpy.typing import NDArray

from navloom_optimal.field_space import FieldSpace
from navloom_optimal.free_space import Shapes, Space
from navloom_optimal.lazy_tangents import TangentSearch
from navloom_optimal.lazy_theta import any_angle_path
from navloom_optimal.shape_space import ShapeSpace
from navloom_optimal.tangents import Circles, ShortestPath, shortest_among

__all__ = ["length_to_reach", "optimal_length", "optimal_path", "warm_up"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_MAX_NODES = 2_500_000
_MAX_HALVED = 5_000_000
_STEPS_PER_RADIUS = 4.0
_MARGIN_STEPS = 2.5
_ROUNDS = 6


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
    path = _on_raster(world.raster, _shapes(solid, origin, radius), transform(inverse(origin_to_map), ends))
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
    """Compile all kernels: run one search among shapes and one on a raster."""
    start, goal = Place(0.05, 0.05), Place(0.75, 0.35)
    shapes = (Box("box", (0.3, 0.4), (0.0, 0.3)),)
    cells = np.zeros((4, 8), dtype=np.bool_)
    cells[:2, 4] = True
    optimal_length(World("shapes", shapes), start, goal, 0.02, 1.0)
    optimal_length(World("raster", shapes, Raster("cells", cells, 0.1)), start, goal, 0.02, 1.0)


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


def _among_shapes(shapes: Shapes, ends: Floats) -> ShortestPath | None:
    space = ShapeSpace(shapes)
    if not space.points_free(ends).all():
        return None
    return _straight(space, ends) or TangentSearch(_joined(_points(ends), _shape_circles(shapes)), space).run()


def _straight(space: Space, ends: Floats) -> ShortestPath | None:
    """The straight line; None if it is not free."""
    if not space.segments_free(ends.reshape(1, 4))[0]:
        return None
    return ShortestPath(math.dist(ends[0], ends[1]), ends)


def _points(points: Floats) -> Circles:
    """Circles of radius 0."""
    count = len(points)
    places = np.concatenate([points, np.zeros((count, 1))], axis=1)
    return Circles(places, np.tile((0.0, 2.0 * np.pi), (count, 1)), np.full(count, -1, dtype=np.int64))


def _joined(*parts: Circles) -> Circles:
    return Circles(
        np.concatenate([p.places for p in parts]),
        np.concatenate([p.usable for p in parts]),
        np.concatenate([p.owners for p in parts]),
    )


def _shape_circles(shapes: Shapes) -> Circles:
    """A quarter circle around each corner of each box, and a circle around each cylinder."""
    boxes, discs, radius = shapes.boxes, shapes.discs, shapes.radius
    signs = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    local = boxes[:, None, 2:4] * signs
    cosine, sine = boxes[:, None, 4], boxes[:, None, 5]
    x = boxes[:, None, 0] + cosine * local[..., 0] - sine * local[..., 1]
    y = boxes[:, None, 1] + sine * local[..., 0] + cosine * local[..., 1]
    corners = np.stack([x, y, np.full_like(x, radius)], axis=-1).reshape(-1, 3)
    yaws = np.arctan2(boxes[:, 5], boxes[:, 4])
    first = (yaws[:, None] + np.array([1.0, 1.5, 0.0, 0.5]) * np.pi).reshape(-1)
    quarter = np.stack([first, np.full_like(first, 0.5 * np.pi)], axis=-1)
    whole = np.tile((0.0, 2.0 * np.pi), (len(discs), 1))
    places = np.concatenate([corners, discs + np.array((0.0, 0.0, radius))])
    owners = np.concatenate([np.repeat(np.arange(len(boxes)), 4), len(boxes) + np.arange(len(discs))])
    return Circles(places, np.concatenate([quarter, whole]), owners)


def _on_raster(raster: Raster, shapes: Shapes, ends: Floats) -> ShortestPath | None:
    """Shortest path on a raster, in the raster's frame."""
    space = _field_space(raster, shapes)
    if not space.points_free(ends).all():
        return None
    straight = _straight(space, ends)
    if straight is not None:
        return straight
    points = any_angle_path(space, ends[0], ends[1])
    return None if points is None else _pulled_taut(points, space, _cell_circles(raster, shapes.radius))


def _pulled_taut(points: Floats, space: FieldSpace, corners: Circles) -> ShortestPath:
    """Pull a path (n, 2), m, taut around the nearby obstacles, repeatedly until no new corner is near."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    best = ShortestPath(float(steps.sum()), points)
    kept = _joined(_points(points[[0, -1]]), _points(points[1:-1]), _shape_circles(space.shapes))
    # Pulling taut may merge two straight parts of the search's path, hardly ever more.
    longest = 2.0 * float(steps.max()) + 4.0 * max(space.shapes.radius, float(kept.places[:, 2].max()))
    near = np.zeros(len(corners), dtype=np.bool_)
    known = -1
    for _ in range(_ROUNDS):
        near |= _are_near(corners, best.points, space.shapes.radius + _MARGIN_STEPS * space.step, space.step)
        if near.sum() == known:
            break
        known = int(near.sum())
        best = shortest_among(_joined(kept, corners.chosen(near)), space, longest) or best
    return best


def _field_space(raster: Raster, shapes: Shapes) -> FieldSpace:
    """The raster's lattice, with each node's distance from the nearest obstacle.

    The point of a closed cell nearest to a lattice node is also a lattice node, so the distance transform is exact.
    An even number of steps in a cell puts nodes on the centre line of every gap. A map of more than `_MAX_HALVED` cells
    has one step in a cell, and gaps of an odd number of cells have no nodes on their centre line.
    """
    rows, cols = raster.occupied.shape
    wanted = 2 * math.ceil(0.5 * raster.resolution * _STEPS_PER_RADIUS / shapes.radius)
    affordable = 2 * int(0.5 * math.sqrt(_MAX_NODES / (rows * cols)))
    per_cell = max(2, min(wanted, affordable)) if rows * cols <= _MAX_HALVED else 1
    step = raster.resolution / per_cell
    clear, feature = _distances(raster.occupied, per_cell, step)
    x, y = np.arange(clear.shape[1]) * step, np.arange(clear.shape[0])[:, None] * step
    for cx, cy, hx, hy, cosine, sine in shapes.boxes:
        along = np.abs(cosine * (x - cx) + sine * (y - cy)) - hx
        across = np.abs(cosine * (y - cy) - sine * (x - cx)) - hy
        np.minimum(clear, np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0)), out=clear)
    for cx, cy, r in shapes.discs:
        np.minimum(clear, np.maximum(np.hypot(x - cx, y - cy) - r, 0.0), out=clear)
    return FieldSpace(np.array(raster.occupied, dtype=np.bool_, order="C"), per_cell, step, clear, feature, shapes)


def _distances(occupied: Bools, per_cell: int, step: float) -> tuple[Floats, NDArray[np.int32]]:
    """Distance of each lattice node from the occupied cells, m, and their node nearest to it; see `FieldSpace`."""
    from scipy.ndimage import distance_transform_edt

    fine = np.repeat(np.repeat(occupied, per_cell, axis=0), per_cell, axis=1)
    covered = np.zeros((fine.shape[0] + 1, fine.shape[1] + 1), dtype=np.bool_)
    for down in (slice(None, -1), slice(1, None)):
        for left in (slice(None, -1), slice(1, None)):
            covered[down, left] |= fine
    if not covered.any():
        return np.full(covered.shape, np.inf), np.full((2, *covered.shape), -1, dtype=np.int32)
    clear, feature = distance_transform_edt(~covered, sampling=step, return_indices=True)
    return clear, feature


def _cell_circles(raster: Raster, radius: float) -> Circles:
    """A quarter circle around each convex corner of the occupied cells."""
    padded = np.pad(raster.occupied, 1)
    places, firsts = [], []
    # A cell's corner towards (down, left) is convex if both cells beside that corner are free.
    for down, left, first in ((-1, -1, 1.0), (-1, 1, 1.5), (1, 1, 0.0), (1, -1, 0.5)):
        beside = np.roll(padded, -left, axis=1) | np.roll(padded, -down, axis=0)
        row, col = np.nonzero(padded & ~beside)
        x, y = col - 1 + (left > 0), row - 1 + (down > 0)
        places.append(np.stack([x, y], axis=-1) * raster.resolution)
        firsts.append(np.full(len(row), first * np.pi))
    centres, first_angles = np.concatenate(places), np.concatenate(firsts)
    count = len(centres)
    return Circles(
        np.concatenate([centres, np.full((count, 1), radius)], axis=1),
        np.stack([first_angles, np.full(count, 0.5 * np.pi)], axis=-1),
        np.full(count, -1, dtype=np.int64),
    )


def _are_near(circles: Circles, points: Floats, reach: float, step: float) -> Bools:
    """(n,) whether the circles' centres are within `reach`, m, of a path, which is sampled every `step`, m."""
    from scipy.spatial import KDTree

    line = Polyline(points)
    samples = line.at(np.linspace(0.0, line.length, 2 + int(line.length / step)))
    distances, _ = KDTree(samples).query(circles.places[:, :2], distance_upper_bound=reach)
    near: Bools = np.isfinite(distances)
    return near
