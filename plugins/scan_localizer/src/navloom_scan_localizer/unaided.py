"""Motion of a robot whose odometry is missing: the velocity between scans predicts, in its place."""

from __future__ import annotations

import math

import numpy as np
from navloom_scans.poses import compose, relative
from navloom_scans.small import inverse
from numpy.typing import NDArray

__all__ = ["UnaidedMotion", "are_unanimous", "hold_unseen"]

Floats = NDArray[np.float64]

_SMOOTHING = 0.1
"""Time over which the velocity is averaged, s: longer than a period of fast scanners, shorter than a manoeuvre."""
_MOVED, _TURNED = 0.03, math.radians(2.0)
"""Motion that scans must show while odometry stands still, m and rad: several times the error of a fit."""
_WITNESSES = 2
"""Scans in a row that must show it: a person who passes close to the scanner disturbs one."""
_AGREE = 16.3
"""Square of the Mahalanobis distance of two poses below which they are the same: all but 0.1 % of chi square."""

_UNSEEN = 0.04
"""Share of the information along the walls in that across them below which it is noise of the surfaces' normals."""


def are_unanimous(first: Floats, first_covariance: Floats, second: Floats, second_covariance: Floats) -> bool:
    """Whether two poses, (3,), with covariances, (3, 3), found from different beams of a scan, are the same.

    All that stands still shows one motion of the robot; bodies that move each show another one.
    """
    gap = relative(first, second)
    gap[:2] = second[:2] - first[:2]
    return bool(gap @ inverse(first_covariance + second_covariance) @ gap < _AGREE)


def hold_unseen(pose: Floats, covariance: Floats, prior: Floats, prior_covariance: Floats) -> tuple[Floats, Floats]:
    """The pose, (3,), and covariance, (3, 3), of a scan, with the prior's place where the scan shows none.

    Along a bare corridor the noise of the surfaces looks like a little information, always that the robot rests
    (solution remapping of Zhang, Kaess and Singh 2016).
    """
    seen = inverse(covariance) - inverse(prior_covariance)
    half, cross = 0.5 * (seen[0, 0] - seen[1, 1]), seen[0, 1]
    middle, radius = 0.5 * (seen[0, 0] + seen[1, 1]), math.hypot(half, cross)
    if middle - radius >= _UNSEEN * (middle + radius):
        return pose, covariance
    # The axis of least information is square to that of most.
    bearing = 0.5 * math.atan2(cross, half) + 0.5 * math.pi
    x, y = math.cos(bearing), math.sin(bearing)
    shift, held = (pose[0] - prior[0]) * x + (pose[1] - prior[1]) * y, np.array([x, y, 0.0])
    along = np.outer(held, held)
    lost = max(0.0, float((along * (prior_covariance - covariance)).sum()))
    return pose - shift * held, covariance + lost * along


class UnaidedMotion:
    """Recognizes that odometry is missing, and estimates the velocity from the poses at the scans.

    Attributes:
        is_possible: Whether odometry has not moved yet, so that it may be missing.
        is_certain: Whether odometry is missing: it has not moved, and scans show that the robot has.
        is_proven: Whether surfaces that stand still have shown it.
        start: (3,) x, y, m, heading, rad, map frame, at which the robot began.
        witnesses: Scans in a row that show motion, while odometry stands still.
        velocity: (3,) vx, vy, m/s, wz, rad/s, base frame.
    """

    def __init__(self) -> None:
        self.is_possible, self.is_certain, self.is_proven = True, False, False
        self.velocity: Floats = np.zeros(3)
        self._odometry: Floats | None = None
        self.place(np.zeros(3))

    def place(self, pose: Floats) -> None:
        """Begin at a pose, (3,) x, y, m, heading, rad, map frame; whether odometry is missing stays known."""
        self.witnesses, self.start, self._last, self._time = 0, pose, pose, 0.0
        self.stop()

    def see_odometry(self, pose: Floats, twist: Floats) -> None:
        """Take the pose, (3,), odometry frame, and velocity, (3,), of odometry: once it moves, it is not missing."""
        first = self._odometry = pose if self._odometry is None else self._odometry
        if twist.any() or (pose != first).any():
            self.is_possible = self.is_certain = False

    def is_away(self, pose: Floats, covariance: Floats) -> bool:
        """Whether a pose, (3,), with its covariance, (3, 3), map frame, is not the one at which the robot began."""
        away, spread = relative(self.start, pose), 4.0 * np.sqrt(covariance.diagonal())
        has_moved = math.hypot(away[0], away[1]) > max(_MOVED, spread[0], spread[1])
        return bool(has_moved or abs(away[2]) > max(_TURNED, spread[2]))

    def see_pose(self, pose: Floats, time: float, is_witness: bool) -> None:
        """Take the pose, (3,), of a scan, map frame, found without odometry, at a time, s; whether it shows motion."""
        self.witnesses = self.witnesses + 1 if is_witness else 0
        self.is_certain = self.is_certain or self.witnesses >= _WITNESSES
        self.velocity = self.velocity_at(pose, time)
        self._last, self._time = pose, time

    def stop(self) -> None:
        """Take the velocity as 0, since the scans no longer show it: a turn would go on for ever."""
        self.velocity = np.zeros(3)

    def pose_at(self, time: float) -> Floats:
        """The pose, (3,), m, rad, map frame, at a time, s, if the velocity has stayed the same since the last scan."""
        return compose(self._last, self.velocity * max(0.0, time - self._time))

    def velocity_at(self, pose: Floats, time: float) -> Floats:
        """The velocity, (3,), if the robot is at a pose, (3,), map frame, at a time, s."""
        passed = time - self._time
        if not self._time or passed <= 0.0:
            return self.velocity
        share = 1.0 - math.exp(-passed / _SMOOTHING)
        found: Floats = self.velocity + share * (relative(self._last, pose) / passed - self.velocity)
        return found
