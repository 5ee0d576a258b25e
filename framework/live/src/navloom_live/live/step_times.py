"""Durations of a node's newest steps, recorded where they run, for run statistics."""

from __future__ import annotations

import numpy as np

__all__ = ["KEPT", "StepTimes"]

KEPT = 4096
"""Number of recorded steps."""


class StepTimes:
    """Ticks and durations of the newest steps of one node. One thread writes, any may read."""

    def __init__(self) -> None:
        self._kept = np.zeros((KEPT, 2), dtype=np.int64)
        self._steps = 0

    def note(self, tick: int, spent_ns: int) -> None:
        """Record a step."""
        self._kept[self._steps % KEPT] = tick, spent_ns
        # After the row, so that a reader never counts one that is not written.
        self._steps += 1

    def newest(self, most: int = KEPT) -> list[tuple[int, int]]:
        """(tick, ns) of at most `most` steps, oldest first."""
        places = np.arange(max(0, self._steps - min(most, KEPT)), self._steps) % KEPT
        return [(int(tick), int(spent)) for tick, spent in self._kept[places]]
