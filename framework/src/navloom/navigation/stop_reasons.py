"""Reasons of the gate's stops, as its status carries them. Tools read them without the gate and its kernels."""

from __future__ import annotations

__all__ = ["ENDING", "HIDING", "LEFT", "OBSTACLE", "RIVALS", "WAITING", "is_at_rest"]

OBSTACLE = "obstacle"
"""Reason of a stop for an obstacle ahead."""
ENDING = "ending"
"""Reason of the last stop of a gate that shuts down normally."""
LEFT = "stale: operator"
"""Beginning of the reason while a driving operator is silent: no other source drives until `resume`."""
WAITING = "waits: "
"""Beginning of the reason while a node of the chain waits for the first message of an input."""
RIVALS = "rivals: "
"""Beginning of the reason while two processes publish one of the streams that the gate decides on."""
HIDING = ("silent: platform", "silent: sensor")
"""Beginnings of reasons that take precedence over a silent operator."""


def is_at_rest(reason: str) -> bool:
    """Whether a stop for this reason interrupts no drive: there is nothing to drive yet, or no longer."""
    return reason in ("no_trajectory", ENDING) or reason.startswith(WAITING)
