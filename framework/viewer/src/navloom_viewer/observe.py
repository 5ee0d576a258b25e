"""Observes lockstep runs for a viewer: collects messages in the tick and passes them on between ticks."""

from __future__ import annotations

from collections.abc import Callable

from navloom.messages import Envelope, Message, StepRecord

from navloom_viewer.drawing import Shown

__all__ = ["Gathering"]


class Gathering:
    """An observer that costs only a list append in the tick; `drain` passes the collected messages on.

    Args:
        variant: Name of the run in the picture.
        take: Called with every message, in order, by `drain`.
    """

    wants: frozenset[tuple[str, str]] | None = None
    wants_steps = False

    def __init__(self, variant: str, take: Callable[[Shown], None]) -> None:
        self.variant, self.take = variant, take
        self._kept: list[Shown] = []

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        """Store a message; messages are immutable."""
        self._kept.append(Shown(self.variant, role, instance, active, port, message, at.tick, at.stamp_ns))

    def on_step(self, record: StepRecord) -> None:
        """Never called: `wants_steps` is false."""

    def drain(self) -> None:
        """Pass the collected messages on. Call it between ticks, so that it does not count as part of one."""
        kept, self._kept = self._kept, []
        for shown in kept:
            self.take(shown)
