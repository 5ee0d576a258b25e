"""Converts device clocks to this host's clock, by the message with the shortest delay."""

from __future__ import annotations

from collections import deque

__all__ = ["ClockOffset"]

DRIFT = 200e-6
"""Largest drift of a device's clock, s/s: twice the tolerance of a quartz."""
BACK_NS = 100_000_000
"""Backward jump of a stamp from which the device counts as restarted, ns; reordered datagrams jump by less."""


class ClockOffset:
    """Converts times of a device's clock to times of this host's monotonic clock.

    The delay of a message is never negative. So the smallest difference between arrival time and stamp is the offset
    of the clocks plus the shortest delay. It is taken over a window, because clocks drift.

    Args:
        window: Time for which a difference is used, s.
        modulus_ns: Period at which the device's clock wraps, ns, as 2**32 * 1000 for 32 bits of µs; 0 for never.

    Attributes:
        restarts: Number of times the device's clock jumped back, as after a power cycle.
    """

    def __init__(self, window: float = 10.0, modulus_ns: int = 0) -> None:
        self._window_ns, self._modulus_ns = round(window * 1e9), modulus_ns
        self.restarts = 0
        self._least: deque[tuple[int, int]] = deque()
        self._last: tuple[int, int] | None = None
        self._wraps_ns = self._newest_ns = 0

    def local(self, device_ns: int, received_ns: int) -> int:
        """Time of a device's stamp on this host's clock, ns: never after its receipt, and never decreasing.

        Args:
            device_ns: The stamp, ns.
            received_ns: Receive time of its message, monotonic clock, ns.
        """
        if self._last is not None:
            self._follow(device_ns, received_ns)
        device_ns += self._wraps_ns
        self._last = device_ns, received_ns
        difference = received_ns - device_ns
        # A queue whose differences rise: its first one is the minimum of the window, without a search.
        while self._least and self._least[-1][1] >= difference:
            self._least.pop()
        self._least.append((received_ns, difference))
        while self._least[0][0] < received_ns - self._window_ns:
            self._least.popleft()
        at_ns, least = self._least[0]
        # An old minimum may be off by the drift since then.
        drifted = round(DRIFT * (received_ns - at_ns))
        stamp_ns = min(received_ns, device_ns + min(difference, least + drifted))
        # A better minimum shifts the clock back, but stamps of a stream must not fall.
        self._newest_ns = max(self._newest_ns, stamp_ns)
        return self._newest_ns

    @property
    def offset_ns(self) -> int:
        """Local time minus device time, ns; 0 before the first stamp."""
        return self._least[0][1] if self._least else 0

    def _follow(self, device_ns: int, received_ns: int) -> None:
        """Detect a wrap or a restart in the next stamp."""
        assert self._last is not None
        before_ns, then_ns = self._last
        if self._modulus_ns:
            expected_ns = before_ns + received_ns - then_ns
            turns = round((expected_ns - device_ns) / self._modulus_ns)
            self._wraps_ns = turns * self._modulus_ns
        if device_ns + self._wraps_ns < before_ns - BACK_NS:
            self.restarts += 1
            self._least.clear()
            self._wraps_ns = 0
