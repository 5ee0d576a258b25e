"""Keeps the way that the robot sees when its path jumps to a longer one."""

from __future__ import annotations

import math
from dataclasses import dataclass

Point = tuple[float, float]


@dataclass
class KeptTarget:
    """The target to steer to: the path's, or for a while the one before.

    A noisy map closes a gap that the scans show open, and the planner leads the robot back, often all the way round. A
    robot in front of the gap has passed it before it has turned, and the next path leads on from there.

    Attributes:
        longest: How long a target is kept, s; 0 keeps none.
        shift: A target that moved by more than this has jumped; a path must be longer by as much to count as longer, m.
        near: A kept target nearer than this is passed, m.
    """

    longest: float
    shift: float
    near: float
    _target: Point | None = None
    _remaining: float = 0.0
    _age: float = 0.0

    def forget(self) -> None:
        """Forget the target."""
        self._target = None

    def choose(self, place: Point, target: Point, remaining: float, is_reachable: bool, period: float) -> Point:
        """The target of this tick, m.

        Args:
            place: Position of the robot, m. target: The path's, m. remaining: Length of the path beyond it, m.
            is_reachable: Whether the last look-ahead found a way to the last choice. period: Time since then, s.
        """
        if self._target is not None and is_reachable:
            self._age += period
            is_jump = math.dist(target, self._target) > self.shift
            rest = math.dist(place, self._target)
            is_longer = math.dist(place, target) + remaining > rest + self._remaining + self.shift
            if is_jump and is_longer and rest > self.near and self._age < self.longest:
                return self._target
        self._target, self._remaining, self._age = target, remaining, 0.0
        return target
