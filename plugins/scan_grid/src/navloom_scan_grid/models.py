"""Inverse sensor models: what one reading says of a place, as log odds.

A beam speaks of the cells on its axis (Thrun, Burgard & Fox 2005, Probabilistic Robotics, table 9.2), a cone of all
cells in its opening, with the profiles of Moravec & Elfes 1985, High resolution maps from wide angle sonar.
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
    """Which stretch of a beam's axis is free, and which is occupied: table 9.2 with α = `thickness`.

    Args:
        reading: m; more than `reach` says that nothing stands within it.
        range_min: A reading of no more may be of something nearer, m: it frees nothing.
        reach: Farther than this a reading says nothing, m.
        thickness: Depth of an obstacle along the beam, m.
        clear_margin: Stretch before the obstacle of which nothing is said, m.

    Returns:
        End of the free stretch, m, which begins at the sensor; begin and end of the occupied one, m, the end before
        the begin where there is none.
    """
    if reading > reach:
        return reach, 0.0, -1.0
    near = max(0.0, reading - 0.5 * thickness)
    free = 0.0 if reading <= range_min else max(0.0, near - clear_margin)
    return free, near, reading + 0.5 * thickness


@njit(cache=True, nogil=True, error_model="numpy")
def cone_log_odds(distance, angle, reading, half_angle, range_min, reach, depth, hit, passed):  # type: ignore[no-untyped-def]
    """What a cone's reading R says of a place at δ, θ, as log odds.

    Before the echo `passed` E_r E_a with E_r = 1 - ((δ - R_min) / (R - ε - R_min))², 1 up to R_min; at the echo, up
    to ε before and behind it, `hit` O_r O_a with O_r = 1 - ((δ - R) / ε)²; E_a = O_a = 1 - (2 θ / ω)². Nothing
    elsewhere.

    Args:
        distance, angle: δ, m, from the apex, and θ >= 0, rad, from the axis.
        reading: R, m; more than `reach` is no echo: R = `reach` and nothing is occupied.
        half_angle: ω / 2, rad.
        range_min: R_min, m. A reading of no more may be of something nearer and frees nothing.
        reach: Farther than this a reading says nothing, m.
        depth: ε, m.
        hit, passed: Log odds of a place on the arc, and right before the sensor, on the axis.
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
