"""Where an operator says that the robot is: RViz's /initialpose."""

from __future__ import annotations

import math

from navloom_ros.node import Node
from navloom_ros.serving.goals import place_of

__all__ = ["Poses"]


class Poses:
    """Takes poses from a ROS network.

    Args:
        node: Where they are read.
        frame: The only frame that they may be given in.
    """

    def __init__(self, node: Node, frame: str) -> None:
        self._frame = frame
        self._poses = node.subscription("/initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped")

    def take(self) -> tuple[float, float, float] | None:
        """The newest pose since the last call, m and rad; None where none has come that can be used."""
        newest = None
        while (received := self._poses.take()) is not None:
            message = received.message
            place = place_of(message.pose.pose)
            fits = message.header.frame_id.lstrip("/") in ("", self._frame) and place.heading is not None
            if fits and math.isfinite(place.x) and math.isfinite(place.y):
                newest = place.x, place.y, place.heading or 0.0
        return newest
