"""A short memory of echoes in the map frame, and the nearest one in the robot's way."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom.geometry.world import read_only
from navloom.messages import Pose2D, RangeScan

__all__ = ["EchoMemory", "warm_up"]

Floats = NDArray[np.float64]

_THIN = 0.02
"""Half angle below which a beam counts as a laser's, rad."""
_AGREEMENT = 0.1
"""Largest difference between laser readings of one surface, m."""
_EXPLAINED = 0.1
"""Largest distance of a laser's point from the arc of the sonar's echo that it explains, m."""
_BESIDE = 3
"""Number of neighbours on each side that are averaged with a laser's reading."""
_A_LITTLE_MORE = 1.0 + 1e-9
"""Factor on a squared distance, so that rounding loses no point."""


class EchoMemory:
    """Points where recent echoes may have come from, in a ring buffer.

    A sonar's echo that a laser explains adds nothing: a laser has seen what is in the cone at that distance, and the
    rest of the arc may be the opening beside it. What no laser sees, as glass or a table top, keeps its arc.

    Args:
        keep: How long an echo counts, s.
        spread: Share of a beam's half-angle to count: a sonar's echo comes from somewhere on an arc. 0 takes the
            beam's axis alone, 1 the whole arc.
        capacity: Most points.
    """

    def __init__(self, keep: float, spread: float, capacity: int = 16384) -> None:
        self.keep, self.spread = keep, spread
        # A ring instead of a list, because a kernel reads it in each tick and it must not allocate.
        self._points = np.full((capacity, 4), -math.inf)
        self._cursor = np.zeros(2, dtype=np.int64)

    def clear(self) -> None:
        """Forget all echoes."""
        self._cursor[:] = 0

    def add(self, scan: RangeScan, base: Pose2D, time: float) -> None:
        """Remember a scan taken at a pose in the map and a run time, s."""
        _add(self._points, self._cursor, scan.origins, scan.bearings, scan.half_angles, scan.ranges,
             scan.range_min, scan.range_max, base.x, base.y, base.heading, self.spread, time,
             time - self.keep)  # fmt: skip

    def nearest(self, base: Pose2D, way: Floats, half_width: float, time: float) -> float:
        """Distance from base, m, of the nearest echo within the strip along a way; infinite if it is free.

        Args:
            base: Pose of the robot, map frame.
            way: (k, 2) points, m, map frame. Echoes behind the line across its first point are not in the way.
            half_width: Half width of the strip, m; the strip extends past the last point by as much.
            time: Run time, s; echoes since `time - keep` count. Scans must have been added in order of time.
        """
        since = time - self.keep
        return float(_nearest(self._points, self._cursor, base.x, base.y, read_only(way), half_width, since))

    def near(self, base: Pose2D, reach: float, time: float) -> Floats:
        """(k, 2) echoes within reach, m, of a pose in the map, in its frame, since `time - keep`, s."""
        held = self._points[: int(self._cursor[1])]
        x, y = held[:, 0] - base.x, held[:, 1] - base.y
        kept = (held[:, 2] >= time - self.keep) & (x * x + y * y <= reach * reach)
        x, y, cos, sin = x[kept], y[kept], math.cos(base.heading), math.sin(base.heading)
        return np.stack([cos * x + sin * y, cos * y - sin * x], axis=1)


@njit(cache=True, nogil=True)
def _add(
    points: Floats, cursor: NDArray[np.int64], origins: Floats, bearings: Floats, half_angles: Floats, ranges: Floats,
    range_min: float, range_max: float, x: float, y: float, heading: float, spread: float, time: float, since: float,
) -> None:  # fmt: skip
    """Store each echo's point on the axis and, for beams with an opening angle, both ends of the counted arc.

    A row of `points` is x, y, m, map frame, time, s, and 1 for a laser's point.
    """
    cos, sin = math.cos(heading), math.sin(heading)
    capacity = points.shape[0]
    for beam in range(ranges.shape[0]):
        distance = ranges[beam]
        # Written so that NaN counts as no echo.
        if not distance < range_max:
            continue
        first = x + cos * origins[beam, 0] - sin * origins[beam, 1]
        second = y + sin * origins[beam, 0] + cos * origins[beam, 1]
        # Readings of sonars are not averaged with those of neighbours, whose cones look elsewhere.
        is_laser = half_angles[beam] < _THIN
        if is_laser:
            distance = _smoothed(ranges, beam)
        elif _is_explained(
            points, cursor, first, second, heading + bearings[beam], half_angles[beam], distance,
            distance <= range_min, since,
        ):  # fmt: skip
            continue
        offset = half_angles[beam] * spread
        # The axis and both ends suffice: a strip wide enough for a robot catches an arc by one of the three.
        for side in range(-1, 2):
            if side != 0 and offset == 0.0:
                continue
            angle = heading + bearings[beam] + side * offset
            row = cursor[0]
            points[row, 0] = first + distance * math.cos(angle)
            points[row, 1] = second + distance * math.sin(angle)
            points[row, 2], points[row, 3] = time, 1.0 if is_laser else 0.0
            cursor[0] = (row + 1) % capacity
            cursor[1] = min(cursor[1] + 1, capacity)


