"""The way that odometry took: poses by time, and whether the platform began again."""

from __future__ import annotations

import math
from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from navloom.messages import Odometry

__all__ = ["OdometryTrack"]

Floats = NDArray[np.float64]

# Faster than any robot that this track is for, so that only a restart exceeds them.
JUMP, FASTEST = 0.3, 5.0
"""Odometry that jumps farther than JUMP, m, plus FASTEST, m/s, times the elapsed time: the platform restarted."""
TURN, FASTEST_TURN = 0.5, 10.0
"""The same for its heading, rad and rad/s."""
SILENT = 1.0
"""A longer gap in the odometry, s, also counts as a restart: the robot may have been moved meanwhile."""
BACK = 1.0
"""An odometry stamp that goes back by more than this, s, also counts as a restart."""


class OdometryTrack:
    """Newest poses by odometry.

    Attributes:
        stamps: Their times, s, oldest first.
        poses: x, y, m, and unwrapped heading, rad.
        ways: Way travelled up to each, m.
        twist: (3,) newest forward speed, m/s, turn rate, rad/s, and speed to the left, m/s.
    """

    def __init__(self) -> None:
        self.stamps: list[float] = []
        self.poses: list[tuple[float, float, float]] = []
        self.ways: list[float] = []
        self.twist = np.zeros(3)

    def add(self, odometry: Odometry) -> bool:
        """Take odometry; False if it is not newer than the last: it comes again in ticks without a newer one."""
        pose, time = odometry.pose, odometry.stamp_ns * 1e-9
        if self.stamps and time <= self.stamps[-1]:
            return False
        heading, way = pose.heading, 0.0
        if self.poses:
            x, y, last = self.poses[-1]
            # Unwrapped, because headings are interpolated between two stamps.
            heading = last + math.remainder(heading - last, math.tau)
            way = self.ways[-1] + math.hypot(pose.x - x, pose.y - y)
        self.stamps.append(time)
        self.poses.append((pose.x, pose.y, heading))
        self.ways.append(way)
        self.twist[:] = odometry.twist.vx, odometry.twist.wz, odometry.twist.vy
        # Half at once, since deleting from the front of a list costs its whole length.
        if len(self.stamps) > 512:
            del self.stamps[:256], self.poses[:256], self.ways[:256]
        return True

    def begins_again(self, odometry: Odometry, period: float) -> bool:
        """Whether the platform restarted: the odometry was silent, jumps, or its clock went back by more than BACK.

        Args:
            odometry: The newest.
            period: Control tick, s.
        """
        if not self.stamps:
            return False
        pose, (x, y, heading) = odometry.pose, self.poses[-1]
        passed = odometry.stamp_ns * 1e-9 - self.stamps[-1]
        jumps = math.hypot(pose.x - x, pose.y - y) > JUMP + FASTEST * abs(passed) or (
            abs(math.remainder(pose.heading - heading, math.tau)) > TURN + FASTEST_TURN * abs(passed)
        )
        return passed < -BACK or passed > max(SILENT, 5.0 * period) or (passed > 0.0 and jumps)

    def last_before(self, time: float, later: float = 0.0) -> int:
        """Index of the last pose up to a time, s, or to `later`, s, after it; 0 if all are later."""
        return max(0, bisect_right(self.stamps, time + later) - 1)

    def at(self, times: Floats) -> Floats:
        """(n, 3) poses of the base, odometry frame, at times, s; extrapolated by twist after the newest odometry."""
        newest = self.stamps[-1]
        if len(times) and times.min() == times.max() and times[0] in self.stamps[-4:]:
            pose = self.poses[len(self.stamps) - 1 - self.stamps[::-1].index(times[0])]
            same = np.empty((len(times), 3))
            same[:] = pose
            return same
        start = self.last_before(float(times.min()) if len(times) else newest)
        stamps, poses = np.array(self.stamps[start:]), np.array(self.poses[start:])
        inside = np.clip(times, stamps[0], newest)
        found = np.stack([np.interp(inside, stamps, poses[:, k]) for k in range(3)], axis=1)
        # Beams at the end of a scan may be later than the newest odometry.
        late = np.maximum(times - newest, 0.0)
        found[:, 0] += late * self.twist[0] * np.cos(found[:, 2])
        found[:, 1] += late * self.twist[0] * np.sin(found[:, 2])
        if self.twist[2]:
            found[:, 0] -= late * self.twist[2] * np.sin(found[:, 2])
            found[:, 1] += late * self.twist[2] * np.cos(found[:, 2])
        found[:, 2] += late * self.twist[1]
        return found
