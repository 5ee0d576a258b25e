"""Inverse sensor models: the evidence of one reading for the occupancy of a point, as log odds.

A beam affects the cells on its axis (Thrun, Burgard & Fox 2005, Probabilistic Robotics, table 9.2). A cone affects all
cells within its opening, with the profiles of Moravec & Elfes 1985, High resolution maps from wide angle sonar.
"""

from __future__ import annotations

import math

from numba import njit

__all__ = ["beam_spans", "cone_log_odds", "log_odds", "probability"]


def log_odds(p: float) -> float:
    """l = log(p / (1 - p)), 0 < p < 1 (Thrun et al. 2005, eq. 4.14)."""
    return math.log(p / (1.0 - p))


@njit(cache=True, nogil=True, error_model="numpy")
def probability(odds):  # type: ignore[no-untyped-def]
    """p = 1 - 1 / (1 + exp l) (Thrun et al. 2005, eq. 4.15)."""
    return 1.0 - 1.0 / (1.0 + math.exp(odds))


@njit(cache=True, nogil=True, error_model="numpy")
def beam_spans(reading, range_min, reach, thickness, clear_margin):  # type: ignore[no-untyped-def]
    """Free and occupied intervals on a beam's axis: table 9.2 with α = `thickness`.

    Args:
        reading: Measured range, m; more than `reach` means that the beam is free up to `reach`.
        range_min: A reading up to this may come from something nearer and clears nothing, m.
        reach: A reading gives no evidence beyond this, m.
        thickness: Depth of an obstacle along the beam, m.
        clear_margin: Length before the obstacle for which there is no evidence, m.

    Returns:
        End of the free interval, m, which begins at the sensor; begin and end of the occupied interval, m. If there is
        none, its end is less than its begin.
    """
    if reading > reach:
        return reach, 0.0, -1.0
    near = max(0.0, reading - 0.5 * thickness)
    free = 0.0 if reading <= range_min else max(0.0, near - clear_margin)
    return free, near, reading + 0.5 * thickness


@njit(cache=True, nogil=True, error_model="numpy")
def cone_log_odds(distance, angle, reading, half_angle, range_min, reach, depth, hit, passed):  # type: ignore[no-untyped-def]
    """Log odds that a cone's reading R gives for a point at δ, θ.

    Before the echo: `passed` E_r E_a with E_r = 1 - ((δ - R_min) / (R - ε - R_min))², and E_r = 1 up to R_min. At the
    echo, up to ε before and behind it: `hit` O_r O_a with O_r = 1 - ((δ - R) / ε)². E_a = O_a = 1 - (2 θ / ω)².
    Elsewhere 0.

    Args:
        distance, angle: δ, m, from the apex, and θ >= 0, rad, from the axis.
        reading: R, m; more than `reach` means no echo: the cone is free up to `reach` and nothing is occupied.
        half_angle: ω / 2, rad.
        range_min: R_min, m. A reading up to this may come from something nearer and clears nothing.
        reach: A reading gives no evidence beyond this, m.
        depth: ε, m.
        hit, passed: Log odds on the axis, on the arc and right in front of the sensor.
    """
    if angle >= half_angle:
        return 0.0
    across = 1.0 - (angle / half_angle) ** 2
    has_echo = reading <= reach
    if has_echo and abs(distance - reading) < depth:
        return hit * (1.0 - ((distance - reading) / depth) ** 2) * across
    end = reading - depth if has_echo else reach
    if distance >= end or (has_echo and reading <= range_min):
        return 0.0
    if distance <= range_min:
        return passed * across
    return passed * (1.0 - ((distance - range_min) / (end - range_min)) ** 2) * across