@njit(cache=True, nogil=True)
def _is_explained(
    points: Floats, cursor: NDArray[np.int64], x: float, y: float, axis: float, half_angle: float, distance: float,
    is_blind: bool, since: float,
) -> bool:  # fmt: skip
    """Whether a laser's point lies on the arc of a sonar's reading; or, if the sonar is blind there, before it.

    Args:
        points, cursor, since: The ring; points since this time count, s.
        x, y, axis, half_angle: Apex, m, axis and half opening of the cone, rad, map frame.
        distance, is_blind: The reading, m, and whether it is the smallest one, which stands for nearer ones too.
    """
    ax, ay, cos, sin = math.cos(axis), math.sin(axis), math.cos(half_angle), math.sin(half_angle)
    row = cursor[0]
    for _ in range(cursor[1]):
        row = row - 1 if row > 0 else points.shape[0] - 1
        if points[row, 2] < since:
            break
        if points[row, 3] == 0.0:
            continue
        dx, dy = points[row, 0] - x, points[row, 1] - y
        beyond = math.sqrt(dx * dx + dy * dy) - distance
        if beyond > _EXPLAINED or (beyond < -_EXPLAINED and not is_blind):
            continue
        along, across = dx * ax + dy * ay, abs(dy * ax - dx * ay)
        if along > 0.0 and across * cos - along * sin <= _EXPLAINED:
            return True
    return False


@njit(cache=True, nogil=True)
def _smoothed(ranges: Floats, beam: int) -> float:
    """A laser's reading with less noise, m: the mean of it and of its neighbours that agree with it."""
    total, count = 0.0, 0
    for k in range(max(0, beam - _BESIDE), min(ranges.shape[0], beam + _BESIDE + 1)):
        # Only neighbours that agree: across an edge, the mean would be an obstacle in free space.
        if abs(ranges[k] - ranges[beam]) <= _AGREEMENT:
            total += ranges[k]
            count += 1
    return total / count


@njit(cache=True, nogil=True)
def _nearest(
    points: Floats, cursor: NDArray[np.int64], x: float, y: float, way: Floats, half_width: float, since: float
) -> float:
    best, reach = math.inf, 0.0
    low_x, low_y, high_x, high_y = math.inf, math.inf, -math.inf, -math.inf
    for k in range(way.shape[0]):
        reach = max(reach, math.hypot(way[k, 0] - x, way[k, 1] - y))
        low_x, high_x = min(low_x, way[k, 0]), max(high_x, way[k, 0])
        low_y, high_y = min(low_y, way[k, 1]), max(high_y, way[k, 1])
    reach += half_width
    low_x, high_x, low_y, high_y = low_x - half_width, high_x + half_width, low_y - half_width, high_y + half_width
    near = _A_LITTLE_MORE * reach * reach
    row = cursor[0]
    for _ in range(cursor[1]):
        row = row - 1 if row > 0 else points.shape[0] - 1
        # The ring is in order of time, so that all that follow are older.
        if points[row, 2] < since:
            break
        px, py = points[row, 0], points[row, 1]
        # Cheap tests exclude most echoes.
        if px < low_x or px > high_x or py < low_y or py > high_y:
            continue
        if (px - x) * (px - x) + (py - y) * (py - y) > near:
            continue
        distance = math.hypot(px - x, py - y)
        if distance < min(best, reach) and _is_within(px, py, way, half_width):
            best = distance
            near = _A_LITTLE_MORE * best * best
    return best


@njit(cache=True, nogil=True)
def _is_within(x: float, y: float, way: Floats, half_width: float) -> bool:
    """Whether a point is nearer to a polyline than half a width, and not behind its first segment."""
    for k in range(way.shape[0] - 1):
        ux, uy = way[k + 1, 0] - way[k, 0], way[k + 1, 1] - way[k, 1]
        rx, ry = x - way[k, 0], y - way[k, 1]
        square = ux * ux + uy * uy
        share = (rx * ux + ry * uy) / square if square > 0.0 else 0.0
        # What is behind the robot at its first point is not in its way, but what is behind a later corner may be.
        if k == 0 and share < 0.0:
            continue
        share = min(max(share, 0.0), 1.0)
        if math.hypot(rx - share * ux, ry - share * uy) < half_width:
            return True
    return False


def warm_up() -> None:
    """Compile the kernels for the array types of messages."""
    two, one = np.zeros((1, 2)), np.ones(1)
    for array in (two, one):
        array.flags.writeable = False
    memory = EchoMemory(1.0, 0.5, capacity=4)
    memory.add(RangeScan(0, two, one, one, one, one, 0.1, 4.0), Pose2D(0.0, 0.0, 0.0), 0.0)
    memory.nearest(Pose2D(0.0, 0.0, 0.0), np.zeros((2, 2)), 0.5, 0.0)
