"""Ray casting against upright boxes, vertical cylinders, the floor plane z = 0 and one raster.

Boxes and cylinders are intersected by the slab method. Rays are handled in blocks that stay in the L1 cache; within a
block, the outer loop runs over obstacles and the inner one over rays. The raster is traversed cell by cell (Amanatides
& Woo 1987), with leaps over free space by its distance field. A ray that starts inside an obstacle hits it at range 0.
In the fan of a planar laser, each obstacle is intersected only with the beams that `sectors` does not rule out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_sensors_sim.sectors import beam_spans

__all__ = ["FLOOR", "NOTHING", "Obstacles", "cast_block", "cast_fan", "cast_rays", "to_map"]

Floats = NDArray[np.float64]

FLOOR = -1
"""Hit index of the floor."""
NOTHING = -2
"""Hit index of a ray that hits nothing."""

_BLOCK = 256
_OX, _OY, _OZ, _DX, _DY, _IX, _IY, _IZ, _BEST, _HIT = (k * _BLOCK for k in range(10))
_HUGE = 1e300
"""Value used for 1/0: finite, so that 0 * _HUGE is 0 and no slab becomes NaN."""
_ROUNDING = 1e-6
"""More than rounding shifts a hit, m."""
_LEAP = 3.0
"""Free distance above which a leap is faster than single steps, cells."""


class Obstacles(NamedTuple):
    """What rays and footprints can hit, in the map frame. Indices count the boxes, then the cylinders, then the raster.

    Attributes:
        boxes: (n, 9) centre x, y; half extents along the box's own axes; lowest and highest z, m; cos and sin of
            the yaw; 1 if present, else 0.
        cylinders: (m, 6) centre x, y; radius; lowest and highest z, m; 1 if present, else 0.
        gaps: (rows, cols) float32, distance from each cell's centre to that of the nearest occupied cell, in cells;
            0 in an occupied cell; row 0 is the lowest y. Shape (0, 0): no raster.
        raster: (7,) x, y of the lower left corner, m; cos and sin of the raster's heading; edge of a cell, lowest
            and highest z, m.
    """

    boxes: Floats
    cylinders: Floats
    gaps: NDArray[np.float32]
    raster: Floats


def cast_rays(
    origins: Floats, directions: Floats, obstacles: Obstacles, floor: bool = True, reach: float = math.inf
) -> tuple[Floats, NDArray[np.int64]]:
    """First hit of each ray.

    Args:
        origins: (n, 3) starting points, m, map frame.
        directions: (n, 3) unit vectors, map frame.
        obstacles: What can be hit.
        floor: Whether the plane z = 0 can be hit too.
        reach: Hits at this range or beyond are ignored, m.

    Returns:
        (n,) ranges, m, +inf for no hit, and (n,) index of the obstacle hit, FLOOR or NOTHING.
    """
    starts, ways = np.ascontiguousarray(origins.T), np.ascontiguousarray(directions.T)
    ranges, hits = np.empty(len(origins)), np.empty(len(origins), np.int64)
    cast_block(starts, ways, obstacles, floor, float(reach), ranges, hits)
    return ranges, hits


@njit(cache=True, nogil=True, error_model="numpy")
def to_map(x: float, y: float, heading: float, vectors: Floats, offset: bool | np.bool_, out: Floats) -> None:
    """Rotates (3, n) base-frame vectors into the map frame and, if `offset`, adds the robot's position."""
    c, s = math.cos(heading), math.sin(heading)
    x0, y0 = (x, y) if offset else (0.0, 0.0)
    for i in range(vectors.shape[1]):
        out[0, i] = x0 + c * vectors[0, i] - s * vectors[1, i]
        out[1, i] = y0 + s * vectors[0, i] + c * vectors[1, i]
        out[2, i] = vectors[2, i]


@njit(cache=True, nogil=True, error_model="numpy")
def cast_block(origins, directions, obstacles, floor, reach, ranges, hits):  # type: ignore[no-untyped-def]
    """`cast_rays` with (3, n) origins and directions, writing into (n,) `ranges` and `hits`."""
    count = origins.shape[1]
    work = np.empty(10 * _BLOCK)
    boxes, cylinders = obstacles.boxes, obstacles.cylinders
    for start in range(0, count, _BLOCK):
        size = min(_BLOCK, count - start)
        _load(work, origins, directions, start, size, floor, reach)
        # A plain 0 or False would be a literal, for which numba compiles the callees again.
        first = np.int64(0)
        x0, x1, y0, y1 = _spread(work, size, reach)
        for k in range(boxes.shape[0]):
            # Half a diagonal at most, whatever the yaw.
            radius = abs(boxes[k, 2]) + abs(boxes[k, 3])
            if boxes[k, 8] != 0.0 and _is_within(boxes[k, 0], boxes[k, 1], radius, x0, x1, y0, y1):
                _cut_box(work, first, size, boxes, k)
        for k in range(cylinders.shape[0]):
            radius = abs(cylinders[k, 2])
            if cylinders[k, 5] != 0.0 and _is_within(cylinders[k, 0], cylinders[k, 1], radius, x0, x1, y0, y1):
                _cut_cylinder(work, first, size, cylinders, k, float(boxes.shape[0] + k))
        _finish(work, start, size, obstacles, ranges, hits)


