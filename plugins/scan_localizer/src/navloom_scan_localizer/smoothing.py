"""The pose that is reported while the robot drives: no jumps."""

from __future__ import annotations

import math

import numpy as np
from navloom_scans.poses import compose, pose_of, relative
from numpy.typing import NDArray

__all__ = ["SmoothPose"]

Floats = NDArray[np.float64]

_AT_REST = (0.02, 0.02)
"""Speed of odometry, m/s, and its turn rate, rad/s, below which the robot stands, as for the metrics."""
_FAR = (0.5, math.radians(15.0))
"""Correction that is too large to be spread, m and rad."""


class SmoothPose:
    """Follows a pose by odometry and by corrections of limited size.

    Attributes:
        pose: (3,) x, y, m, heading, rad, map frame.
        behind: (3,) what it still lacks to the pose that it follows, m, m, rad, map frame.
    """

    def __init__(self, pose: Floats, odometry: Floats) -> None:
        self.pose, self._odometry = pose.copy(), odometry.copy()
        self.behind = np.zeros(3)
        self._is_at_rest = True

    def follow(
        self, pose: Floats, odometry: Floats, time: float, limits: tuple[float, float], *, at_once: bool
    ) -> bool:
        """Move by odometry, then towards a pose by at most the limits, m and rad; to it if `at_once` or at rest.

        Args:
            pose: (3,) pose to follow. odometry: (3,) odometry pose. time: Time since the last call, s.
            limits: Largest correction, m and rad.
            at_once: Whether there is no limit.

        Returns:
            False if the correction was too large to be spread: the pose is then reached at once.
        """
        step, self._odometry = relative(self._odometry, odometry), odometry.copy()
        moved = compose(self.pose, step)
        x, y, turn = pose[0] - moved[0], pose[1] - moved[1], math.remainder(pose[2] - moved[2], math.tau)
        way = math.hypot(x, y)
        # The same odometry message again says nothing.
        if time > 0.0:
            self._is_at_rest = math.hypot(step[0], step[1]) < _AT_REST[0] * time and abs(step[2]) < _AT_REST[1] * time
        is_far = way > _FAR[0] or abs(turn) > _FAR[1]
        if at_once or self._is_at_rest or is_far:
            self.pose, self.behind = pose.copy(), np.zeros(3)
            return at_once or self._is_at_rest
        share = min(1.0, limits[0] / max(way, 1e-12), limits[1] / max(abs(turn), 1e-12))
        shift = np.array([x, y, turn])
        self.pose = pose_of(*(moved + share * shift).tolist()) if share < 1.0 else pose.copy()
        self.behind = (1.0 - share) * shift
        return True
