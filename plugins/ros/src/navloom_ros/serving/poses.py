"""Reads RViz's /initialpose: a pose that an operator sets for the localizer."""

from __future__ import annotations

import math

from navloom_ros.node import Node
from navloom_ros.serving.goals import place_of

__all__ = ["Poses"]


class Poses:
    """Poses set by an operator on the ROS network.

    Args:
        node: Node that subscribes.
        frame: Frame that poses must be given in.
    """

    def __init__(self, node: Node, frame: str) -> None:
        self._frame = frame
        self._poses = node.subscription("/initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped")

    def take(self) -> tuple[float, float, float] | None:
        """The newest valid pose since the last call, x, y, m, heading, rad; None if there is none."""
        newest = None
        while (received := self._poses.take()) is not None:
            message = received.message
            place = place_of(message.pose.pose)
            fits = message.header.frame_id.lstrip("/") in ("", self._frame) and place.heading is not None
            if fits and math.isfinite(place.x) and math.isfinite(place.y):
                newest = place.x, place.y, place.heading or 0.0
        return newest