@njit(cache=True, nogil=True, error_model="numpy")
def cast_fan(origins, directions, first_bearing, step, obstacles, reach, ranges, hits):  # type: ignore[no-untyped-def]
    """Faster `cast_block` for the level beams of a planar laser, with the same result bit for bit.

    Each obstacle is intersected only with the beams that can hit it.

    Args:
        origins, directions: (3, n) level beams, map frame, from one place and evenly spaced counter-clockwise.
        first_bearing, step: Bearing of beam 0 and from each beam to the next, rad, map frame; step > 0, and all
            steps together are at most a turn.
        obstacles: What can be hit; the floor cannot.
        reach: Hits at this range or beyond are ignored, m.
        ranges, hits: (n,) filled: m, +inf for no hit, and the index of what was hit.
    """
    count = origins.shape[1]
    work = np.empty(10 * _BLOCK)
    boxes, cylinders = obstacles.boxes, obstacles.cylinders
    spans = np.empty((boxes.shape[0] + cylinders.shape[0], 4), np.int64)
    beam_spans(origins[:, 0], first_bearing, step, count, reach, obstacles, spans)
    # Of a large world, most obstacles are out of reach: they are looked at once, and not in each block.
    met, is_met = np.empty(spans.shape[0], np.int64), 0
    for k in range(spans.shape[0]):
        if spans[k, 0] < spans[k, 1] or spans[k, 2] < spans[k, 3]:
            met[is_met] = k
            is_met += 1
    for start in range(0, count, _BLOCK):
        size = min(_BLOCK, count - start)
        _load(work, origins, directions, start, size, np.bool_(False), reach)
        for k in met[:is_met]:
            for side in range(0, 4, 2):
                first, end = max(spans[k, side] - start, 0), min(spans[k, side + 1] - start, size)
                if first >= end:
                    continue
                if k < boxes.shape[0]:
                    _cut_box(work, first, end, boxes, k)
                else:
                    _cut_cylinder(work, first, end, cylinders, k - boxes.shape[0], float(k))
        _finish(work, start, size, obstacles, ranges, hits)


@njit(cache=True, nogil=True, error_model="numpy")
def _finish(work, start, size, obstacles, ranges, hits):  # type: ignore[no-untyped-def]
    """Intersects the block's rays with the raster, if there is one, and writes their ranges and hits."""
    if obstacles.gaps.size:
        index = float(obstacles.boxes.shape[0] + obstacles.cylinders.shape[0])
        for i in range(size):
            t = _raster_hit(work, i, obstacles.gaps, obstacles.raster)
            if t < work[_BEST + i]:
                work[_BEST + i] = t
                work[_HIT + i] = index
    for i in range(size):
        hits[start + i] = int(work[_HIT + i])
        ranges[start + i] = work[_BEST + i] if hits[start + i] != NOTHING else np.inf


@njit(cache=True, nogil=True, error_model="numpy")
def _load(work, origins, directions, start, size, floor, reach):  # type: ignore[no-untyped-def]
    """Fills the block's work space: one buffer with fixed offsets shows the compiler that its rows do not overlap."""
    for i in range(size):
        dx, dy, dz = directions[0, start + i], directions[1, start + i], directions[2, start + i]
        oz = origins[2, start + i]
        work[_OX + i], work[_OY + i], work[_OZ + i] = origins[0, start + i], origins[1, start + i], oz
        work[_DX + i], work[_DY + i] = dx, dy
        work[_IX + i] = 1.0 / dx if dx != 0.0 else _HUGE
        work[_IY + i] = 1.0 / dy if dy != 0.0 else _HUGE
        work[_IZ + i] = 1.0 / dz if dz != 0.0 else _HUGE
        on_floor = floor and dz < 0.0 and oz < -dz * reach
        work[_BEST + i] = oz / -dz if on_floor else reach
        work[_HIT + i] = FLOOR if on_floor else NOTHING


