"""What an avoider of a histogram or of forces decides in one tick."""

from __future__ import annotations

from typing import Literal, NamedTuple

__all__ = ["Decision"]


class Decision(NamedTuple):
    """Answer of one tick; directions in the pose frame, rad.

    Attributes:
        speed: m/s.
        turn: rad/s.
        status: As the Avoider role names it.
        direction: Steered to, or None while rotating or trapped.
        why: One phrase.
    """

    speed: float
    turn: float
    status: Literal["clear", "steering", "trapped"]
    direction: float | None
    why: str
