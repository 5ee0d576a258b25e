"""The platform's clock as known in another process: its newest stamp plus the time since that arrived."""

from __future__ import annotations

import time
from collections.abc import Callable

__all__ = ["RunClock"]


class RunClock:
    """Follows the run clock by the platform's stamps. It uses only differences of this host's own monotonic clock.

    Args:
        monotonic_ns: This host's monotonic clock, ns; kept as an attribute.
    """

    def __init__(self, monotonic_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self.monotonic_ns = monotonic_ns
        self._newest = (-1, 0, -1)

    def observe(self, stamp_ns: int, arrived_ns: int, tick: int) -> None:
        """Take the stamp of a platform output that arrived."""
        # One tuple, replaced as a whole: other threads read it without a lock.
        self._newest = (stamp_ns, arrived_ns, tick)

    @property
    def is_known(self) -> bool:
        """Whether a platform output has arrived."""
        return self._newest[2] >= 0

    @property
    def tick(self) -> int:
        """Tick of the newest platform output; -1 before the first."""
        return self._newest[2]

    @property
    def stamp_ns(self) -> int:
        """Stamp of the newest platform output; -1 before the first."""
        return self._newest[0]

    def now_ns(self) -> int:
        """What the platform's clock shows now, transport delay neglected, ns; -1 before the first platform output."""
        stamp, arrived, tick = self._newest
        # Another thread may have noted a later arrival than this one's clock reading.
        return -1 if tick < 0 else stamp + max(0, self.monotonic_ns() - arrived)

    def silence_s(self) -> float:
        """Time since the newest platform output arrived, s; 0 before the first."""
        _, arrived, tick = self._newest
        return 0.0 if tick < 0 else (self.monotonic_ns() - arrived) * 1e-9

    def age_s(self, cause_ns: int) -> float | None:
        """Age of a platform stamp, s; None before the first platform output."""
        return None if not self.is_known else (self.now_ns() - cause_ns) * 1e-9
