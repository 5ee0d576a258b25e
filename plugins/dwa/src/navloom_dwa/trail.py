"""The path of the path critics, from the targets given so far; and which way it turned on the spot last."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from navloom.avoidance.steering import wrap
from numpy.typing import NDArray

Point = tuple[float, float]
LEAST = 0.05  # m: nearer to the last one a target is not a new point of the trail


def trail_ahead(trail: list[Point], place: Point, target: Point, jump: float) -> NDArray[np.float64]:
    """The way still to drive: from the robot to the nearest target it was given, and on to the present one.

    A look-ahead point moves along the planned trajectory, so what it leaves behind is the trajectory.

    Args:
        trail: Targets so far, m, oldest first; the new one is added, those passed are taken off; one that is farther
            than `jump`, m, from the last begins a new trail.
        place: Of the robot, m. target: m.

    Returns:
        (k, 2), m, k >= 2.
    """
    if trail and math.dist(trail[-1], target) > jump:
        trail.clear()
    if not trail or math.dist(trail[-1], target) > LEAST:
        trail.append(target)
    nearest = min(range(len(trail)), key=lambda k: math.dist(trail[k], place))
    del trail[:nearest]
    return np.array([place, *trail])


@dataclass
class TurnTrend:
    """The oscillation critic's memory: the sign of the last turn in place, until the robot moved on.

    Attributes:
        distance: m. angle: rad. sign: +1 left, -1 right, 0 where nothing binds.
    """

    distance: float
    angle: float
    sign: int = 0
    _place: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def note(self, v: float, w: float, slow: float, pose: tuple[float, float, float]) -> None:
        """Take in what is sent, m/s and rad/s; below `slow`, m/s, a turn is one in place."""
        if v < slow and w != 0.0 and self.sign == 0:
            self.sign = 1 if w > 0.0 else -1
            self._place = pose

    def follow(self, pose: tuple[float, float, float]) -> None:
        """Free again after having driven or turned far enough; pose: x, y, m, heading, rad."""
        turned = abs(wrap(pose[2] - self._place[2]))
        if math.dist(pose[:2], self._place[:2]) > self.distance or turned > self.angle:
            self.sign = 0
