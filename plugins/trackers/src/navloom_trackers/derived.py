"""Parameters of the pursuit laws that follow from the limits and lags of the robot. None of them is from a paper."""

from __future__ import annotations

import math

__all__ = ["PHASE_MARGIN", "braking_approach", "margin_look_ahead"]

PHASE_MARGIN = math.radians(30.0)
"""Phase margin of the lateral loop, rad: more lengthens the look-ahead, which cuts bends; less leaves less room for a
delay that is longer than told. The loop of `graceful` becomes unstable at 1.7 times the told delay."""


def margin_look_ahead(late: float, damping: float, stiffness: float) -> float:
    """Look-ahead per speed, s, with which a late lateral loop keeps `PHASE_MARGIN`.

    With a look-ahead of T seconds, small errors on a line follow s² + a s + b, in units of 1/T: a = b = 2 for pure
    pursuit. The open loop (a s + b) / s² crosses 1 at u² = (a² + sqrt(a⁴ + 4 b²)) / 2, with the margin
    atan(a u / b). A delay of τ takes τ u / T of it.

    Args:
        late: τ, from an estimate to the motion that answers it, s.
        damping, stiffness: a and b, such that atan(a u / b) is greater than the margin that is to be kept.
    """
    u = math.sqrt(0.5 * (damping**2 + math.sqrt(damping**4 + 4.0 * stiffness**2)))
    return late * u / (math.atan(damping * u / stiffness) - PHASE_MARGIN)


def braking_approach(speed: float, deceleration: float) -> float:
    """Distance D, m, within which v d / D brakes at most at the deceleration, m/s²: v² / D where it begins."""
    return speed * speed / deceleration