@njit(cache=True, nogil=True, error_model="numpy")
def _spread(work, size, reach):  # type: ignore[no-untyped-def]
    """Lowest and highest x, then y, that the block's rays reach, m: obstacles beyond change no hit."""
    x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
    for i in range(size):
        x0, x1 = min(x0, work[_OX + i]), max(x1, work[_OX + i])
        y0, y1 = min(y0, work[_OY + i]), max(y1, work[_OY + i])
    around = reach + _ROUNDING
    return x0 - around, x1 + around, y0 - around, y1 + around


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _is_within(x, y, radius, x0, x1, y0, y1):  # type: ignore[no-untyped-def]
    """Whether a disc may touch a rectangle."""
    return x + radius >= x0 and x - radius <= x1 and y + radius >= y0 and y - radius <= y1


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _slab(low, high, inverse):  # type: ignore[no-untyped-def]
    """Ray parameters at which a ray enters and leaves the slab from `low` to `high`, signed distances along an axis."""
    t0, t1 = low * inverse, high * inverse
    return (t0 if t0 < t1 else t1), (t1 if t0 < t1 else t0)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _keep_nearer(work, i, enter, leave, index):  # type: ignore[no-untyped-def]
    """Records an obstacle as the hit of ray i if the ray enters it nearer than all others so far."""
    enter = enter if enter > 0.0 else 0.0
    # `&` and not `and`: without a branch the loop vectorises.
    better = (enter <= leave) & (enter < work[_BEST + i])
    work[_BEST + i] = enter if better else work[_BEST + i]
    work[_HIT + i] = index if better else work[_HIT + i]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _cut_box(work, first, end, boxes, k):  # type: ignore[no-untyped-def]
    """Intersects rays `first` to `end` - 1 of the block with one box."""
    # Most boxes of worlds have no yaw, and need half of the arithmetic.
    if boxes[k, 7] == 0.0 and boxes[k, 6] == 1.0:
        _cut_straight_box(work, first, end, boxes, k)
    else:
        _cut_turned_box(work, first, end, boxes, k)


@njit(cache=True, nogil=True, error_model="numpy")
def _cut_straight_box(work, first, end, boxes, k):  # type: ignore[no-untyped-def]
    """Intersects rays `first` to `end` - 1 of the block with one box without yaw."""
    x0, x1 = boxes[k, 0] - boxes[k, 2], boxes[k, 0] + boxes[k, 2]
    y0, y1 = boxes[k, 1] - boxes[k, 3], boxes[k, 1] + boxes[k, 3]
    z0, z1 = boxes[k, 4], boxes[k, 5]
    index = float(k)
    for i in range(first, end):
        enter, leave = _slab(x0 - work[_OX + i], x1 - work[_OX + i], work[_IX + i])
        near, far = _slab(y0 - work[_OY + i], y1 - work[_OY + i], work[_IY + i])
        enter, leave = (near if near > enter else enter), (far if far < leave else leave)
        near, far = _slab(z0 - work[_OZ + i], z1 - work[_OZ + i], work[_IZ + i])
        enter, leave = (near if near > enter else enter), (far if far < leave else leave)
        _keep_nearer(work, i, enter, leave, index)


@njit(cache=True, nogil=True, error_model="numpy")
def _cut_turned_box(work, first, end, boxes, k):  # type: ignore[no-untyped-def]
    """Intersects rays `first` to `end` - 1 of the block with one box with yaw, in the frame of the box."""
    hx, hy, z0, z1, c, s = boxes[k, 2], boxes[k, 3], boxes[k, 4], boxes[k, 5], boxes[k, 6], boxes[k, 7]
    cx, cy = boxes[k, 0], boxes[k, 1]
    index = float(k)
    for i in range(first, end):
        px, py = work[_OX + i] - cx, work[_OY + i] - cy
        dx = c * work[_DX + i] + s * work[_DY + i]
        dy = c * work[_DY + i] - s * work[_DX + i]
        x, y = c * px + s * py, c * py - s * px
        enter, leave = _slab(-hx - x, hx - x, 1.0 / dx if dx != 0.0 else _HUGE)
        near, far = _slab(-hy - y, hy - y, 1.0 / dy if dy != 0.0 else _HUGE)
        enter, leave = (near if near > enter else enter), (far if far < leave else leave)
        near, far = _slab(z0 - work[_OZ + i], z1 - work[_OZ + i], work[_IZ + i])
        enter, leave = (near if near > enter else enter), (far if far < leave else leave)
        _keep_nearer(work, i, enter, leave, index)


