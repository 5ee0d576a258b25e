"""Today's critics: those of Nav2's DWB controller, each a function, and their sum over the window.

Costs are in metres of way to the target, so that weights are plain factors. The distance critics take the mean over
the horizon instead of DWB's last pose: of two arcs that end alike, the one that comes near sooner is better.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_dwa.field import CHAMFER, UNIT, field_value
from navloom_dwa.objective import arc_pose

Floats = NDArray[np.float64]
Counts = NDArray[np.int32]
Cells = NDArray[np.int64]
SAMPLES = 24  # of the critics along an arc
A_LITTLE_MORE = 1.0 + 1.0e-9  # so that rounding of squares decides nothing
GOAL_DISTANCE, GOAL_ALIGN, PATH_DISTANCE, PATH_ALIGN, OBSTACLE, CONTACT, TURNING = range(7)


@njit(cache=True, nogil=True)
def goal_distance(cost_to_go: Counts, origin: Cells, cell: float, x: float, y: float) -> float:
    """Way to the target round what is known, m, from a place, m, pose frame; at the nose it is goal align."""
    return field_value(cost_to_go, origin, cell, x, y) * cell / UNIT


@njit(cache=True, nogil=True)
def segments_of(path: Floats) -> Floats:
    """(k - 1, 5) start x, y, and vector x, y, m, and its square, m², of the segments of a polyline (k, 2), m."""
    segments = np.empty((max(0, path.shape[0] - 1), 5))
    for k in range(segments.shape[0]):
        dx, dy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3] = path[k, 0], path[k, 1], dx, dy
        segments[k, 4] = dx * dx + dy * dy
    return segments


@njit(cache=True, nogil=True, error_model="numpy")
def path_distance(segments: Floats, x: float, y: float) -> float:
    """Distance of a place from a polyline of segments_of(), m, one frame. At the nose it is the path align critic.

    Squares tell the nearest segment. Of those whose squares rounding could confuse, the distances are compared.
    """
    if segments.shape[0] == 0:
        return 0.0
    least, square, near_x, near_y = np.inf, np.inf, np.inf, np.inf
    for k in range(segments.shape[0]):
        dx, dy = x - segments[k, 0], y - segments[k, 1]
        along = dx * segments[k, 2] + dy * segments[k, 3]
        if along > 0.0:
            share = along / segments[k, 4] if along < segments[k, 4] else 1.0
            dx, dy = dx - share * segments[k, 2], dy - share * segments[k, 3]
        found = dx * dx + dy * dy
        if A_LITTLE_MORE * found < square:
            least, square, near_x, near_y = np.inf, found, dx, dy
        elif found <= A_LITTLE_MORE * square:
            least = min(least, math.hypot(dx, dy), math.hypot(near_x, near_y))
            square = min(square, found)
    return min(least, math.hypot(near_x, near_y))


@njit(cache=True, nogil=True)
def obstacle_nearness(clearance: float, inner: float, soft: float) -> float:
    """1 where the disc within the footprint touches something, 0 from `soft` on: clearance of the base and radii, m."""
    return min(1.0, max(0.0, 1.0 - (clearance - inner) / soft))


@njit(cache=True, nogil=True)
def contact_nearness(contact: float, horizon: float) -> float:
    """1 where contact is now, 0 where it is beyond the horizon; both s."""
    return max(0.0, 1.0 - contact / horizon)


@njit(cache=True, nogil=True)
def is_oscillating(v: float, w: float, trend: int, slow: float) -> bool:
    """Whether a turn in place goes back on the last one: v below `slow`, m/s, and w against the sign `trend`."""
    return v < slow and w * trend < 0.0


@njit(cache=True, nogil=True)
def must_rotate(distance: float, bearing: float, within: float, allowed: float) -> bool:
    """Rotate to goal: so near to the target, m, it is turned to, rad, before it is driven to."""
    return distance < within and abs(bearing) > allowed


@njit(cache=True, nogil=True)
def beyond_target(way: float, remaining: float) -> float:
    """Cost of having driven past a target that is not the goal: it falls by what was driven, m, up to what remains."""
    return -min(way, remaining)


@njit(cache=True, nogil=True)
def arc_profile(
    v: float,
    w: float,
    contact: float,
    step: float,
    pose: tuple[float, float, float],
    target: tuple[float, float],
    nose: float,
    remaining: float,
    capture: float,
    segments: Floats,
    cost_to_go: Counts,
    distance: Counts,
    origin: Cells,
    cell: float,
    inner: float,
    soft: float,
    weights: Floats,
    sums: Floats,
) -> None:
    """Running sum of the critics along an arc at u = 1; from the contact on they stay as they are there.

    Args:
        v, w: For u = 1. contact: s at u = 1. step: Between samples, s.
        pose: Of the base in the pose frame. target: m, base frame.
        nose: The align critics score this far ahead of the base, m, or as far as the target where that is nearer.
        remaining: Way after the target, m. capture: The target is passed when nearer than this, m.
        segments: Of segments_of(), pose frame. cost_to_go, distance, origin, cell: Of field.fill_field().
        inner, soft: As for obstacle_nearness(). weights: (7,). sums: (k,), filled: sums[i] over samples 0 .. i.
    """
    heading = pose[2]
    c, s = math.cos(heading), math.sin(heading)
    total, passed, way, value, last = 0.0, -1.0, 0.0, 0.0, -1.0
    for i in range(sums.size):
        time = min(i * step, contact)
        if time == last:
            total += value
            sums[i] = total
            continue
        last = time
        px, py, turned = arc_pose(v, w, time)
        x, y = pose[0] + px * c - py * s, pose[1] + px * s + py * c
        length = min(nose, math.hypot(target[0] - px, target[1] - py))
        ahead_x, ahead_y = x + length * math.cos(heading + turned), y + length * math.sin(heading + turned)
        way = v * time
        to_go = goal_distance(cost_to_go, origin, cell, x, y)
        if passed < 0.0 and to_go < capture and remaining > 0.0:
            passed = way
        if passed >= 0.0:
            to_go = capture + beyond_target(way - passed, remaining)
            ahead = to_go
        else:
            ahead = goal_distance(cost_to_go, origin, cell, ahead_x, ahead_y)
        value = weights[GOAL_DISTANCE] * to_go + weights[GOAL_ALIGN] * ahead
        if weights[PATH_DISTANCE] > 0.0:
            value += weights[PATH_DISTANCE] * path_distance(segments, x, y)
        if weights[PATH_ALIGN] > 0.0:
            value += weights[PATH_ALIGN] * path_distance(segments, ahead_x, ahead_y)
        clearance = field_value(distance, origin, cell, x, y) * cell / CHAMFER
        value += weights[OBSTACLE] * obstacle_nearness(clearance, inner, soft)
        total += value
        sums[i] = total


@njit(cache=True, nogil=True)
def mean_until(sums: Floats, last: float) -> float:
    """Mean of the samples up to number `last`, not whole: the sums between two numbers are taken as straight."""
    i = min(sums.size - 1, int(last))
    total, count = sums[i], i + 1.0
    if i + 1 < sums.size:
        total += (last - i) * (sums[i + 1] - sums[i])
        count += last - i
    return float(total / count)


@njit(cache=True, nogil=True)
def score_critics(
    arcs: Floats,
    limits: Floats,
    contacts: Floats,
    target: tuple[float, float],
    pose: tuple[float, float, float],
    horizon: float,
    nose: float,
    remaining: float,
    capture: float,
    path: Floats,
    cost_to_go: Counts,
    distance: Counts,
    origin: Cells,
    cell: float,
    inner: float,
    soft: float,
    weights: Floats,
    trend: int,
    slow: float,
    rotation: tuple[float, float],
    costs: Floats,
) -> None:
    """Cost of each velocity of the window.

    Args:
        arcs, limits, contacts: As for objective.score_1997(). target: m, base frame. horizon: s.
        trend: Sign of the last turn in place, 0 where it does not bind. slow: See is_oscillating().
        path: (k, 2), pose frame, m. rotation: `within`, m, and `allowed`, rad, of must_rotate().
        costs: (m, n), filled; +inf not admissible.
        The others: As for arc_profile().
    """
    count = costs.shape[1]
    fastest = 1.0e-6
    for j in range(arcs.shape[0]):
        fastest = max(fastest, arcs[j, 3])
    sums, segments = np.empty(SAMPLES), segments_of(path)
    step = fastest * horizon / (sums.size - 1)
    bearing = math.atan2(target[1], target[0])
    rotates = must_rotate(math.hypot(target[0], target[1]), bearing, rotation[0], rotation[1])
    costs[:, :] = np.inf
    for j in range(arcs.shape[0]):
        v, w, low, high = arcs[j, 0], arcs[j, 1], arcs[j, 2], arcs[j, 3]
        if low > high or low > limits[j]:
            continue
        # No speed of the arc reads a sum beyond that of its highest.
        read = min(sums.size, int(min(high, limits[j]) * horizon / step) + 2)
        arc_profile(
            v, w, contacts[j], step, pose, target, nose, remaining, capture, segments,
            cost_to_go, distance, origin, cell, inner, soft, weights, sums[:read],
        )  # fmt: skip
        for i in range(count):
            u = low + (high - low) * i / (count - 1)
            if u > limits[j] or is_oscillating(v * u, w * u, trend, slow) or (rotates and v * u > slow):
                continue
            nearness = contact_nearness(contacts[j] / u, horizon) if u > 0.0 else 0.0
            costs[j, i] = (
                mean_until(sums, u * horizon / step) + weights[CONTACT] * nearness + weights[TURNING] * abs(w * u)
            )
