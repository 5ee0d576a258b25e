"""Notices that the robot does not move, and when it has backed up far enough."""

from __future__ import annotations

import math
from dataclasses import dataclass

from navloom_avoidance.steering import wrap

Pose = tuple[float, float, float]
MOVED, TURNED = 0.1, 0.35  # m and rad: more than noise and jerking to and fro in one place
SLACK = 1.0  # s: longer than it takes to get up to the speed of backing up


@dataclass
class Stuck:
    """Watches the robot's motion, and its way back once it is stuck.

    Attributes:
        patience: Time of steering without motion after which the robot is stuck, s.
        distance: How far to back up then, m; 0 for not at all. speed: m/s.
        backs_up: Whether the robot backs up now.
    """

    patience: float
    distance: float
    speed: float
    backs_up: bool = False
    _place: Pose | None = None
    _time: float = 0.0

    def restart(self, pose: Pose | None = None) -> None:
        """Watch again from a place."""
        self.backs_up, self._place, self._time = False, pose, 0.0

    def note(self, pose: Pose, elapsed: float) -> None:
        """Note the robot's pose, and for how long it has been told to move since the last one, s."""
        self._time += elapsed
        away, turned = self._motion(pose)
        if self.backs_up:
            if away >= self.distance or self._time > self.distance / self.speed + SLACK:
                self.restart(pose)
        elif away > MOVED or turned > TURNED:
            self.restart(pose)

    @property
    def is_due(self) -> bool:
        """Whether the robot has not moved for so long that it should back up."""
        return not self.backs_up and self.distance > 0.0 and self._time > self.patience

    def begin(self, pose: Pose) -> None:
        """Begin to back up."""
        self.restart(pose)
        self.backs_up = True

    def _motion(self, pose: Pose) -> tuple[float, float]:
        """Way, m, and turn, rad, from the place where the watch began."""
        if self._place is None:
            return math.inf, math.inf
        return math.dist(pose[:2], self._place[:2]), abs(wrap(pose[2] - self._place[2]))
