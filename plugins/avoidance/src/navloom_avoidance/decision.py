"""Decision of a histogram-based or force-based avoider in one tick."""

from __future__ import annotations

from typing import Literal, NamedTuple

__all__ = ["Decision"]


class Decision(NamedTuple):
    """Answer of one tick.

    Attributes:
        speed: Forward speed, m/s.
        turn: Turn rate, rad/s.
        status: As in the Avoider role.
        direction: Chosen direction, rad, pose frame; None while rotating or trapped.
        why: Explanation in one phrase.
    """

    speed: float
    turn: float
    status: Literal["clear", "steering", "trapped"]
    direction: float | None
    why: str
