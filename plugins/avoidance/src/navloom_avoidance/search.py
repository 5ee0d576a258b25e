"""The 100 degree rotation search, and the detection of a trap: Hoang et al. 2013, III.C, step 2."""

import math
from dataclasses import dataclass

from navloom_avoidance.steering import wrap


@dataclass
class RotationSearch:
    """Turns by a fixed angle towards the side of the target, keeping the direction until a slot is found.

    Attributes:
        angle: Angle of one rotation, rad.
        sign: +1 left, -1 right, 0 if there is no rotation to continue.
        turned: Angle turned so far in this rotation, rad.
        active: Whether a rotation is in progress.
    """

    angle: float
    sign: int = 0
    turned: float = 0.0
    active: bool = False
    _heading: float = 0.0

    def start(self, heading: float, target: float) -> None:
        """Begin a rotation to the side of the target, or to the side of the last rotation if that found nothing."""
        if self.sign == 0:
            self.sign = 1 if wrap(target - heading) > 0.0 else -1
        self.turned, self.active, self._heading = 0.0, True, heading

    def reverse(self, heading: float) -> None:
        """Begin again in the other direction: the footprint has no room to continue."""
        self.sign, self.turned, self.active, self._heading = -self.sign, 0.0, True, heading

    def follow(self, heading: float) -> bool:
        """Add the turn since the last call; True while the rotation is not finished."""
        if self.active:
            self.turned += self.sign * wrap(heading - self._heading)
            self._heading = heading
            self.active = self.turned < self.angle
        return self.active

    def end(self) -> None:
        """A slot was found: the next search chooses its side again."""
        self.sign, self.turned, self.active = 0, 0.0, False


@dataclass
class Progress:
    """Tracks whether the robot comes nearer to its target.

    Attributes:
        step: Smallest approach that counts as progress, m.
        shift: A target that moved by more than this is a new one, m.
        attempts: Rotations since the last progress.
        stalled: Time spent steering around obstacles since the last progress, s.
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
        """Record the distance to the target, m, and the target, m, pose frame; True if this is progress."""
        if self._target is None or math.dist(target, self._target) > self.shift:
            self.restart()
            self._target = target
        if distance >= self._best - self.step:
            return False
        self._best, self.attempts, self.stalled = distance, 0, 0.0
        return True


@dataclass
class Trap:
    """Keeps the status trapped until the robot was moved or turned, or has another target.

    Attributes:
        release_distance: Motion that releases it, m. release_angle: Turn that releases it, rad.
    """

    release_distance: float
    release_angle: float
    place: tuple[float, float, float] | None = None
    target: tuple[float, float] = (0.0, 0.0)

    def holds(self, pose: tuple[float, float, float], target: tuple[float, float], shift: float) -> bool:
        """Whether the robot is still trapped; a target farther than `shift`, m, from the old one is a new target."""
        if self.place is None:
            return False
        moved = math.dist(pose[:2], self.place[:2]) > self.release_distance
        turned = abs(wrap(pose[2] - self.place[2])) > self.release_angle
        if moved or turned or math.dist(target, self.target) > shift:
            self.place = None
        return self.place is not None
