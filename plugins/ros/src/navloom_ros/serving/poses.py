"""Reads RViz's /initialpose: a pose that an operator sets for the localizer."""

from __future__ import annotations

import math
from collections.abc import Callable

from navloom_ros.node import Node
from navloom_ros.serving.goals import NO_HEADING, place_of

__all__ = ["Poses"]


class Poses:
    """Poses set by an operator on the ROS network.

    Args:
        node: Node that subscribes.
        frame: Frame that poses must be given in.
        say: Shows a line to the user: why a pose was refused.
    """

    def __init__(self, node: Node, frame: str, say: Callable[[str], None]) -> None:
        self._frame, self._say = frame, say
        self._poses = node.subscription("initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped")

    def take(self) -> tuple[float, float, float] | None:
        """The newest valid pose since the last call, x, y, m, heading, rad; None if there is none."""
        newest = None
        while (received := self._poses.take()) is not None:
            message = received.message
            place = place_of(message.pose.pose)
            frame = message.header.frame_id
            if frame.lstrip("/") not in ("", self._frame):
                self._say(f"pose refused: it is in the frame {frame!r}: expected {self._frame!r}")
            elif not (math.isfinite(place.x) and math.isfinite(place.y)):
                self._say(f"pose refused: its place {place.x:g}, {place.y:g} m is not finite")
            elif place.heading is None:
                self._say(f"pose refused: {NO_HEADING}")
            else:
                newest = place.x, place.y, place.heading
        return newest
