"""How long the gate waits for the commands of a tick, and the tick rate that a duration allows."""

from __future__ import annotations

__all__ = ["LEAD", "held_rate", "hold"]

HOLD, HOLD_MOST, HOLD_LEAST = 0.4, 0.8, 0.008
"""Wait for a tick's commands: share of the period; largest share, of short periods; shortest wait, s."""

LEAD = 2
"""Ticks by which a live gate announces a selection, so that every host knows it when it begins to apply."""


def hold(period: float) -> float:
    """How long after a platform stamp the gate waits for the commands of its tick, s.

    With a longer wait, a robot with ticks of 50 ms would stop for one late command: by the late decision the command
    of the previous tick would be stale.
    """
    return min(HOLD_MOST * period, max(HOLD * period, HOLD_LEAST))


def held_rate(seconds: float) -> float:
    """Largest tick rate, Hz, at which commands that take `seconds` are waited for: the inverse of `hold`."""
    return (HOLD_MOST if seconds <= HOLD_LEAST else HOLD) / seconds
