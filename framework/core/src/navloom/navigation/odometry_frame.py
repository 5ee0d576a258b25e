"""The place of the odometry frame in the map, which jumps when the robot is carried or its wheels spin."""

from __future__ import annotations

import math

from navloom.messages import Pose2D

__all__ = ["OdometryFrame"]

CARRIED, KEPT = 0.5, 3.0
"""Distance of a pose from where odometry led within KEPT, s, or while the localizer did not track, from which the robot
was carried, m: odometry that is 10 % wrong leads 0.15 m off in that time at 0.5 m/s."""


class OdometryFrame:
    """Compares the poses of a localizer that tracks with where odometry leads."""

    def __init__(self) -> None:
        self._place: tuple[float, float, float, float] | None = None
        """Time, s, heading, rad, and x, y, m, of the odometry frame in the map, some seconds ago."""

    def jumps(self, time: float, pose: Pose2D, odometry: tuple[float, float, float]) -> bool:
        """Whether a pose at a time, s, is not where odometry, x, y, m, heading, rad, at that time led."""
        x, y, _ = odometry
        place = _place_of(time, pose, odometry)
        since, turn, ox, oy = self._place or place
        cos, sin = math.cos(turn), math.sin(turn)
        is_carried = math.dist((ox + cos * x - sin * y, oy + sin * x + cos * y), (pose.x, pose.y)) > CARRIED
        if is_carried or self._place is None or time > since + KEPT:
            self._place = place
        return is_carried


def _place_of(time: float, pose: Pose2D, odometry: tuple[float, float, float]) -> tuple[float, float, float, float]:
    """Time, heading and place of the odometry frame in the map, by a pose and the odometry of the same time."""
    x, y, heading = odometry
    turn = pose.heading - heading
    cos, sin = math.cos(turn), math.sin(turn)
    return time, turn, pose.x - cos * x + sin * y, pose.y - sin * x - cos * y
