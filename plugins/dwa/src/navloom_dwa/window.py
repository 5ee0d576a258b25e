"""The dynamic window and what of it can be stopped in time: Fox, Burgard & Thrun 1997, V_d and V_a."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def reachable(now: float, least: float, greatest: float, up: float, down: float, time: float) -> tuple[float, float]:
    """V_d in one dimension: what can be reached within a time, and is allowed.

    Args:
        now: Present speed, m/s (rad/s). least, greatest: Allowed, same unit.
        up, down: Change towards higher and lower speeds, per s. time: s.

    Returns:
        Lowest and highest speed; where nothing allowed can be reached, the nearest that is allowed, twice.
    """
    low = min(greatest, max(least, now - down * time))
    return low, max(low, min(greatest, now + up * time))


@njit(cache=True, nogil=True)
def stoppable_speed(distance: float, deceleration: float, reaction: float) -> float:
    """V_a in one dimension: the highest speed from which a robot stops within a distance.

    v t + v^2 / (2 b) = d gives v = sqrt(b^2 t^2 + 2 b d) - b t; the paper has t = 0, v = sqrt(2 d b).

    Args:
        distance: d, m (rad). deceleration: b, m/s^2 (rad/s^2). reaction: t, s, before it brakes.
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
    """Fill the window with arcs: rays through (0, 0) of the (v, w) plane, evenly spread over the angles it is seen in.

    All velocities of one ray drive the same arc, at other speeds: what is in the way is found once for all of them.

    Args:
        window: Lowest and highest v, m/s, >= 0, and w, rad/s.
        lever: m; u = hypot(v, lever w) is the speed that counts along a ray.
        half_track: m. rim_speed: Highest speed of a wheel, m/s: |v| + half_track |w|.
        arcs: (m, 4), filled: v and w for u = 1, lowest and highest u; the lowest is above the highest where a ray
            does not meet the window. The ray nearest to straight ahead, if it is among them, is straight ahead.
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
