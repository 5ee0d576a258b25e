"""One attempt to free a robot: back along the way it came, then a turn, then a moment of rest. Pure: told the time."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from navloom_recoveries.motion import edges_of, is_free, margin_of, turn_back

__all__ = ["Retracing", "Rules"]

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]
Phase = Literal["back", "turn", "rest"]

_LOOK = 0.25
"""m: the place of the trail that it steers backwards to."""
_REACTION = 0.2
"""s added to the time it needs to brake."""


@dataclass(frozen=True)
class Rules:
    """What an attempt may do.

    Attributes:
        distance: m back in the first attempt; n times in the n-th.
        speed, deceleration: m/s and m/s².
        turn, turn_rate: rad and rad/s.
        margin: m.
        memory, patience, rest: s.
        delay: Lag and dead time of the motors, s.
    """

    distance: float
    speed: float
    deceleration: float
    turn: float
    turn_rate: float
    margin: float
    memory: float
    patience: float
    rest: float
    delay: float = 0.0


class Retracing:
    """Backs up, turns and rests.

    Args:
        rules: See there.
        footprint: (n, 2) m, base frame, convex, counter-clockwise.
    """

    def __init__(self, rules: Rules, footprint: Floats) -> None:
        self.rules = rules
        self._edges = edges_of(footprint)
        self._echoes: deque[tuple[float, Floats]] = deque()
        self.phase: Phase = "rest"
        self._began = self._rested = 0.0
        self._left = self._turn_left = 0.0
        self._margin: float | None = None
        self._side = 0
        self._last: Pose = (0.0, 0.0, 0.0)
        self._trail: Floats = np.empty((0, 3))

    def start(self, time: float, attempt: int, pose: Pose, trail: Floats) -> None:
        """Begin an attempt, numbered from 1, at a run time, s; `trail` is (k, 3), oldest first."""
        self.phase = "back"
        self._began, self._last, self._trail = time, pose, trail
        self._left = self.rules.distance * attempt
        self._turn_left = self.rules.turn if attempt > 1 else 0.0
        self._side = 0
        self._margin = None
        self._echoes.clear()

    def step(self, time: float, pose: Pose, points: Iterable[Floats]) -> tuple[float, float, bool]:
        """Speed, m/s, turn rate, rad/s, and whether the attempt is over.

        Args:
            time: Run time, s.
            pose: Map frame.
            points: (k, 2) echoes of each scan of this tick, m, base frame.
        """
        seen = self._remember(time, pose, points)
        if self._margin is None:
            self._margin = margin_of(seen, self._edges, self.rules.margin)
        self._count(pose)
        late = time - self._began > self.rules.patience
        if self.phase == "back":
            turn = turn_back(self._trail, pose, self.rules.speed, _LOOK)
            if self._left > 0.0 and turn is not None and not late and self._may(seen, -self.rules.speed, turn):
                return -self.rules.speed, turn, False
            self.phase = "turn"
        if self.phase == "turn":
            rate = self._turn(seen)
            if self._turn_left > 0.0 and rate != 0.0 and not late:
                return 0.0, rate, False
            self.phase, self._rested = "rest", time
        return 0.0, 0.0, time - self._rested >= self.rules.rest

    def _turn(self, seen: Floats) -> float:
        """To the side with more room, and on to that side as long as it is free; 0 where none is."""
        if self._turn_left <= 0.0:
            return 0.0
        if self._side == 0:
            left = float((1.0 / (1.0 + np.hypot(*seen[seen[:, 1] > 0.0].T))).sum())
            right = float((1.0 / (1.0 + np.hypot(*seen[seen[:, 1] < 0.0].T))).sum())
            self._side = 1 if left <= right else -1
            if not self._may(seen, 0.0, self._side * self.rules.turn_rate):
                self._side = -self._side
        rate = self._side * self.rules.turn_rate
        return rate if self._may(seen, 0.0, rate) else 0.0

    def _may(self, seen: Floats, v: float, w: float) -> bool:
        assert self._margin is not None
        horizon = abs(v) / self.rules.deceleration + _REACTION + self.rules.delay
        return is_free(seen, self._edges, v, w, horizon, self._margin)

    def _count(self, pose: Pose) -> None:
        """Take what was driven since the last step off what is left."""
        x, y, heading = self._last
        if self.phase == "back":
            self._left -= math.dist(pose[:2], (x, y))
        elif self.phase == "turn":
            self._turn_left -= abs(math.remainder(pose[2] - heading, math.tau))
        self._last = pose

    def _remember(self, time: float, pose: Pose, points: Iterable[Floats]) -> Floats:
        """(k, 2) echoes of the last moments, m, base frame of now."""
        x, y, heading = pose
        cos, sin = math.cos(heading), math.sin(heading)
        for found in points:
            placed = np.stack([x + cos * found[:, 0] - sin * found[:, 1], y + sin * found[:, 0] + cos * found[:, 1]], 1)
            self._echoes.append((time, placed))
        while self._echoes and self._echoes[0][0] < time - self.rules.memory:
            self._echoes.popleft()
        if not self._echoes:
            return np.empty((0, 2))
        moved = np.concatenate([placed for _, placed in self._echoes]) - (x, y)
        return np.stack([cos * moved[:, 0] + sin * moved[:, 1], cos * moved[:, 1] - sin * moved[:, 0]], 1)
