"""Reasons of the gate's stops, as its status carries them. Tools read them without the gate and its kernels."""

from __future__ import annotations

__all__ = ["ENDING", "HIDING", "LEFT", "NO_ROOM", "OBSTACLE", "ORDINARY", "RIVALS", "WAITING", "is_at_rest"]

OBSTACLE = "obstacle"
"""Reason of a stop for an obstacle ahead."""
NO_ROOM = "no room to turn"
"""Reason of a stop for something beside a robot that is to turn on the spot."""
ENDING = "ending"
"""Reason of the last stop of a gate that shuts down normally."""
LEFT = "stale: operator"
"""Beginning of the reason while a driving operator is silent: no other source drives until `resume`."""
WAITING = "waits: "
"""Beginning of the reason while a node of the chain waits for the first message of an input."""
ORDINARY = ("operator", "no_trajectory", WAITING)
"""Beginnings of the reasons of ordinary stops: an operator's stop, and nothing to drive. The latter covers a goal that
was reached, cancelled or ended in any other way, a drive that pauses or waits for a new plan, and an operator who
releases the robot."""
RIVALS = "rivals: "
"""Beginning of the reason while two processes publish one of the streams that the gate decides on."""
HIDING = ("silent: platform", "silent: sensor")
"""Beginnings of reasons that take precedence over a silent operator."""


def is_at_rest(reason: str) -> bool:
    """Whether a stop for this reason interrupts no drive: there is nothing to drive yet, or no longer."""
    return reason in ("no_trajectory", ENDING) or reason.startswith(WAITING)
