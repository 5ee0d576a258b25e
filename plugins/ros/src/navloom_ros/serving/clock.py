"""The time that `navloom ros serve` stamps messages with: this host's, or that of the robot's simulator."""

from __future__ import annotations

from navloom_ros.node import Node
from navloom_ros.qos import Qos
from navloom_ros.times import ns_of
from navloom_ros.topics import Subscription
from navloom_ros.wire import epoch_ns

__all__ = ["Clock"]

_NEWEST = Qos(depth=1)


class Clock:
    """Gives `node` its time.

    Args:
        node: Node whose `now_ns` becomes that of this clock.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._shown: Subscription | None = None
        self._now_ns = 0
        node.now_ns = self.now_ns

    def follow(self, is_simulated: bool) -> None:
        """Follow /clock, or this host's clock."""
        if is_simulated and self._shown is None:
            self._shown = self._node.subscription("/clock", "rosgraph_msgs/msg/Clock", _NEWEST)
        if not is_simulated and self._shown is not None:
            self._shown.close()
            self._shown = None

    def wait(self, timeout: float) -> bool:
        """Wait for a time, at most `timeout` s, since /clock may have no message yet; whether there is one."""
        if self._shown is not None and not self._now_ns and (received := self._shown.take(timeout)) is not None:
            self._now_ns = ns_of(received.message.clock)
        return self.now_ns() > 0

    def now_ns(self) -> int:
        """The time, ns; 0 before the first message on /clock, as nodes of ROS have it."""
        if self._shown is None:
            return epoch_ns()
        # The newest one, without extrapolation: a stamp ahead of /clock has no transform yet.
        while (received := self._shown.take()) is not None:
            self._now_ns = ns_of(received.message.clock)
        return self._now_ns
