"""Standard deviations of a guessed pose."""

from __future__ import annotations

import math

__all__ = ["GUESS", "sigma_of"]

GUESS = (0.5, 15.0)
"""Standard deviations, m and degrees, of a guessed place that gives only the other one: RViz's 2D Pose Estimate."""


def sigma_of(spread: float | None, heading_spread_deg: float | None) -> tuple[float, float] | None:
    """Standard deviations, m and rad, of a place with these spreads, m and degrees; None if neither is given."""
    if spread is None and heading_spread_deg is None:
        return None
    turn = GUESS[1] if heading_spread_deg is None else heading_spread_deg
    return GUESS[0] if spread is None else spread, math.radians(turn)
