"""Whether a convex footprint is clear of the occupied cells of a grid, at a pose and along a move.

Lengths are in cells and places in columns and rows: cell (r, c) covers c..c+1 by r..r+1. The distance field answers
where the circumscribed disc is free or the inscribed one is not. Between the two, the footprint itself is drawn: a
convex polygon meets a cell exactly if the part of it within the cell's row reaches the cell's columns. Along a move,
poses are tested so densely that no point of the footprint moves further than twice `SWEEP` between two of them, and
the footprint is grown by `SWEEP`. So a move that is called free has no contact, and one is refused only within `SWEEP`
of a contact, at sharp corners of the outline within twice that.
"""

from __future__ import annotations

import math

import numpy as np
from navloom_astar.inflation import circumscribed_radius, inscribed_radius
from numpy.typing import NDArray
from scipy import ndimage

from navloom_hybrid_astar.compiled import compiled

__all__ = [
    "SWEEP",
    "Body",
    "Ground",
    "advanced",
    "body_of",
    "ground_of",
    "is_free",
    "is_free_along",
    "surely_hits",
    "touched",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ground = tuple[NDArray[np.float32], NDArray[np.int32]]
"""(rows, columns) distance from the centre of a cell to that of the nearest occupied one, cells; (rows, columns + 1)
number of occupied cells in the row before a column."""
Body = tuple[Floats, Floats, float, float, float]
"""(n, 2) corners of the grown outline, base frame; (2, rows) work array; radii of the inscribed disc of the footprint
with its margin and of the circumscribed disc of the grown outline; step of the sweep, all in cells."""

SWEEP = 0.2
"""Growth of the outline for the motion between two tested poses, cells."""
_SQUARE = math.sqrt(0.5)
"""Half a cell's diagonal, cells."""
_NOTHING = 1e6
"""Distance on a grid without an occupied cell, cells."""


def ground_of(occupied: Bools) -> Ground:
    """The occupied cells of a grid, (rows, columns), prepared for tests."""
    rows, columns = occupied.shape
    if occupied.any():
        distance = ndimage.distance_transform_edt(~occupied).astype(np.float32)
    else:
        distance = np.full(occupied.shape, _NOTHING, dtype=np.float32)
    before = np.zeros((rows, columns + 1), dtype=np.int32)
    np.cumsum(occupied, axis=1, out=before[:, 1:])
    return distance, before


def body_of(footprint: Floats, margin: float, resolution: float) -> Body:
    """A footprint, grown by a margin on all sides.

    Args:
        footprint: (n, 2) corners, convex, counter-clockwise, m, base frame.
        margin: m.
        resolution: Edge of a cell, m.
    """
    corners = grown(footprint, margin + SWEEP * resolution) / resolution
    around = circumscribed_radius(corners)
    work = np.empty((2, 2 * math.ceil(around) + 4))
    return corners, work, (inscribed_radius(footprint) + margin) / resolution, around, 2.0 * SWEEP


def grown(outline: Floats, margin: float) -> Floats:
    """A convex outline (n, 2), counter-clockwise, with each edge moved outwards by a margin.

    A corner that would move by more than twice the margin, which is sharper than 60°, is cut off at that distance.
    """
    edges = np.roll(outline, -1, axis=0) - outline
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.hypot(edges[:, 0], edges[:, 1])[:, None]
    corners = []
    for corner, n1, n2 in zip(outline, np.roll(normals, 1, axis=0), normals, strict=True):
        middle = (n1 + n2) / np.hypot(*(n1 + n2))
        half = float(middle @ n1)
        if half >= 0.5:
            corners.append(corner + margin / half * middle)
            continue
        # Where the two grown edges meet the line at twice the margin across the corner.
        across = np.array([-middle[1], middle[0]])
        for normal in (n1, n2):
            side = (margin - 2.0 * margin * half) / float(across @ normal)
            corners.append(corner + 2.0 * margin * middle + side * across)
    return np.array(corners)


@compiled
def surely_hits(x: float, y: float, ground: Ground, body: Body) -> bool:
    """Whether the inscribed disc at a place is in contact, so that no heading is free; outside the grid always."""
    distance = ground[0]
    if not (0.0 <= x < distance.shape[1] and 0.0 <= y < distance.shape[0]):
        return True
    return float(distance[int(y), int(x)]) + _SQUARE < body[2]


@compiled
def _room(x: float, y: float, ground: Ground, body: Body) -> float:
    """Lower bound of the distance between the circumscribed disc and the nearest occupied cell, cells."""
    return float(ground[0][int(y), int(x)]) - 2.0 * _SQUARE - body[3]


@compiled
def is_free(x: float, y: float, heading: float, ground: Ground, body: Body) -> bool:
    """Whether the grown outline at a pose, cells and rad, is clear of all occupied cells; outside the grid never."""
    if surely_hits(x, y, ground, body):
        return False
    return _room(x, y, ground, body) > 0.0 or not _meets(x, y, heading, ground[1], body)


@compiled
def _meets(x: float, y: float, heading: float, before: NDArray[np.int32], body: Body) -> bool:
    """Whether the outline at a pose meets an occupied cell."""
    corners, work = body[0], body[1]
    low, high = work[0], work[1]
    cosine, sine = math.cos(heading), math.sin(heading)
    first = math.floor(y - body[3])
    for row in range(low.shape[0]):
        low[row], high[row] = np.inf, -np.inf
    count = corners.shape[0]
    bx = x + cosine * corners[count - 1, 0] - sine * corners[count - 1, 1]
    by = y + sine * corners[count - 1, 0] + cosine * corners[count - 1, 1] - first
    for n in range(count):
        ax, ay = bx, by
        bx = x + cosine * corners[n, 0] - sine * corners[n, 1]
        by = y + sine * corners[n, 0] + cosine * corners[n, 1] - first
        if ay <= by:
            sx, sy, ex, ey = ax, ay, bx, by
        else:
            sx, sy, ex, ey = bx, by, ax, ay
        row, last = int(sy), int(ey)
        low[row], high[row] = min(low[row], sx), max(high[row], sx)
        low[last], high[last] = min(low[last], ex), max(high[last], ex)
        if last > row:
            slope = (ex - sx) / (ey - sy)
            for edge in range(row + 1, last + 1):
                cut = sx + slope * (edge - sy)
                low[edge - 1], high[edge - 1] = min(low[edge - 1], cut), max(high[edge - 1], cut)
                low[edge], high[edge] = min(low[edge], cut), max(high[edge], cut)
    rows, columns = before.shape[0], before.shape[1] - 1
    for row in range(max(0, -first), min(low.shape[0], rows - first)):
        if high[row] >= low[row]:
            left, right = max(math.floor(low[row]), 0), min(math.floor(high[row]) + 1, columns)
            if left < right and before[first + row, right] > before[first + row, left]:
                return True
    return False


def touched(x: float, y: float, heading: float, ground: Ground, body: Body) -> Bools:
    """(rows, columns) the cells, occupied or not, that the grown outline at a pose meets."""
    columns = ground[0].shape[1]
    met = np.zeros(ground[0].shape, dtype=np.bool_)
    _meets(x, y, heading, np.zeros_like(ground[1]), body)
    first = math.floor(y - body[3])
    for row, (low, high) in enumerate(zip(*body[1].tolist(), strict=True), first):
        if low <= high and 0 <= row < len(met):
            met[row, max(math.floor(low), 0) : min(math.floor(high) + 1, columns)] = True
    return met


@compiled
def advanced(
    x: float, y: float, heading: float, curvature: float, length: float, angle: float
) -> tuple[float, float, float]:
    """The pose after a move: an arc of signed curvature and signed length, then a turn in place by an angle.

    The heading is not wrapped.
    """
    if abs(curvature * length) < 1e-9:
        return x + length * math.cos(heading), y + length * math.sin(heading), heading + curvature * length + angle
    end = heading + curvature * length
    x += (math.sin(end) - math.sin(heading)) / curvature
    y -= (math.cos(end) - math.cos(heading)) / curvature
    return x, y, end + angle


@compiled
def is_free_along(
    x: float, y: float, heading: float, curvature: float, length: float, angle: float, ground: Ground, body: Body
) -> bool:
    """Whether a move, see `advanced`, in cells, keeps clear. Its first pose is not tested: it ended the move before."""
    at, whole, way = 0.0, abs(length), 1.0 if length >= 0.0 else -1.0
    # No point of the outline moves further than this per cell along the arc.
    step = body[4] / (1.0 + abs(curvature) * body[3])
    room = _room(x, y, ground, body)
    while at < whole:
        at = min(at + max(step, room), whole)
        px, py, ph = advanced(x, y, heading, curvature, way * at, 0.0)
        if surely_hits(px, py, ground, body):
            return False
        room = _room(px, py, ground, body)
        if room <= 0.0 and _meets(px, py, ph, ground[1], body):
            return False
    if angle == 0.0 or room > 0.0:
        return True
    px, py, ph = advanced(x, y, heading, curvature, length, 0.0)
    at, whole, way = 0.0, abs(angle), 1.0 if angle > 0.0 else -1.0
    while at < whole:
        at = min(at + body[4] / body[3], whole)
        if _meets(px, py, ph + way * at, ground[1], body):
            return False
    return True
