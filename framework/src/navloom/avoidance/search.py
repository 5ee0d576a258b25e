"""The 100 degree rotation search, and when to call it trapped: Hoang et al. 2013, III.C, step 2."""

import math
from dataclasses import dataclass

from navloom.avoidance.steering import wrap


@dataclass
class RotationSearch:
    """Turns by a fixed angle towards the side of the target, keeping its sign until a slot is found.

    Attributes:
        angle: Of one rotation, rad.
        sign: +1 left, -1 right, 0 while none is under way or to be continued.
        turned: Angle turned so far in this rotation, rad.
        active: Whether a rotation is under way.
    """

    angle: float
    sign: int = 0
    turned: float = 0.0
    active: bool = False
    _heading: float = 0.0

    def start(self, heading: float, target: float) -> None:
        """Begin a rotation to the side of the target, or to the side of the last one where that found nothing."""
        if self.sign == 0:
            self.sign = 1 if wrap(target - heading) > 0.0 else -1
        self.turned, self.active, self._heading = 0.0, True, heading

    def reverse(self, heading: float) -> None:
        """Begin again the other way: the footprint has no room to turn on."""
        self.sign, self.turned, self.active, self._heading = -self.sign, 0.0, True, heading

    def follow(self, heading: float) -> bool:
        """Count what was turned since the last call; True while the rotation is not done."""
        if self.active:
            self.turned += self.sign * wrap(heading - self._heading)
            self._heading = heading
            self.active = self.turned < self.angle
        return self.active

    def end(self) -> None:
        """A slot was found: the next search chooses its side afresh."""
        self.sign, self.turned, self.active = 0, 0.0, False


@dataclass
class Progress:
    """Whether the robot comes nearer to its target.

    Attributes:
        step: Getting nearer by this much counts as progress, m.
        shift: A target that moved by more is a new one, m.
        attempts: Rotations since the last progress.
        stalled: Time steered around obstacles since the last progress, s.
        blocked: Time for which no part of the wanted command was free, s.
    """

    step: float
    shift: float
    attempts: int = 0
    stalled: float = 0.0
    blocked: float = 0.0
    _best: float = math.inf
    _target: tuple[float, float] | None = None

    def restart(self) -> None:
        """Forget everything."""
        self.attempts, self.stalled, self.blocked, self._best, self._target = 0, 0.0, 0.0, math.inf, None

    def note(self, distance: float, target: tuple[float, float]) -> bool:
        """Take in the distance to the target, m, and the target, m, pose frame; True where that is progress."""
        if self._target is None or math.dist(target, self._target) > self.shift:
            self.restart()
            self._target = target
        if distance >= self._best - self.step:
            return False
        self._best, self.attempts, self.stalled = distance, 0, 0.0
        return True


@dataclass
class Trap:
    """Holds the report until somebody moved the robot, or it has another target.

    Attributes:
        release_distance: m. release_angle: rad.
    """

    release_distance: float
    release_angle: float
    place: tuple[float, float, float] | None = None
    target: tuple[float, float] = (0.0, 0.0)

    def holds(self, pose: tuple[float, float, float], target: tuple[float, float], shift: float) -> bool:
        """Whether the robot is still where it was trapped; `shift`, m, is how far a new target is from the old."""
        if self.place is None:
            return False
        moved = math.dist(pose[:2], self.place[:2]) > self.release_distance
        turned = abs(wrap(pose[2] - self.place[2])) > self.release_angle
        if moved or turned or math.dist(target, self.target) > shift:
            self.place = None
        return self.place is not None
