"""Recent odometry: how the robot has moved since a scan that arrives late."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from navloom_scans.poses import relative

__all__ = ["OdometryTrail"]

Floats = NDArray[np.float64]


class OdometryTrail:
    """The odometry of the last moments.

    Args:
        length: Age of the oldest pose that is kept, s.
        period: Age up to which the velocity of the newest odometry serves, s: a tick.
    """

    def __init__(self, length: float, period: float) -> None:
        self._length_ns, self._period_ns = round(1e9 * length), round(1e9 * period)
        self._stamps: deque[int] = deque()
        self._poses: deque[Floats] = deque()

    def add(self, stamp_ns: int, pose: Floats) -> None:
        """Take the newest pose, (3,) x, y, m, heading, rad, odometry frame."""
        if self._stamps and stamp_ns <= self._stamps[-1]:  # the run clock restarted
            self._stamps.clear()
            self._poses.clear()
        self._stamps.append(stamp_ns)
        self._poses.append(pose)
        # One pose older than the length stays, for the time between two poses.
        while len(self._stamps) > 2 and self._stamps[1] < stamp_ns - self._length_ns:
            self._stamps.popleft()
            self._poses.popleft()

    def velocity_since(self, stamp_ns: int, velocity: Floats) -> Floats:
        """The constant velocity, (3,) m/s, rad/s, base frame, that leads from the pose at a stamp, ns, to the newest.

        Args:
            stamp_ns: Stamp of the scan.
            velocity: (3,) that of the newest odometry; returned for a stamp of this tick, and for one before the trail.
        """
        newest_ns = self._stamps[-1]
        if stamp_ns >= newest_ns - self._period_ns or stamp_ns < self._stamps[0]:
            return velocity
        place = next(i for i in range(len(self._stamps) - 1, -1, -1) if self._stamps[i] <= stamp_ns)
        before, after = self._poses[place], self._poses[place + 1]
        share = (stamp_ns - self._stamps[place]) / (self._stamps[place + 1] - self._stamps[place])
        then = before + share * (after - before)
        then[2] = before[2] + share * math.remainder(after[2] - before[2], math.tau)
        x, y, turn = relative(self._poses[-1], then).tolist()
        time, half = (stamp_ns - newest_ns) * 1e-9, 0.5 * turn
        # Inverse of the arc in `beams.beam_points`: its chord lies at half the turn.
        chord = time * (math.sin(half) / half if abs(half) > 1e-8 else 1.0)
        c, s = math.cos(half), math.sin(half)
        return np.array([(c * x + s * y) / chord, (c * y - s * x) / chord, turn / time])
