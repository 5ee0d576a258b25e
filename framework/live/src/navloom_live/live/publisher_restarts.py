"""Tells a publisher that restarted from a late message and from a second publisher, by sequence numbers."""

from __future__ import annotations

import time

from navloom.messages import Envelope

from navloom_live.timing import LATE_LIMIT, RIVAL_WINDOW

__all__ = ["BACKWARDS", "RestartWatch", "RivalWatch"]

BACKWARDS = 200
"""Largest step back, in ticks, of a message that is merely late; a larger one means that the run clock restarted."""

SWITCHES = 3
"""How often messages must change between two publishers that both go on: a restart is one change, without a return."""

OTHER_CLOCK_NS = 10_000_000_000
"""Age against the newest message from which a message follows another run clock, ns."""
_LATE_NS = round(LATE_LIMIT * 1e9)


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


class RivalWatch:
    """Finds out that two processes publish one stream: the sequence numbers of both go on, in turns.

    A process that restarts begins a new sequence, and the old one does not continue. Messages that a broken link has
    delayed are left out: they come in turns with newer ones, too.
    """

    def __init__(self) -> None:
        self._newest, self._stamps_ns = [0, 0], [-1, -1]
        self._of = 0
        self._switches: list[float] = []
        self._latest_ns = 0

    def note(self, sequence: int, stamp_ns: int) -> None:
        """Take the sequence number and the stamp of a message."""
        behind_ns = self._latest_ns - stamp_ns
        if _LATE_NS < behind_ns < OTHER_CLOCK_NS:
            return
        self._latest_ns = stamp_ns if behind_ns >= OTHER_CLOCK_NS else max(stamp_ns, self._latest_ns)
        newest, other = self._newest, 1 - self._of
        if sequence in newest:
            apart_ns = abs(stamp_ns - self._stamps_ns[newest.index(sequence)])
            if 0 < apart_ns < _LATE_NS:  # not the same message by two links, nor that of a process that has restarted
                self._switch()
            if apart_ns < _LATE_NS:
                return
        ahead, other_ahead = sequence - newest[self._of], sequence - newest[other]
        goes_on = newest[other] > 0 and other_ahead > 0
        if ahead < 0 or (goes_on and other_ahead < ahead):
            if goes_on:
                self._switch()
            self._of = other
        newest[self._of], self._stamps_ns[self._of] = sequence, stamp_ns

    def _switch(self) -> None:
        self._switches = [*self._switches[1 - SWITCHES :], time.monotonic()]

    @property
    def is_split(self) -> bool:
        """Whether two processes publish the stream."""
        return len(self._switches) == SWITCHES and time.monotonic() - self._switches[0] < RIVAL_WINDOW
