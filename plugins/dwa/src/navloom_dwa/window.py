"""The dynamic window V_d and the velocities that can be stopped in time, V_a: Fox, Burgard & Thrun 1997."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def reachable(now: float, least: float, greatest: float, up: float, down: float, time: float) -> tuple[float, float]:
    """V_d in one dimension: the allowed speeds that can be reached within a time.

    Args:
        now: Current speed, m/s (rad/s). least, greatest: Bounds of the allowed speeds, same unit.
        up, down: Rates of change towards higher and lower speeds, per s. time: s.

    Returns:
        Lowest and highest speed; if no allowed speed can be reached, the nearest allowed speed twice.
    """
    low = min(greatest, max(least, now - down * time))
    return low, max(low, min(greatest, now + up * time))


@njit(cache=True, nogil=True)
def stoppable_speed(distance: float, deceleration: float, reaction: float) -> float:
    """V_a in one dimension: the highest speed from which a robot stops within a distance.

    v t + v^2 / (2 b) = d gives v = sqrt(b^2 t^2 + 2 b d) - b t; the paper has t = 0, v = sqrt(2 d b).

    Args:
        distance: d, m (rad). deceleration: b, m/s^2 (rad/s^2). reaction: t, time before it brakes, s.
    """
    if math.isinf(distance):
        return np.inf
    lost = deceleration * reaction
    return math.sqrt(lost * lost + 2.0 * deceleration * max(0.0, distance)) - lost


@njit(cache=True, nogil=True)
def within(low: float, high: float, slope: float, least: float, greatest: float) -> tuple[float, float]:
    """The part of [low, high] of u for which least <= slope u <= greatest."""
    if slope == 0.0:
        return (low, high) if least <= 0.0 <= greatest else (1.0, 0.0)
    first, second = least / slope, greatest / slope
    return max(low, min(first, second)), min(high, max(first, second))


@njit(cache=True, nogil=True)
def sample_arcs(
    window: tuple[float, float, float, float],
    lever: float,
    half_track: float,
    rim_speed: float,
    arcs: NDArray[np.float64],
) -> None:
    """Sample the window with arcs: rays from (0, 0) of the (v, w) plane, evenly spread over the window's angles.

    All velocities on one ray drive the same arc at different speeds, so contacts are computed once per ray.

    Args:
        window: Lowest and highest v, m/s, >= 0, and w, rad/s.
        lever: m; u = hypot(v, lever w) is the speed along a ray.
        half_track: m. rim_speed: Highest speed of a wheel, m/s: |v| + half_track |w|.
        arcs: (m, 4), filled in: v and w for u = 1, lowest and highest u; the lowest is above the highest where a ray
            misses the window. If straight ahead is within the window's angles, the ray nearest to it is moved onto it.
    """
    v_low, v_high, w_low, w_high = window
    least, most = np.inf, -np.inf
    for v in (v_low, v_high):
        for w in (w_low, w_high):
            angle = math.atan2(lever * w, v)
            least, most = min(least, angle), max(most, angle)
    count = arcs.shape[0]
    step = (most - least) / (count - 1)
    middle = round(-least / step) if step > 0.0 and least <= 0.0 <= most else -1
    for j in range(count):
        angle = 0.0 if j == middle else least + step * j
        v, w = math.cos(angle), math.sin(angle) / lever
        if abs(v) < 1.0e-9:
            v = 0.0
        low, high = within(0.0, rim_speed / (abs(v) + half_track * abs(w)), v, v_low, v_high + 1.0e-9)
        low, high = within(low, high, w, w_low - 1.0e-9, w_high + 1.0e-9)
        arcs[j, 0], arcs[j, 1], arcs[j, 2], arcs[j, 3] = v, w, low, high
