"""One attempt to free a robot: away from what it is close to, else back along the way it came; then a turn. Pure."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from navloom_recoveries.motion import edges_of, gap, gap_after, is_free, margin_of, turn_back

__all__ = ["Retracing", "Rules"]

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]
Phase = Literal["leave", "back", "turn", "rest"]

_LOOK = 0.25
"""m: the place of the trail that it steers backwards to."""
_REACTION = 0.2
"""s added to the time it needs to brake."""
_CLOSE = 0.1
"""Gap below which a robot leaves what it is close to before it goes back, m."""
_STUCK = 0.1
"""A robot that left by less than this goes back, m."""
_HELD, _STEP = 0.5, 0.02
"""A robot that moves by less than the second, m, within the first, s, is held."""
_ROUNDING = 1e-6
"""A gap that shrinks by less stays as it is, m."""
_GAIN = 0.005
"""What the gap must grow by in one step of leaving, m."""


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
        noise: What the nearest of many echoes may be too near by, m.
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
    noise: float = 0.0


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
        self._left = self._asked = self._moved_left = self._turn_left = self._moved_at = 0.0
        self._margin: float | None = None
        self._side = 0
        self._leaving: tuple[float, float] | None = None
        self._last: Pose = (0.0, 0.0, 0.0)
        self._trail: Floats = np.empty((0, 3))

    def start(self, time: float, attempt: int, pose: Pose, trail: Floats) -> None:
        """Begin an attempt, numbered from 1, at a run time, s; `trail` is (k, 3), oldest first."""
        self.phase = "leave"
        self._began, self._last, self._trail = time, pose, trail
        self._left = self._asked = self._moved_left = self.rules.distance * attempt
        self._moved_at = time
        self._turn_left = self.rules.turn if attempt > 1 else 0.0
        self._side = 0
        self._leaving = None
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
            self._margin = margin_of(seen, self._edges, self.rules.margin, self.rules.noise)
        self._count(pose)
        late = time - self._began > self.rules.patience
        may = self._left > 0.0 and not late and not self._is_held(time)
        if self.phase == "leave":
            command = self._leave(seen) if may else None
            if command is not None:
                return *command, False
            self.phase = "back" if self._left > self._asked - _STUCK else "turn"
            self._moved_at, may = time, not late
        if self.phase == "back":
            turn = turn_back(self._trail, pose, self.rules.speed, _LOOK) if may else None
            if turn is not None and self._may(seen, -self.rules.speed, turn):
                return -self.rules.speed, turn, False
            self.phase = "turn"
        if self.phase == "turn":
            rate = self._turn(seen)
            if self._turn_left > 0.0 and rate != 0.0 and not late:
                return 0.0, rate, False
            self.phase, self._rested = "rest", time
        return 0.0, 0.0, time - self._rested >= self.rules.rest

    def _is_held(self, time: float) -> bool:
        """The robot has not moved for a while although it was asked to: the gate sees more than this does."""
        if self._left < self._moved_left - _STEP:
            self._moved_left, self._moved_at = self._left, time
        return time - self._moved_at > _HELD + self.rules.delay

    def _leave(self, seen: Floats) -> tuple[float, float] | None:
        """Speed, m/s, and turn rate, rad/s, that widen the gap most, and on with them; None where there is room."""
        now = gap(seen, self._edges)
        if now >= _CLOSE:
            return None
        if self._leaving is None or not self._may(seen, *self._leaving):
            horizon = self._horizon(self.rules.speed)
            ways = [(v, w) for v in (self.rules.speed, -self.rules.speed) for w in (0.0, 0.5, -0.5)]
            wider = [(gap_after(seen, self._edges, *way, horizon) - now, way) for way in ways if self._may(seen, *way)]
            gain, self._leaving = max(wider, default=(0.0, (0.0, 0.0)))
            if gain < _GAIN:
                return None
        return self._leaving

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
        """It keeps the margin, or comes no nearer to what is within it: the noise of one set of echoes is the same."""
        assert self._margin is not None
        margin = min(self._margin, gap(seen, self._edges) - _ROUNDING)
        return is_free(seen, self._edges, v, w, self._horizon(v), margin)

    def _horizon(self, v: float) -> float:
        """Time to react and to brake, s."""
        return abs(v) / self.rules.deceleration + _REACTION + self.rules.delay

    def _count(self, pose: Pose) -> None:
        """Take what was driven since the last step off what is left."""
        x, y, heading = self._last
        if self.phase in ("back", "leave"):
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
