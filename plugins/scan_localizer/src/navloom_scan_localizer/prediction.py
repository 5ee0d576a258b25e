"""Hands the framework's odometry to a tracker."""

from __future__ import annotations

import numpy as np
from navloom import Odometry, Pose2D, Twist2D
from numpy.typing import NDArray

from navloom_scan_localizer.tracking import PoseTracker

__all__ = ["predict", "row"]


def predict(tracker: PoseTracker, odometry: Odometry, since_ns: int, period_ns: int) -> float:
    """Move the pose by the odometry since a stamp; the time since then, s."""
    # Before the first step, a tick at most has passed, whatever the run clock shows: a robot may have run for days.
    since_ns = since_ns or max(0, odometry.stamp_ns - period_ns)
    passed = (odometry.stamp_ns - since_ns) / 1e9
    tracker.predict(row(odometry.pose), passed)
    return passed


def row(given: Pose2D | Twist2D) -> NDArray[np.float64]:
    """(3,) x, y, heading of a pose, or vx, vy, wz of a velocity."""
    if isinstance(given, Pose2D):
        return np.array([given.x, given.y, given.heading])
    return np.array([given.vx, given.vy, given.wz])
