"""Linear programmes in the plane, and the one in three dimensions where the plane's is infeasible.

van den Berg, Guy, Lin & Manocha 2011, section 5, by the incremental method of de Berg et al., Computational Geometry
(2008), chapter 4. A half plane is a row (x, y, dx, dy): a point of its border, m/s, and the unit direction of the
border; permitted is what lies to the left of it. Velocities stay in a disc of radius `fastest` about 0.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
PARALLEL = 1.0e-12
"""Sine of the angle below which two borders count as parallel, no unit."""
RELAXED = 1.0e-9
"""Width of what contradicting obstacles leave, m/s: more than rounding, so that the programme finds it."""


@njit(cache=True, nogil=True)
def violation(planes: Floats, i: int, x: float, y: float) -> float:
    """How far a velocity (x, y) is beyond the border of half plane i, m/s; negative where it is permitted."""
    return float(planes[i, 2] * (planes[i, 1] - y) - planes[i, 3] * (planes[i, 0] - x))


@njit(cache=True, nogil=True, error_model="numpy")
def on_border(
    planes: Floats, i: int, fastest: float, wanted_x: float, wanted_y: float, is_direction: bool
) -> tuple[bool, float, float]:
    """The best velocity on the border of half plane i that half planes 0 to i - 1 and the disc permit.

    Args:
        planes: (n, 4). i: Row. fastest: m/s.
        wanted_x, wanted_y: Wanted velocity, m/s; with `is_direction`, the unit direction to go far in.

    Returns:
        Whether there is one, and it, m/s.
    """
    px, py, dx, dy = planes[i, 0], planes[i, 1], planes[i, 2], planes[i, 3]
    middle = -(px * dx + py * dy)
    across = px * dy - py * dx
    inside = fastest * fastest - across * across
    if inside < 0.0:
        return False, 0.0, 0.0
    half = math.sqrt(inside)
    low, high = middle - half, middle + half
    for j in range(i):
        slope = dx * planes[j, 3] - dy * planes[j, 2]
        beyond = planes[j, 2] * (py - planes[j, 1]) - planes[j, 3] * (px - planes[j, 0])
        if abs(slope) <= PARALLEL:
            if beyond < 0.0:
                return False, 0.0, 0.0
            continue
        if slope > 0.0:
            high = min(high, beyond / slope)
        else:
            low = max(low, beyond / slope)
        if low > high:
            return False, 0.0, 0.0
    t = wanted_x * dx + wanted_y * dy
    if is_direction:
        t = high if t > 0.0 else low
    else:
        t = min(max(t + middle, low), high)
    return True, px + t * dx, py + t * dy


@njit(cache=True, nogil=True)
def nearest_permitted(
    planes: Floats, count: int, fastest: float, wanted_x: float, wanted_y: float, is_direction: bool
) -> tuple[int, float, float]:
    """The permitted velocity that is nearest to the wanted one, m/s, or that is the farthest in a direction.

    Args:
        planes: (>= count, 4), of which the first `count` are used. The others: As for on_border().

    Returns:
        Half planes that could be satisfied in their order: `count` if all can; and the best velocity of these.
    """
    x, y = wanted_x, wanted_y
    if is_direction:
        x, y = wanted_x * fastest, wanted_y * fastest
    else:
        speed = math.hypot(x, y)
        if speed > fastest:
            x, y = x / speed * fastest, y / speed * fastest
    for i in range(count):
        if violation(planes, i, x, y) > 0.0:
            is_found, on_x, on_y = on_border(planes, i, fastest, wanted_x, wanted_y, is_direction)
            if not is_found:
                return i, x, y
            x, y = on_x, on_y
    return count, x, y


@njit(cache=True, nogil=True)
def least_violation(
    planes: Floats, count: int, hard: int, begin: int, fastest: float, x: float, y: float, scratch: Floats
) -> tuple[float, float]:
    """The velocity whose greatest violation of the half planes is least: the linear programme in three dimensions.

    Half planes 0 to hard - 1 are not violated, as long as a velocity permits all of them.

    Args:
        planes: (>= count, 4). count: Rows in use.
        hard: Number of half planes that may not be violated, in the first rows.
        begin: First half plane that cannot be satisfied. x, y: Best velocity of those before it; nearest_permitted().
        fastest: m/s. scratch: (>= count, 4), overwritten.
    """
    least = 0.0
    for i in range(begin, count):
        if violation(planes, i, x, y) <= least:
            continue
        for j in range(hard):
            scratch[j, 0], scratch[j, 1] = planes[j, 0], planes[j, 1]
            scratch[j, 2], scratch[j, 3] = planes[j, 2], planes[j, 3]
        rows = hard
        # Half planes of the velocities that violate j less than i.
        for j in range(hard, i):
            slope = planes[i, 2] * planes[j, 3] - planes[i, 3] * planes[j, 2]
            if abs(slope) <= PARALLEL:
                if planes[i, 2] * planes[j, 2] + planes[i, 3] * planes[j, 3] > 0.0:
                    continue
                px, py = 0.5 * (planes[i, 0] + planes[j, 0]), 0.5 * (planes[i, 1] + planes[j, 1])
            else:
                t = planes[j, 2] * (planes[i, 1] - planes[j, 1]) - planes[j, 3] * (planes[i, 0] - planes[j, 0])
                px, py = planes[i, 0] + t / slope * planes[i, 2], planes[i, 1] + t / slope * planes[i, 3]
            dx, dy = planes[j, 2] - planes[i, 2], planes[j, 3] - planes[i, 3]
            size = math.hypot(dx, dy)
            scratch[rows, 0], scratch[rows, 1] = px, py
            scratch[rows, 2], scratch[rows, 3] = dx / size, dy / size
            rows += 1
        met, on_x, on_y = nearest_permitted(scratch, rows, fastest, -planes[i, 3], planes[i, 2], True)
        # With rounding alone, none is found; then the velocity so far is the best.
        if met == rows:
            x, y = on_x, on_y
        least = violation(planes, i, x, y)
    return x, y


@njit(cache=True, nogil=True)
def best_velocity(
    planes: Floats, count: int, firm: int, hard: int, fastest: float, wanted_x: float, wanted_y: float, scratch: Floats
) -> tuple[float, float]:
    """The permitted velocity nearest to the wanted one, m/s, or the one of least violation where none is permitted.

    Violations go by rank. Limits of the robot are never violated; lines of obstacles only where they contradict each
    other within the limits, and then all by the same least amount; half planes of agents come last.

    Args:
        planes: (>= count, 4), in order of rank; those of obstacles move where they contradict each other.
        count: Rows in use. firm: Number of rows of limits, which some velocity permits.
        hard: Number of rows of limits and obstacles. fastest, wanted_x, wanted_y: m/s.
        scratch: (>= count, 4), overwritten.
    """
    met, x, y = nearest_permitted(planes, count, fastest, wanted_x, wanted_y, False)
    if met < hard:
        x, y = least_violation(planes, hard, firm, met, fastest, x, y, scratch)
        least = 0.0
        for i in range(firm, hard):
            least = max(least, violation(planes, i, x, y))
        for i in range(firm, hard):
            planes[i, 0] += (least + RELAXED) * planes[i, 3]
            planes[i, 1] -= (least + RELAXED) * planes[i, 2]
        met, x, y = nearest_permitted(planes, count, fastest, wanted_x, wanted_y, False)
    if met < count:
        return least_violation(planes, count, hard, met, fastest, x, y, scratch)
    return x, y
