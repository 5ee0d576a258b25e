"""The branch of a trajectory that the robot is on, seen along its way: a robot that drives backwards is one that drives
forwards and heads the other way, so that each law follows both.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from navloom import ControllerInput, Pose2D, Trajectory, Twist2D
from navloom_lyapunov_tracker.law import wrap

__all__ = ["Branches"]


class _Part(NamedTuple):
    """A branch: where it begins and ends, m, its direction, 1 or -1, and itself along its way, from arc length 0."""

    begin: float
    end: float
    direction: float
    along: Trajectory


class Branches:
    """The branches of the newest trajectory: the parts between its cusps."""

    def __init__(self) -> None:
        self._whole: Trajectory | None = None
        self._parts: list[_Part] = []

    def along_way(self, given: ControllerInput) -> tuple[ControllerInput, float]:
        """The input as it is for a robot that heads along the way, and the sign of its speed: -1 backwards.

        Poses then head along the way, speeds are > 0, and the trajectory is the branch of the reference only, on which
        progress and remaining length count.
        """
        if given.trajectory is not self._whole:
            self._whole, self._parts = given.trajectory, _parts_of(given.trajectory)
        reference, estimate = given.reference, given.estimate
        if len(self._parts) == 1 and reference.speed > 0.0:
            return given, 1.0
        sign = math.copysign(1.0, reference.speed)
        # At a cusp, the direction tells on which of two branches the reference is.
        on = (part for part in self._parts if part.direction == sign and reference.progress <= part.end + 1e-9)
        part = next(on, self._parts[-1])
        progress, left = max(reference.progress - part.begin, 0.0), max(part.end - reference.progress, 0.0)
        reference = replace(reference, progress=progress, remaining=left, speed=abs(reference.speed))
        if sign < 0.0:
            twist = estimate.twist
            turned = Twist2D(-twist.vx, -twist.vy, twist.wz)
            reference = replace(reference, pose=_turned(reference.pose))
            estimate = replace(estimate, pose=_turned(estimate.pose), twist=turned)
        return replace(given, reference=reference, estimate=estimate, trajectory=part.along), sign


def _turned(pose: Pose2D) -> Pose2D:
    return replace(pose, heading=wrap(pose.heading + math.pi))


def _parts_of(trajectory: Trajectory) -> list[_Part]:
    """The branches of a trajectory; the trajectory itself if it has one, forwards."""
    samples = trajectory.samples
    # At a cusp, two samples have the same place.
    cusps = np.flatnonzero(np.diff(samples[:, 0]) <= 0.0) + 1
    if not len(cusps) and samples[0, 5] > 0.0:
        return [_Part(0.0, float(samples[-1, 0]), 1.0, trajectory)]
    parts = []
    for rows in np.split(samples, cusps):
        branch, direction = rows.copy(), math.copysign(1.0, rows[0, 5])
        branch[:, 0] -= rows[0, 0]
        if direction < 0.0:
            branch[:, 3] = branch[:, 3] % math.tau - math.pi
            branch[:, 4:] *= -1.0
        branch.flags.writeable = False
        along = replace(trajectory, samples=branch)
        parts.append(_Part(float(rows[0, 0]), float(rows[-1, 0]), direction, along))
    return parts
