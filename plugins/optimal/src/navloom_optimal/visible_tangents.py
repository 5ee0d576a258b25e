"""The visible tangents that leave one circle in one sense of turning.

The rays that leave a disc tangentially in one sense cover the plane outside it exactly once. If two rays both enter a
convex shape, the shape hides everything behind it from every ray between them. So the search proceeds outwards, bucket
by bucket, until every fan of rays ends at a shape. Only tangents that are not hidden by then are tested exactly.
"""

from __future__ import annotations

import math

import numpy as np
from navloom.geometry.compiled import compiled
from numpy.typing import NDArray

from navloom_optimal.buckets import Buckets, segment_is_free
from navloom_optimal.shapes import TOLERANCE, gap_to, to_segment_squared

__all__ = ["ANGLE_SLACK", "ARRIVES", "ENDS", "GOAL", "LEAVES", "LENGTH", "SIDE", "visible_tangents"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Circle = tuple[float, float, float, float, float, float]
"""Centre x, y and radius, m, sense of turning (1 is counter-clockwise), first angle and extent of its arc, rad."""

LINE, LENGTH, SIDE, LEAVES, ARRIVES = range(5)
"""Columns of a tangent: its line, as the rounded angle; its length, m; the side it arrives at: twice the circle's
number, plus 1 for clockwise turning; the arc from the beginning of this side to the departure, rad; and the arc from
the beginning of the other side to the arrival, rad."""
ENDS = slice(5, 9)
"""Columns of its ends x1, y1, x2, y2, m."""
ANGLE_SLACK = 1e-9
"""Largest distance of a point of contact outside its arc, rad."""
GOAL = 1
"""Number of the goal's circle. The start's is 0; from 2 on there are four for each box, then one a cylinder."""
_FANS = 1024
"""Number of fans of rays in a full turn."""
_LINES = 1e12
"""Inverse of the angle, rad, to which tangents on the same line agree."""


def visible_tangents(number: int, turn: float, places: Floats, usable: Floats, buckets: Buckets) -> tuple[Floats, int]:
    """The free tangents that leave a circle in one sense of turning, in the order of departure.

    If several circles are on one line, only the nearest is included: the line continues from there.

    Args:
        number: Number of the circle.
        turn: 1.0 counter-clockwise, -1.0 clockwise.
        places, usable: Attributes of all circles, see `Circles`.
        buckets: The shapes.

    Returns:
        (n, 9) tangents, with columns `LINE` to `ENDS`, and the number of tangents examined.
    """
    x, y, r = places[number].tolist()
    first, extent = usable[number].tolist()
    circle = (x, y, r, turn, first, extent)
    limits = np.full(max(8, math.ceil(_FANS * extent / (2.0 * np.pi))), np.inf)
    found = np.empty((2 * len(places), 9))
    found = found[: _look_round(_shape_of(number, buckets), circle, limits, found, places, usable, buckets)]
    found = found[np.lexsort((found[:, LENGTH], found[:, LINE]))]
    kept = found[_are_kept(found, circle, limits, buckets)]
    return kept[np.argsort(kept[:, LEAVES], kind="stable")], len(found)


@compiled
def _are_kept(found: Floats, circle: Circle, limits: Floats, buckets: Buckets) -> Bools:
    """Mask of the tangents, sorted by line and length, that are free and have no kept one before them on their line."""
    kept = np.zeros(found.shape[0], dtype=np.bool_)
    for n in range(found.shape[0]):
        if not _is_hidden(found[n], circle, limits) and not _is_behind(n, found, kept):
            kept[n] = segment_is_free(found[n, 5], found[n, 6], found[n, 7], found[n, 8], buckets)
    return kept


@compiled
def _shape_of(number: int, buckets: Buckets) -> int:
    """Number of the shape that a circle surrounds, boxes first; negative for start and goal."""
    boxes = buckets[7].shape[0]
    return (number - 2) // 4 if number < 2 + 4 * boxes else number - 2 - 3 * boxes


@compiled
def _is_behind(n: int, found: Floats, kept: Bools) -> bool:
    """Whether a kept tangent is on the same line as tangent n, with the same turning, and ends well before it."""
    length = found[n, LENGTH]
    for k in range(n - 1, -1, -1):
        if found[k, LINE] != found[n, LINE]:
            return False
        same = (found[k, SIDE] - found[n, SIDE]) % 2.0 == 0.0
        if kept[k] and same and 0.01 * length < found[k, LENGTH] < 0.99 * length:
            return True
    return False


@compiled
def _look_round(
    owner: int,
    circle: Circle,
    limits: Floats,
    found: Floats,
    places: Floats,
    usable: Floats,
    buckets: Buckets,
) -> int:
    """Collect the tangents to possibly visible shapes; returns their count. Sets `limits`, the range of fans, m."""
    x0, y0, edge, rows, cols, offsets, numbers, boxes, discs, _ = buckets
    count = _add_tangent(found, 0, circle, GOAL, 1.0, places, usable)
    seen = np.zeros(boxes.shape[0] + discs.shape[0], dtype=np.bool_)
    col, row = math.floor((circle[0] - x0) / edge), math.floor((circle[1] - y0) / edge)
    last = max(abs(col), abs(cols - 1 - col), abs(row), abs(rows - 1 - row))
    for ring in range(max(0, -col, col - cols + 1, -row, row - rows + 1), last + 1):
        # Shapes first met in this ring are at least this far away.
        nearest = (ring - 1) * edge
        if limits.max() < nearest:
            break
        for i in range(max(0, row - ring), min(rows, row + ring + 1)):
            is_whole = abs(i - row) == ring
            for j in range(max(0, col - ring) if is_whole else col - ring, col + ring + 1, 1 if is_whole else 2 * ring):
                if not 0 <= j < cols:
                    continue
                for place in range(offsets[i * cols + j], offsets[i * cols + j + 1]):
                    k = numbers[place]
                    if not seen[k]:
                        seen[k] = True
                        count = _look_at(k, k != owner, found, count, circle, limits, places, usable, buckets)
    return count


@compiled
def _look_at(
    k: int,
    may_hide: bool,
    found: Floats,
    count: int,
    circle: Circle,
    limits: Floats,
    places: Floats,
    usable: Floats,
    buckets: Buckets,
) -> int:
    """Add the tangents to shape k, boxes first, and shorten the fans that end at it; returns the new count."""
    boxes, discs, radius = buckets[7:]
    if k < boxes.shape[0]:
        x, y, reach = boxes[k, 0], boxes[k, 1], math.hypot(boxes[k, 2], boxes[k, 3]) + radius
        first, last = 2 + 4 * k, 6 + 4 * k
    else:
        m = k - boxes.shape[0]
        x, y, reach = discs[m, 0], discs[m, 1], discs[m, 2] + radius
        first, last = 2 + 3 * boxes.shape[0] + k, 3 + 3 * boxes.shape[0] + k
    away = gap_to(k, circle[0], circle[1], boxes, discs, radius)
    width, low, span = _fan_width(circle, limits), 0.0, 2.0 * np.pi
    if away > 1.001 * circle[2]:
        # The outermost rays that touch the shape's circles, which are less than half a turn apart. A circle around the
        # whole shape has two rays instead of eight; a long shape may be beside the circle and within that.
        if circle[2] + reach < 0.999 * math.hypot(x - circle[0], y - circle[1]):
            middle, left = _bearing(circle, x, y, reach), 0.0
            right = _bearing(circle, x, y, -reach) - middle
        else:
            middle, left, right = _bearing(circle, x, y, 0.0), 0.0, 0.0
            for target in range(first, last):
                for signed in (places[target, 2], -places[target, 2]):
                    ray = _bearing(circle, places[target, 0], places[target, 1], signed)
                    off = (ray - middle + np.pi) % (2.0 * np.pi) - np.pi
                    left, right = min(left, off), max(right, off)
        low, span = _along(circle, middle + left - ANGLE_SLACK), right - left + 2.0 * ANGLE_SLACK
        if not _is_any_open(low, span, width, away, limits):
            return count
    for target in range(first, last):
        for turn in (1.0, -1.0):
            count = _add_tangent(found, count, circle, target, turn, places, usable)
    if may_hide:
        for start in (low, low - 2.0 * np.pi):
            _hide(k, away, start, span, width, circle, limits, buckets)
    return count


@compiled
def _bearing(circle: Circle, x: float, y: float, signed: float) -> float:
    """Angle of the right-hand normal of the ray that touches a circle at x, y with a signed radius, m (clockwise < 0).

    With the normal n and signed radii e: n · (c2 - c1) = e1 - e2, contacts at c + e n. NaN if there is no such ray.
    """
    dx, dy = x - circle[0], y - circle[1]
    away = math.hypot(dx, dy)
    if away == 0.0:
        return np.nan
    cosine = (circle[3] * circle[2] - signed) / away
    if abs(cosine) > 1.0:
        return np.nan
    return math.atan2(dy, dx) - math.acos(cosine)


@compiled
def _along(circle: Circle, bearing: float) -> float:
    """Angle from the first angle of the circle's arc to a ray's point of contact, rad in [0, 2π)."""
    angle = bearing if circle[3] > 0.0 else bearing + np.pi
    return float((angle - circle[4] + ANGLE_SLACK) % (2.0 * np.pi))


@compiled
def _fan_width(circle: Circle, limits: Floats) -> float:
    """Width of a fan, rad; the fans cover the arc and the slack at both its ends."""
    return float((circle[5] + 2.0 * ANGLE_SLACK) / limits.shape[0])


@compiled
def _is_any_open(low: float, span: float, width: float, away: float, limits: Floats) -> bool:
    """Whether any fan in an interval of angles along the arc reaches a distance, m."""
    for start in (low, low - 2.0 * np.pi):
        first, last = math.floor(start / width), math.floor((start + span) / width)
        for fan in range(max(0, first), min(limits.shape[0], last + 1)):
            if limits[fan] >= away:
                return True
    return False


@compiled
def _is_hidden(tangent: Floats, circle: Circle, limits: Floats) -> bool:
    """Whether a tangent's fan ends before the tangent does."""
    along, away = tangent[LINE] / _LINES, math.hypot(circle[2], tangent[LENGTH])
    width = _fan_width(circle, limits)
    for angle in (along - 1e-9, along + 1e-9):
        fan = min(max(math.floor(angle / width), 0), limits.shape[0] - 1)
        if limits[fan] >= away:
            return False
    return True


@compiled
def _add_tangent(
    found: Floats, count: int, circle: Circle, target: int, turn: float, places: Floats, usable: Floats
) -> int:
    """Add the tangent to another circle and sense of turning if there is one within both arcs; returns the count."""
    x, y, r, turn_here = circle[:4]
    tx, ty, tr = places[target, 0], places[target, 1], places[target, 2]
    bearing = _bearing(circle, tx, ty, turn * tr)
    leaves = _arc_to(bearing, turn_here, circle[4], circle[5])
    arrives = _arc_to(bearing, turn, usable[target, 0], usable[target, 1])
    if math.isnan(leaves) or math.isnan(arrives):
        return count
    nx, ny = math.cos(bearing), math.sin(bearing)
    ax, ay = x + turn_here * r * nx, y + turn_here * r * ny
    bx, by = tx + turn * tr * nx, ty + turn * tr * ny
    tangent = found[count]
    tangent[LINE] = math.floor(_along(circle, bearing) * _LINES + 0.5)
    tangent[LENGTH] = math.hypot(bx - ax, by - ay)
    tangent[SIDE] = 2.0 * target + (1.0 if turn < 0.0 else 0.0)
    tangent[LEAVES], tangent[ARRIVES] = leaves, arrives
    tangent[5], tangent[6], tangent[7], tangent[8] = ax, ay, bx, by
    return count + 1


@compiled
def _arc_to(bearing: float, turn: float, first: float, extent: float) -> float:
    """Angle from the beginning of an arc to a ray's point of contact, rad, in the sense of turning; NaN if outside."""
    angle = bearing if turn > 0.0 else bearing + np.pi
    past = (angle - first + ANGLE_SLACK) % (2.0 * np.pi) - ANGLE_SLACK
    if not past <= extent + ANGLE_SLACK:
        return np.nan
    return past if turn > 0.0 else extent - past


@compiled
def _hide(
    k: int, away: float, low: float, span: float, width: float, circle: Circle, limits: Floats, buckets: Buckets
) -> None:
    """Shorten the fans within an interval of angles along the arc whose two rays both enter shape k, `away` m away."""
    x, y, r, turn, first_angle = circle[:5]
    fans = limits.shape[0]
    first, last = max(0, math.ceil(low / width)), min(fans, math.floor((low + span) / width))
    before = False
    px, py = 0.0, 0.0
    for ray in range(first, last + 1):
        if max(limits[max(ray - 1, 0)], limits[min(ray, fans - 1)]) <= away:
            before = False
            continue
        angle = first_angle - ANGLE_SLACK + ray * width
        nx, ny = math.cos(angle), math.sin(angle)
        # Slightly beyond the entry point, so that the line between two such points stays outside the circle.
        depth = _enters(k, x + r * nx, y + r * ny, -turn * ny, turn * nx, r * width, buckets)
        enters = math.isfinite(depth)
        qx, qy = x + r * nx - turn * depth * ny, y + r * ny + turn * depth * nx
        if before and enters and to_segment_squared(x, y, px, py, qx, qy) >= r * r:
            limits[ray - 1] = min(limits[ray - 1], max(math.hypot(px - x, py - y), math.hypot(qx - x, qy - y)))
        before, px, py = enters, qx, qy


@compiled
def _enters(k: int, x: float, y: float, dx: float, dy: float, beyond: float, buckets: Buckets) -> float:
    """Distance along a ray, m, to a point `beyond` m inside shape k inflated by the radius; infinite for none."""
    boxes, discs, radius = buckets[7:]
    grown = radius - 2.0 * TOLERANCE
    if k >= boxes.shape[0]:
        m = k - boxes.shape[0]
        return _into_disc(x - discs[m, 0], y - discs[m, 1], dx, dy, discs[m, 2] + grown, beyond)
    hx, hy, cosine, sine = boxes[k, 2], boxes[k, 3], boxes[k, 4], boxes[k, 5]
    x, y = x - boxes[k, 0], y - boxes[k, 1]
    x, y, dx, dy = cosine * x + sine * y, cosine * y - sine * x, cosine * dx + sine * dy, cosine * dy - sine * dx
    best = _into_disc(x, y, dx, dy, min(hx, hy) + grown, beyond)
    best = min(best, _into_rectangle(x, y, dx, dy, hx + grown, hy, beyond))
    return min(best, _into_rectangle(x, y, dx, dy, hx, hy + grown, beyond))


@compiled
def _into_disc(x: float, y: float, dx: float, dy: float, radius: float, beyond: float) -> float:
    """Distance like `_enters`, for a disc around the origin."""
    middle = -(x * dx + y * dy)
    squared = radius * radius - (x + middle * dx) ** 2 - (y + middle * dy) ** 2
    if squared <= 0.0:
        return np.inf
    half = math.sqrt(squared)
    low, high = max(0.0, middle - half), middle + half
    return np.inf if high <= low else min(low + beyond, 0.5 * (low + high))


@compiled
def _into_rectangle(x: float, y: float, dx: float, dy: float, hx: float, hy: float, beyond: float) -> float:
    """Distance like `_enters`, for the rectangle |x| < hx, |y| < hy."""
    low, high = 0.0, np.inf
    for at, step, half in ((x, dx, hx), (y, dy, hy)):
        if abs(step) < 1e-12:
            if abs(at) >= half:
                return np.inf
        else:
            one, other = (-half - at) / step, (half - at) / step
            low, high = max(low, min(one, other)), min(high, max(one, other))
    return np.inf if high <= low else min(low + beyond, 0.5 * (low + high))
