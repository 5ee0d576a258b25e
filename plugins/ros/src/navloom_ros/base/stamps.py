"""When a ROS message was measured, on the clock of this host.

The clocks of a robot and of this host are never compared. What counts is how much longer than the quickest message of
its topic a message took, and how old its data were when it was sent, both by the robot's own clock.
"""

from __future__ import annotations

__all__ = ["Delays"]

WINDOW_NS = 5_000_000_000
"""The quickest message is one of the last 5 to 10 s, so that clocks may drift."""
STEP_NS = 1_000_000_000
"""A delay that grows by more is a clock that was set."""
OLDEST_NS, AHEAD_NS = 1_000_000_000, 50_000_000
"""Age of data when they are sent, and how far their stamp may be ahead of that; else the stamp is of another clock."""


class Delays:
    """Of the messages of one topic.

    Attributes:
        odd: Messages whose stamp was of another clock than their publisher's; they count as measured when sent.
    """

    def __init__(self) -> None:
        self.odd = 0
        self._least_ns: int | None = None
        self._before_ns = 0
        self._since_ns = 0

    def measured_ns(self, stamp_ns: int, sent_ns: int, arrived_ns: int) -> int:
        """When it was measured, on this host's monotonic clock.

        Args:
            stamp_ns: Of its header, on the robot's clock; 0 where it has none.
            sent_ns: When it was sent, on the robot's clock.
            arrived_ns: When it arrived, on this host's monotonic clock.
        """
        return arrived_ns - self._late_ns(sent_ns, arrived_ns) - self._age_ns(stamp_ns, sent_ns)

    def measured_by_clock_ns(self, stamp_ns: int, clock_ns: int, arrived_ns: int) -> int:
        """The same of a simulated robot, whose clock showed `clock_ns` when the message arrived."""
        return arrived_ns - self._age_ns(stamp_ns, clock_ns)

    def _late_ns(self, sent_ns: int, arrived_ns: int) -> int:
        """How much longer than the quickest it took."""
        delay_ns = arrived_ns - sent_ns
        if self._least_ns is None or delay_ns - min(self._least_ns, self._before_ns) > STEP_NS:
            self._least_ns = self._before_ns = delay_ns
            self._since_ns = arrived_ns
        elif arrived_ns - self._since_ns > WINDOW_NS:
            self._before_ns, self._least_ns, self._since_ns = self._least_ns, delay_ns, arrived_ns
        self._least_ns = min(self._least_ns, delay_ns)
        return delay_ns - min(self._least_ns, self._before_ns)

    def _age_ns(self, stamp_ns: int, sent_ns: int) -> int:
        age_ns = sent_ns - stamp_ns
        if -AHEAD_NS <= age_ns <= OLDEST_NS:
            return max(0, age_ns)
        self.odd += stamp_ns != 0
        return 0
