"""Looking on at lockstep runs: what is to be drawn is gathered in the tick, and handed on between ticks."""

from __future__ import annotations

from collections.abc import Callable

from navloom.messages import Envelope, Message, StepRecord
from navloom.viewer.drawing import Shown

__all__ = ["Gathering"]


class Gathering:
    """An observer that costs a tick no more than a list's append; `drain` takes what has come since.

    Args:
        variant: Name of the run in the picture.
        take: Given every message, in order, by `drain`.
    """

    wants: frozenset[tuple[str, str]] | None = None
    wants_steps = False

    def __init__(self, variant: str, take: Callable[[Shown], None]) -> None:
        self.variant, self.take = variant, take
        self._kept: list[Shown] = []

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        """Keep it: messages never change."""
        self._kept.append(Shown(self.variant, role, instance, active, port, message, at.tick, at.stamp_ns))

    def on_step(self, record: StepRecord) -> None:
        """Not asked for."""

    def drain(self) -> None:
        """Hand on what has come; between ticks, where it costs none of them anything."""
        kept, self._kept = self._kept, []
        for shown in kept:
            self.take(shown)