@njit(cache=True, nogil=True, error_model="numpy")
def _cut_cylinder(work, first, end, cylinders, k, index):  # type: ignore[no-untyped-def]
    """Intersects rays `first` to `end` - 1 of the block with one cylinder and its end faces.

    The discriminant a r² - (o × d)² suffers no cancellation for distant origins, unlike b² - a c. A vertical ray gets
    a tiny a: its interval is then practically infinite inside the circle and empty outside.
    """
    cx, cy, radius, z0, z1 = cylinders[k, 0], cylinders[k, 1], cylinders[k, 2], cylinders[k, 3], cylinders[k, 4]
    for i in range(first, end):
        dx, dy = work[_DX + i], work[_DY + i]
        px, py = work[_OX + i] - cx, work[_OY + i] - cy
        a = dx * dx + dy * dy
        across = px * dy - py * dx
        c = px * px + py * py - radius * radius
        upright = a < 1e-30
        discriminant = -c if upright else a * radius * radius - across * across
        a = 1e-30 if upright else a
        root = math.sqrt(discriminant if discriminant > 0.0 else 0.0)
        middle = -(px * dx + py * dy)
        enter = (middle - root) / a
        leave = (middle + root) / a if discriminant >= 0.0 else -1.0
        near, far = _slab(z0 - work[_OZ + i], z1 - work[_OZ + i], work[_IZ + i])
        enter, leave = (near if near > enter else enter), (far if far < leave else leave)
        _keep_nearer(work, i, enter, leave, index)


@njit(cache=True, nogil=True, error_model="numpy")
def _raster_hit(work, i, gaps, raster):  # type: ignore[no-untyped-def]
    """Range at which ray i enters the column of an occupied cell, m; +inf if another hit is nearer or there is none."""
    c, s, cell = raster[2], raster[3], raster[4]
    px, py = work[_OX + i] - raster[0], work[_OY + i] - raster[1]
    x, y = (c * px + s * py) / cell, (c * py - s * px) / cell
    dx = (c * work[_DX + i] + s * work[_DY + i]) / cell
    dy = (c * work[_DY + i] - s * work[_DX + i]) / cell
    ix = 1.0 / dx if dx != 0.0 else _HUGE
    iy = 1.0 / dy if dy != 0.0 else _HUGE
    rows, cols = gaps.shape
    begin, end = _slab(-x, cols - x, ix)
    near, far = _slab(-y, rows - y, iy)
    begin, end = max(begin, near), min(end, far)
    near, far = _slab(raster[5] - work[_OZ + i], raster[6] - work[_OZ + i], work[_IZ + i])
    begin, end = max(begin, near, 0.0), min(end, far, work[_BEST + i])
    if begin > end:
        return np.inf
    return _walk(x, y, dx, dy, ix, iy, begin, end, gaps)


@njit(cache=True, nogil=True, error_model="numpy")
def _walk(x, y, dx, dy, ix, iy, t, end, gaps):  # type: ignore[no-untyped-def]
    """Ray parameter at the first occupied cell from t to `end`, +inf if there is none; x, y, dx, dy in cells.

    A leap ends at least 1.5 cells from the centre of any occupied cell.
    """
    rows, cols = gaps.shape
    step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    ahead_x, ahead_y = (1 if dx > 0.0 else 0), (1 if dy > 0.0 else 0)
    speed = math.sqrt(dx * dx + dy * dy)
    col, row = _cell_at(x + t * dx, cols), _cell_at(y + t * dy, rows)
    while True:
        gap = gaps[row, col]
        if gap == 0.0:
            return t
        if gap > _LEAP:
            # Gaps are between centres: half a diagonal at both ends, and a little for rounding.
            t += (gap - 1.5) / speed
            if not t < end:
                return np.inf
            col, row = _cell_at(x + t * dx, cols), _cell_at(y + t * dy, rows)
            continue
        next_x = (col + ahead_x - x) * ix if dx != 0.0 else np.inf
        next_y = (row + ahead_y - y) * iy if dy != 0.0 else np.inf
        if next_x < next_y:
            # After a leap, rounding may put the next border behind.
            t = max(t, next_x)
            col += step_x
        else:
            t = max(t, next_y)
            row += step_y
        if not t <= end or col < 0 or row < 0 or col >= cols or row >= rows:
            return np.inf


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _cell_at(coordinate, count):  # type: ignore[no-untyped-def]
    """Index of the cell that contains a coordinate, in cells; a point on the outer edge belongs to the outer cell."""
    return min(max(int(coordinate), 0), count - 1)
