"""A way along which a robot without room to turn gets to where it can: a search over short arcs. Pure; SI.

Beside a wall the rear corner of a robot that turns away comes nearer to the wall first. So each arc of the search
bends, at every step, as far to its side as the margin lets it: hardly at the beginning, more with each centimetre won.
The search is a best-first one (Pohl 1970: weighted A*) over such arcs, forwards and backwards.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["STEP", "has_room", "way_out"]

Floats = NDArray[np.float64]

STEP = 0.02
"""Distance between two poses of a way, m."""
STEPS = 10
"""Poses of one arc of the search."""
LONGEST = 4.0
"""Longest way, m."""
MOST = 3000
"""Most arcs of a search."""
BENDS = np.array([3.0, 1.5, 0.8, 0.4, 0.2, 0.1, 0.05, 0.025, 0.0])
"""Curvatures that are tried at each step, 1/m; at 0.15 m/s the first is 26 degrees per second."""
CHANGE = 0.3
"""Cost of a change between forwards and backwards, m."""
GREED = 4.0
"""Weight of the room that is still missing, against the way so far."""
PLACE, TURN = 0.05, 0.01
"""Two places of the search nearer than this, m and rad, are one."""
NEARER = 0.02 * STEP
"""How much nearer a step may bring the robot to what is within its margin, m: as much as the gate allows."""


def has_room(points: Floats, radius: float) -> bool:
    """Whether no point (k, 2), m, base frame, is nearer to the base than a radius, m."""
    return not len(points) or float(np.hypot(points[:, 0], points[:, 1]).min()) >= radius


def way_out(
    points: Floats, edges: Floats, radius: float, margin: float, room: float, goes: tuple[bool, bool]
) -> Floats:
    """The poses of a way to the nearest place with room to turn; no rows if none was found.

    Args:
        points: (k, 2) what may not be touched, m, base frame. edges: Of the footprint, see `motion.edges_of`.
        radius: Of the circle round the base that holds the footprint, m.
        margin: Gap to keep, m; where it is less, the robot comes no nearer.
        room: Distance between base and points with which the robot can turn on the spot, m.
        goes: Whether it may drive forwards, backwards.

    Returns:
        (m, 5) x, y, m, heading, rad, curvature, 1/m, and 1 forwards or -1 backwards, in the base frame, STEP apart.
    """
    reach = LONGEST + room
    near = np.ascontiguousarray(points[np.hypot(points[:, 0], points[:, 1]) < reach])
    found: Floats = _search(near, edges, radius + margin + STEP, margin, room, goes[0], goes[1])
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _gap(px, py, edges):  # type: ignore[no-untyped-def]
    """Distance of a point from the footprint, m, both in the base frame; see `motion.gap`."""
    gap = -math.inf
    for k in range(edges.shape[0]):
        gap = max(gap, edges[k, 0] * px + edges[k, 1] * py - edges[k, 2])
    return gap


@njit(cache=True, nogil=True, error_model="numpy")
def _is_free(points, edges, radius, margin, before, x, y, heading):  # type: ignore[no-untyped-def]
    """Whether the footprint keeps the margin, or comes no nearer to what is within it than at the pose before."""
    cos, sin = math.cos(heading), math.sin(heading)
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - x, points[i, 1] - y
        if dx * dx + dy * dy > radius * radius:
            continue
        now = _gap(cos * dx + sin * dy, cos * dy - sin * dx, edges)
        if now < margin:
            c, s, dx, dy = math.cos(before[2]), math.sin(before[2]), points[i, 0] - before[0], points[i, 1] - before[1]
            if now < _gap(c * dx + s * dy, c * dy - s * dx, edges) - NEARER:
                return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _missing(points, room, x, y):  # type: ignore[no-untyped-def]
    """How much the nearest point is too near for a turn on the spot, m."""
    nearest = math.inf
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - x, points[i, 1] - y
        nearest = min(nearest, dx * dx + dy * dy)
    return max(0.0, room - math.sqrt(nearest))


@njit(cache=True, nogil=True, error_model="numpy")
def _arc(points, edges, radius, margin, room, pose, mode, poses):  # type: ignore[no-untyped-def]
    """Drive one arc from a pose; return the number of poses filled in. Modes: left, right, straight; and backwards."""
    ahead = 1.0 if mode < 3 else -1.0
    side = (1.0, -1.0, 0.0)[mode % 3]
    x, y, heading = pose[0], pose[1], pose[2]
    here = np.array([x, y, heading])
    for count in range(STEPS):
        is_free = False
        for bend in BENDS:
            if side == 0.0 and bend > 0.0:
                continue
            turn = ahead * side * bend * STEP
            middle = heading + 0.5 * turn
            new_x, new_y = x + ahead * STEP * math.cos(middle), y + ahead * STEP * math.sin(middle)
            if _is_free(points, edges, radius, margin, here, new_x, new_y, heading + turn):
                is_free = True
                x, y, heading = new_x, new_y, heading + turn
                here[0], here[1], here[2] = x, y, heading
                poses[count, 0], poses[count, 1], poses[count, 2] = x, y, heading
                poses[count, 3], poses[count, 4] = side * bend, ahead
                break
        if not is_free:
            return count
        if _missing(points, room, x, y) == 0.0:
            return count + 1
    return STEPS


@njit(cache=True, nogil=True, error_model="numpy")
def _search(points, edges, radius, margin, room, forwards, backwards):  # type: ignore[no-untyped-def]
    nodes = np.zeros((MOST, 8))  # x, y, heading, way so far, priority, parent, mode, number of poses
    nodes[0, 5], nodes[0, 6] = -1.0, -1.0
    is_open = np.zeros(MOST, np.bool_)
    is_open[0] = True
    nodes[0, 4] = GREED * _missing(points, room, 0.0, 0.0)
    total, poses, goal = 1, np.empty((STEPS, 5)), -1
    while goal < 0 and total < MOST - 6:
        best = -1
        for i in range(total):
            if is_open[i] and (best < 0 or nodes[i, 4] < nodes[best, 4]):
                best = i
        if best < 0:
            break
        is_open[best] = False
        if nodes[best, 3] >= LONGEST:
            continue
        for mode in range(6):
            if not (forwards if mode < 3 else backwards):
                continue
            count = _arc(points, edges, radius, margin, room, nodes[best, :3], mode, poses)
            if count == 0:
                continue
            x, y, heading = poses[count - 1, 0], poses[count - 1, 1], poses[count - 1, 2]
            is_known = False
            for i in range(total):
                if (
                    abs(nodes[i, 0] - x) < PLACE
                    and abs(nodes[i, 1] - y) < PLACE
                    and abs(math.sin(0.5 * (nodes[i, 2] - heading))) < 0.5 * TURN
                ):
                    is_known = True
                    break
            missing = _missing(points, room, x, y)
            if is_known and missing > 0.0:
                continue
            changes = nodes[best, 6] >= 0.0 and (nodes[best, 6] < 3.0) != (mode < 3)
            nodes[total, 0], nodes[total, 1], nodes[total, 2] = x, y, heading
            nodes[total, 3] = nodes[best, 3] + count * STEP + (CHANGE if changes else 0.0)
            nodes[total, 4] = nodes[total, 3] + GREED * missing
            nodes[total, 5], nodes[total, 6], nodes[total, 7] = best, mode, count
            is_open[total] = True
            total += 1
            if missing == 0.0:
                goal = total - 1
                break
    length = 0
    node = goal
    while node > 0:
        length += int(nodes[node, 7])
        node = int(nodes[node, 5])
    found = np.empty((length, 5))
    node = goal
    while node > 0:
        count = int(nodes[node, 7])
        parent = int(nodes[node, 5])
        _arc(points, edges, radius, margin, room, nodes[parent, :3], int(nodes[node, 6]), poses)
        found[length - count : length] = poses[:count]
        length -= count
        node = parent
    return found
