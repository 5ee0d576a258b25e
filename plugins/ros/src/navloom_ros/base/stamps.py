"""Estimates when the data of a ROS message were measured, on this host's monotonic clock.

The clocks of the robot and of this host are never compared. The age of a message is its delay relative to the fastest
recent message of its topic, plus the age of its data when it was sent, which is a difference on the robot's own clock.
"""

from __future__ import annotations

__all__ = ["Delays"]

WINDOW_NS = 30_000_000_000
"""Half of the window, ns, over which the fastest message is sought: the last 30 to 60 s, so that clocks may drift."""
OLDEST_NS, AHEAD_NS = 1_000_000_000, 50_000_000
"""Largest age of data when sent, and largest lead of their stamp, ns; beyond, the stamp is from another clock."""
KNOWN_NS = 60_000_000_000
"""The same age, ns, on a topic that had stamps of its publisher's clock: such data are old."""


class Delays:
    """Delays of the messages of one topic. A stamp that is not from the publisher's clock is ignored."""

    def __init__(self) -> None:
        self._least_ns: int | None = None
        self._before_ns = 0
        self._since_ns = 0
        self._sent_ns = 0
        self._is_known = False
        self._first = (0, 0)

    def measured_ns(self, stamp_ns: int, sent_ns: int, arrived_ns: int) -> int:
        """When the data of a message were measured, on this host's monotonic clock.

        Args:
            stamp_ns: Stamp of its header, on the robot's clock; 0 for none.
            sent_ns: When it was sent, on the robot's clock.
            arrived_ns: When it arrived, on this host's monotonic clock.
        """
        at_ns = arrived_ns - self._late_ns(sent_ns, arrived_ns) - self._age_ns(stamp_ns, sent_ns)
        return self._at_first_ns(stamp_ns, at_ns)

    def measured_by_clock_ns(self, stamp_ns: int, clock_ns: int, arrived_ns: int) -> int:
        """The same for a simulated robot, whose /clock showed `clock_ns` when the message arrived."""
        return self._at_first_ns(stamp_ns, arrived_ns - self._age_ns(stamp_ns, clock_ns))

    def _late_ns(self, sent_ns: int, arrived_ns: int) -> int:
        """Delay beyond that of the fastest recent message."""
        delay_ns = arrived_ns - sent_ns
        if self._least_ns is None or sent_ns < self._sent_ns:  # the first, or the robot's clock was set back
            self._least_ns = self._before_ns = delay_ns
            self._since_ns = arrived_ns
        elif arrived_ns - self._since_ns > WINDOW_NS:
            self._before_ns, self._least_ns, self._since_ns = self._least_ns, delay_ns, arrived_ns
        self._least_ns, self._sent_ns = min(self._least_ns, delay_ns), sent_ns
        # Of two windows: a new one has few messages at first, and its minimum would be too large.
        return delay_ns - min(self._least_ns, self._before_ns)

    def _age_ns(self, stamp_ns: int, sent_ns: int) -> int:
        age_ns = sent_ns - stamp_ns
        if -AHEAD_NS <= age_ns <= (KNOWN_NS if self._is_known else OLDEST_NS):
            self._is_known = True
            return max(0, age_ns)
        return 0

    def _at_first_ns(self, stamp_ns: int, at_ns: int) -> int:
        """The time of the first message with the same stamp: a driver that hangs may repeat its last data."""
        if not stamp_ns or stamp_ns != self._first[0]:
            self._first = stamp_ns, at_ns
        return self._first[1]
