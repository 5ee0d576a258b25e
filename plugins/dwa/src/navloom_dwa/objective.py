"""Objective over the velocities of the window: Fox, Burgard & Thrun 1997."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@njit(cache=True, nogil=True)
def arc_pose(v: float, w: float, time: float) -> tuple[float, float, float]:
    """x, y, m, and heading, rad, in the frame of the start, after a time, s, at v, m/s, and w, rad/s: exact."""
    half = 0.5 * w * time
    chord = v * time * (math.sin(half) / half if abs(half) > 1.0e-8 else 1.0)
    return chord * math.cos(half), chord * math.sin(half), 2.0 * half


@njit(cache=True, nogil=True)
def heading_term(v: float, w: float, time: float, v_brake: float, w_brake: float, x: float, y: float) -> float:
    """heading(v, w): 1 where the robot will face the target, 0 where it will face away from it.

    The pose is predicted as in the paper: the robot keeps the velocity for one interval and then brakes, which adds
    v / (2 b) s at v to the way, and likewise to the turn.

    Args:
        v, w: m/s, rad/s. time: Length of the interval, s. v_brake, w_brake: Decelerations, m/s^2, rad/s^2.
        x, y: Target, m, base frame.
    """
    way, turn = v * time + 0.5 * v * abs(v) / v_brake, w * time + 0.5 * w * abs(w) / w_brake
    px, py, heading = arc_pose(way, turn, 1.0)
    off = math.atan2(y - py, x - px) - heading
    off = abs((off + math.pi) % (2.0 * math.pi) - math.pi)
    return 1.0 - off / math.pi


@njit(cache=True, nogil=True)
def distance_term(distance: float, farthest: float) -> float:
    """dist(v, w): distance along the arc to the next obstacle, m, over the farthest that counts, m; at most 1.

    The distance is measured with u = hypot(v, lever w), see window.sample_arcs(), so that turns in place have one too.
    """
    return min(1.0, distance / farthest)


@njit(cache=True, nogil=True)
def velocity_term(v: float, v_max: float) -> float:
    """velocity(v, w): the forward speed over the highest."""
    return v / v_max


@njit(cache=True, nogil=True)
def smooth(values: Floats, smoothed: Floats) -> None:
    """sigma(): mean of each value and its admissible neighbours in the window.

    Args:
        values: (m, n), by arc and speed; -inf is not admissible and stays -inf. smoothed: (m, n), filled in.
    """
    arcs, speeds = values.shape
    for j in range(arcs):
        for i in range(speeds):
            total, count = 0.0, 0
            for dj in range(max(0, j - 1), min(arcs, j + 2)):
                for di in range(max(0, i - 1), min(speeds, i + 2)):
                    if values[dj, di] > -np.inf:
                        total += values[dj, di]
                        count += 1
            # Inadmissible velocities take no part, or they would make their neighbours worse.
            smoothed[j, i] = total / count if values[j, i] > -np.inf else -np.inf


@njit(cache=True, nogil=True)
def score_1997(
    arcs: Floats,
    limits: Floats,
    contacts: Floats,
    target: tuple[float, float],
    interval: float,
    v_brake: float,
    w_brake: float,
    v_max: float,
    farthest: float,
    weights: tuple[float, float, float],
    costs: Floats,
) -> None:
    """Compute costs as the negative of G(v, w) = sigma(alpha heading + beta dist + gamma velocity).

    Args:
        arcs: (m, 4), from window.sample_arcs(). limits: (m,), highest admissible u of each arc.
        contacts: (m,), first contact at u = 1, s. target: m, base frame. farthest: m, see distance_term().
        weights: alpha, beta, gamma. costs: (m, n), filled in; +inf where not admissible.
    """
    count = costs.shape[1]
    values = np.full(costs.shape, -np.inf)
    for j in range(arcs.shape[0]):
        v, w, low, high = arcs[j, 0], arcs[j, 1], arcs[j, 2], arcs[j, 3]
        distance = distance_term(contacts[j], farthest)
        for i in range(count):
            u = low + (high - low) * i / (count - 1)
            if low > high or u > limits[j]:
                continue
            heading = heading_term(v * u, w * u, interval, v_brake, w_brake, target[0], target[1])
            values[j, i] = weights[0] * heading + weights[1] * distance + weights[2] * velocity_term(v * u, v_max)
    smooth(values, costs)
    for j in range(arcs.shape[0]):
        for i in range(count):
            costs[j, i] = -costs[j, i]
