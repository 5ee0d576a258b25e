"""The path for the path critics, made of past targets, and the direction of the last turn in place."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from navloom_avoidance.steering import wrap
from numpy.typing import NDArray

Point = tuple[float, float]
LEAST = 0.05  # m: a target nearer to the last point of the trail is not added


def trail_ahead(trail: list[Point], place: Point, target: Point, jump: float) -> NDArray[np.float64]:
    """Path still to drive: from the robot to the nearest target so far, and on to the current one.

    The target is a look-ahead point that moves along the planned trajectory, so past targets trace the trajectory.

    Args:
        trail: Targets so far, m, oldest first. The new one is added and passed ones are removed; a target farther than
            `jump`, m, from the last one starts a new trail.
        place: Position of the robot, m. target: m.

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
    """Memory of the oscillation critic: the sign of the last turn in place, until the robot has moved on.

    Attributes:
        distance, angle: Motion after which the sign is forgotten, m and rad.
        sign: +1 left, -1 right, 0 for no restriction.
    """

    distance: float
    angle: float
    sign: int = 0
    _place: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def note(self, v: float, w: float, slow: float, pose: tuple[float, float, float]) -> None:
        """Note the command sent, m/s and rad/s; a turn below the speed `slow`, m/s, is one in place."""
        if v < slow and w != 0.0 and self.sign == 0:
            self.sign = 1 if w > 0.0 else -1
            self._place = pose

    def follow(self, pose: tuple[float, float, float]) -> None:
        """Lift the restriction once the robot has driven or turned far enough; pose: x, y, m, heading, rad."""
        turned = abs(wrap(pose[2] - self._place[2]))
        if math.dist(pose[:2], self._place[:2]) > self.distance or turned > self.angle:
            self.sign = 0
