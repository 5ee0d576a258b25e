"""Reads Nav2's /speed_limit, and limits the robot's speed by its gate."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from navloom_ros.node import Node

__all__ = ["SpeedLimits"]


class SpeedLimits:
    """The newest limit of the ROS network, which outlasts a restart of the robot.

    Args:
        node: Node that subscribes.
        failures: Exceptions of the robot for a limit that it refuses, or does not get.
        say: Shows a line to the user, once for each reason why there is no limit.
    """

    def __init__(self, node: Node, failures: tuple[type[Exception], ...], say: Callable[[str], None]) -> None:
        self._failures, self._say, self._said = failures, say, ""
        self._limits = node.subscription("speed_limit", "nav2_msgs/msg/SpeedLimit")
        self._asked: tuple[float, bool] = 0.0, False
        self._is_new = False

    def take(self, robot: Any, repeats: bool) -> None:
        """Pass on a new limit; with `repeats` also an old one, which a restarted gate does not have."""
        while (received := self._limits.take()) is not None:
            self._asked, self._is_new = (received.message.speed_limit, received.message.percentage), True
        if not (self._is_new or (repeats and self._asked[0] > 0.0)):
            return
        self._is_new = False
        try:
            robot.limit_speed(*self._asked)
            self._said = ""
        except self._failures as error:
            if self._said != str(error):
                self._said = str(error)
                self._say(f"speed limit not set: {error}")
