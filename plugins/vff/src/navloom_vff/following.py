"""Escape from traps: trap detection and wall following (Borenstein & Koren 1989)."""

import math
from dataclasses import dataclass

from navloom_avoidance.steering import wrap

RIGHT_ANGLE = 0.5 * math.pi


def is_turned_away(direction: float, target: float) -> bool:
    """Whether |theta_0 - theta_t| > 90 deg, the sign of a trap; both in rad."""
    return abs(wrap(direction - target)) > RIGHT_ANGLE


def wall_direction(push: tuple[float, float], side: int, angle: float) -> float:
    """Direction, rad, of the pull that replaces the target's: theta_r + alpha or theta_r - alpha.

    F_r points away from the wall. With alpha between 90 and 180 deg the pull leads along the wall and towards it, until
    the wall pushes back equally; there R is parallel to the wall.

    Args:
        push: F_r. side: +1 keeps the wall on the left, -1 on the right. angle: alpha, rad.
    """
    return wrap(math.atan2(push[1], push[0]) + side * angle)


@dataclass
class WallFollowing:
    """Whether a wall is being followed, and where following started.

    Attributes:
        side: +1 for a wall on the left, -1 for one on the right, 0 while no wall is followed.
        start: Distance to the target where following started, m.
        hesitated: Time without progress towards the target while no wall is followed, s.
    """

    side: int = 0
    start: float = math.inf
    hesitated: float = 0.0

    def begin(self, push: tuple[float, float], heading: float, angle: float, distance: float) -> None:
        """Follow in the direction nearer to the heading: the one to which the forces have turned the robot.

        Args:
            push: F_r. heading: rad. angle: alpha, rad. distance: Distance to the target, m.
        """
        left, right = (abs(wrap(wall_direction(push, side, angle) - heading)) for side in (1, -1))
        self.side, self.start = 1 if left < right else -1, distance

    def end(self) -> None:
        """Head for the target again."""
        self.side, self.start, self.hesitated = 0, math.inf, 0.0
