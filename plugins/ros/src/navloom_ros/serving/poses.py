"""Takes where the robot is from ROS: RViz's /initialpose, and AMCL's service that has it search anywhere."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from navloom_ros.node import Node
from navloom_ros.services import Call
from navloom_ros.serving.goals import NO_HEADING, place_of

__all__ = ["Estimate", "Poses"]

SEARCH = "reinitialize_global_localization"
"""Service of AMCL: forget the pose, and search on the whole map."""
X, Y, YAW = 0, 7, 35
"""Places of the variances in the covariance of a pose, 6 × 6 by rows."""


class Estimate(NamedTuple):
    """A pose, x, y, m, heading, rad; and its standard deviations, m and rad, None for an exact one."""

    x: float
    y: float
    heading: float
    sigma: tuple[float, float] | None = None


class Poses:
    """Poses set by an operator on the ROS network.

    Args:
        node: Node that subscribes.
        frame: Frame that poses must be given in.
        failures: What the robot's client raises if a request is refused, or not answered.
        say: Shows a line to the user: why a pose was refused.

    Attributes:
        robot: The robot, a `Navigator`; None while it is down.
    """

    def __init__(
        self, node: Node, frame: str, failures: tuple[type[Exception], ...], say: Callable[[str], None]
    ) -> None:
        self.robot: Any = None
        self._frame, self._failures, self._say = frame, failures, say
        node.service(SEARCH, "std_srvs/srv/Empty", self._search)
        self._poses = node.subscription("initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped")

    def _search(self, call: Call) -> None:
        robot = self.robot
        if robot is None:
            call.drop()
            return
        try:
            robot.relocalise()
        except self._failures as error:  # as from a localizer that cannot search
            self._say(f"search refused: {error}")
            call.drop()
        else:
            call.answer()

    def take(self) -> Estimate | None:
        """The newest valid pose since the last call; None if there is none."""
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
                newest = Estimate(place.x, place.y, place.heading, _sigma(message.pose.covariance))
        return newest


def _sigma(covariance: Any) -> tuple[float, float] | None:
    """Standard deviations, m and rad; None for a covariance without variances, which says nothing."""
    place, turn = max(float(covariance[X]), float(covariance[Y])), float(covariance[YAW])
    is_guess = 0.0 < place < math.inf and 0.0 < turn < math.inf
    return (math.sqrt(place), math.sqrt(turn)) if is_guess else None
