"""The critics of Nav2's DWB controller, one function each, and their sum over the window.

Costs are in metres of path to the target, so that weights are plain factors. The distance critics use the mean over
the horizon instead of DWB's last pose: of two arcs with the same end, the one that gets near sooner is better.
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
SAMPLES = 24  # number of samples along an arc at which the critics score
A_LITTLE_MORE = 1.0 + 1.0e-9  # tolerance, so that rounding of squares decides nothing
GOAL_DISTANCE, GOAL_ALIGN, PATH_DISTANCE, PATH_ALIGN, OBSTACLE, CONTACT, TURNING = range(7)


@njit(cache=True, nogil=True)
def goal_distance(cost_to_go: Counts, origin: Cells, cell: float, x: float, y: float) -> float:
    """Cost, m, of the path around known obstacles from a place, m, pose frame, to the target.

    At the nose it is the goal align critic.
    """
    return field_value(cost_to_go, origin, cell, x, y) * cell / UNIT


@njit(cache=True, nogil=True)
def segments_of(path: Floats) -> Floats:
    """(k - 1, 5) segments of a polyline (k, 2), m: start x, y, vector x, y, m, and squared length, m²."""
    segments = np.empty((max(0, path.shape[0] - 1), 5))
    for k in range(segments.shape[0]):
        dx, dy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3] = path[k, 0], path[k, 1], dx, dy
        segments[k, 4] = dx * dx + dy * dy
    return segments


@njit(cache=True, nogil=True, error_model="numpy")
def path_distance(segments: Floats, x: float, y: float) -> float:
    """Distance, m, of a place from a polyline of segments_of(), in the same frame. At the nose: the path align critic.

    Squared distances find the nearest segment. Where rounding could confuse two squares, distances are compared.
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
    """Nearness of obstacles: 1 where the inscribed disc touches one, 0 from `soft` beyond the disc on.

    Args:
        clearance: Distance of the base to the nearest obstacle, m. inner: Radius of the inscribed disc, m. soft: m.
    """
    return min(1.0, max(0.0, 1.0 - (clearance - inner) / soft))


@njit(cache=True, nogil=True)
def contact_nearness(contact: float, horizon: float) -> float:
    """Nearness of a contact: 1 for a contact now, 0 for one beyond the horizon; both s."""
    return max(0.0, 1.0 - contact / horizon)


@njit(cache=True, nogil=True)
def is_oscillating(v: float, w: float, trend: int, slow: float) -> bool:
    """Whether a velocity reverses the last turn in place: v below `slow`, m/s, and w against the sign `trend`."""
    return v < slow and w * trend < 0.0


@njit(cache=True, nogil=True)
def must_rotate(distance: float, bearing: float, within: float, allowed: float) -> bool:
    """Rotate to goal: whether the robot, near the target, m, must turn to it, rad, before it drives on."""
    return distance < within and abs(bearing) > allowed


@njit(cache=True, nogil=True)
def beyond_target(way: float, remaining: float) -> float:
    """Cost, m, beyond a target that is not the goal: it falls with the way driven past it, m, up to `remaining`, m."""
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
    """Compute the running sum of the critics along an arc at u = 1; they keep their values from the contact on.

    Args:
        v, w: Velocity for u = 1, m/s and rad/s. contact: Time of contact at u = 1, s. step: Time between samples, s.
        pose: Pose of the base in the pose frame. target: m, base frame.
        nose: The align critics score this far ahead of the base, m, or at the distance of the target if that is less.
        remaining: Length of the path after the target, m. capture: The target is passed when nearer than this, m.
        segments: From segments_of(), pose frame. cost_to_go, distance, origin, cell: From field.fill_field().
        inner, soft: As for obstacle_nearness(). weights: (7,). sums: (k,), filled in: sums[i] over samples 0 .. i.
    """
    heading = pose[2]
    c, s = math.cos(heading), math.sin(heading)
    total, passed, way, value, last = 0.0, -1.0, 0.0, 0.0, -1.0
    for i in range(sums.size):
        # After the contact the robot stands: the critics keep their last values.
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
        # A target that is only a point of the path is driven through, not approached.
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
    """Mean of the samples up to the fractional index `last`; sums are interpolated linearly between two samples."""
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
    """Compute the cost of each velocity of the window.

    Args:
        arcs, limits, contacts: As for objective.score_1997(). target: m, base frame. horizon: s.
        trend: Sign of the last turn in place, 0 for no restriction. slow: See is_oscillating().
        path: (k, 2), pose frame, m. rotation: `within`, m, and `allowed`, rad, of must_rotate().
        costs: (m, n), filled in; +inf where not admissible.
        The others: As for arc_profile().
    """
    count = costs.shape[1]
    # A window of zero speed would make the step zero.
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
        # No speed of the arc needs a sum beyond that of its highest speed.
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
