"""Tells a publisher that restarted from a message that is only late, by sequence numbers and ticks."""

from __future__ import annotations

from navloom.messages import Envelope

__all__ = ["BACKWARDS", "RestartWatch"]

BACKWARDS = 200
"""Largest step back, in ticks, of a message that is merely late; a larger one means that the run clock restarted."""


class RestartWatch:
    """Follows the envelopes of one key."""

    def __init__(self) -> None:
        self._newest: Envelope | None = None

    def has_restarted(self, at: Envelope) -> bool:
        """Whether the publisher restarted between the newest message and this one; a late message is not a restart."""
        newest = self._newest
        if newest is not None and newest.tick - BACKWARDS < at.tick <= newest.tick:
            return False
        self._newest = at
        return newest is not None and at.sequence < newest.sequence
