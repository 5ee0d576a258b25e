"""One attempt to free a robot: leave a close obstacle, else go back along the trail; then turn. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from navloom_recoveries.driving_out import DrivingOut
from navloom_recoveries.motion import edges_of, gap, gap_after, margin_of, turn_back
from navloom_recoveries.surroundings import Surroundings

__all__ = ["Retracing", "Rules"]

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]
Phase = Literal["out", "leave", "back", "turn", "rest"]

NO_POINTS = np.empty((0, 2))
_LOOK = 0.25
"""Distance of the trail point that the robot steers backwards to, m."""
_CLOSE = 0.1
"""Gap below which the robot first moves away from the obstacle, m."""
_STUCK = 0.1
"""Least distance moved away after which the robot does not go back as well, m."""
_HELD, _STEP = 0.5, 0.02
"""Time, s, and distance, m: a robot that moves less than the distance within the time counts as held."""
_GAIN = 0.005
"""Least growth of the gap over one braking horizon for a command that moves away, m."""


@dataclass(frozen=True)
class Rules:
    """Limits of an attempt.

    Attributes:
        distance: Distance to go back in the first attempt, m; n times as far in the n-th.
        speed, deceleration: m/s and m/s².
        turn, turn_rate: rad and rad/s.
        margin: Gap to keep to sensed points, m.
        memory: How long an echo counts, s.
        patience: Longest time of an attempt, s.
        rest: Time stopped before the attempt ends, s.
        delay: Lag and dead time of the motors, s.
        noise: Largest error by which the nearest of many echoes is too near, m.
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
        rules: Limits of each attempt.
        footprint: (n, 2) m, base frame, convex, counter-clockwise.
    """

    def __init__(self, rules: Rules, footprint: Floats) -> None:
        self.rules = rules
        self._edges = edges_of(footprint)
        radius = float(np.hypot(footprint[:, 0], footprint[:, 1]).max())
        self._out = DrivingOut(self._edges, radius, rules.margin, rules.speed, rules.turn_rate, rules.delay)
        self._around = Surroundings(self._edges, rules.memory, rules.deceleration, rules.delay)
        self.phase: Phase = "rest"
        self._began = self._rested = 0.0
        self._left = self._asked = self._moved_left = self._turn_left = self._moved_at = 0.0
        self._margin: float | None = None
        self._side = 0
        self._leaving: tuple[float, float] | None = None
        self._last: Pose = (0.0, 0.0, 0.0)
        self._trail: Floats = np.empty((0, 3))

    def start(self, time: float, attempt: int, pose: Pose, trail: Floats) -> None:
        """Start an attempt, numbered from 1, at a run time, s; `trail` is (k, 3), oldest pose first."""
        self.phase = "out"
        self._out.start(time, attempt)
        self._began, self._last, self._trail = time, pose, trail
        self._left = self._asked = self._moved_left = self.rules.distance * attempt
        self._moved_at = time
        self._turn_left = self.rules.turn if attempt > 1 else 0.0
        self._side = 0
        self._leaving = None
        self._margin = None
        self._around.clear()

    def step(
        self, time: float, pose: Pose, points: Iterable[Floats], mapped: Floats = NO_POINTS, moving: float = 0.0
    ) -> tuple[float, float, bool]:
        """Compute speed, m/s, turn rate, rad/s, and whether the attempt is over.

        Args:
            time: Run time, s.
            pose: x, y, m, heading, rad, map frame.
            points: (k, 2) echoes of each scan of this tick, m, base frame.
            mapped: (n, 2) surfaces of the map near the robot, m, base frame.
            moving: Measured speed, m/s.
        """
        seen = self._around.remember(time, pose, points)
        if self.phase == "out":
            command = self._out.step(time, pose, moving, seen, mapped)
            if command is not None:
                return *command, False
            self.phase = "rest" if self._out.has_arrived else "leave"
            self._began = self._rested = self._moved_at = time
            self._last = pose
        if self._margin is None:
            self._margin = margin_of(seen, self._edges, self.rules.margin, self.rules.noise)
        self._count(pose)
        late = time - self._began > self.rules.patience
        may = self._left > 0.0 and not late and not self._is_held(time)
        if self.phase == "leave":
            command = self._leave(seen) if may else None
            if command is not None:
                return *command, False
            # Having moved away from the obstacle is as good as having gone back.
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
        """Whether the robot has not moved although it was commanded to: the gate may block what is free here."""
        if self._left < self._moved_left - _STEP:
            self._moved_left, self._moved_at = self._left, time
        return time - self._moved_at > _HELD + self.rules.delay

    def _leave(self, seen: Floats) -> tuple[float, float] | None:
        """Speed, m/s, and turn rate, rad/s, that widen the gap most; None if it is wide enough or cannot be widened.

        A command stays in use as long as it is free.
        """
        now = gap(seen, self._edges)
        if now >= _CLOSE:
            return None
        if self._leaving is None or not self._may(seen, *self._leaving):
            horizon = self._around.horizon(self.rules.speed)
            # Forwards first: of equal gains, `max` keeps the first.
            ways = [(v, w) for v in (self.rules.speed, -self.rules.speed) for w in (0.0, 0.5, -0.5)]
            wider = [(gap_after(seen, self._edges, *way, horizon) - now, way) for way in ways if self._may(seen, *way)]
            gain, self._leaving = max(wider, default=(0.0, (0.0, 0.0)))
            if gain < _GAIN:
                return None
        return self._leaving

    def _turn(self, seen: Floats) -> float:
        """Turn rate, rad/s, towards the side with more room, or the other if that is blocked; 0 if the turn is blocked.

        The side is chosen once per attempt.
        """
        if self._turn_left <= 0.0:
            return 0.0
        if self._side == 0:
            # Near echoes count more than far ones, and all of them more than the nearest alone, which is noisy.
            left = float((1.0 / (1.0 + np.hypot(*seen[seen[:, 1] > 0.0].T))).sum())
            right = float((1.0 / (1.0 + np.hypot(*seen[seen[:, 1] < 0.0].T))).sum())
            self._side = 1 if left <= right else -1
            if not self._may(seen, 0.0, self._side * self.rules.turn_rate):
                self._side = -self._side
        rate = self._side * self.rules.turn_rate
        return rate if self._may(seen, 0.0, rate) else 0.0

    def _may(self, seen: Floats, v: float, w: float) -> bool:
        assert self._margin is not None
        return self._around.may(seen, v, w, self._margin)

    def _count(self, pose: Pose) -> None:
        """Subtract the motion since the last step from the remaining distance or turn."""
        x, y, heading = self._last
        if self.phase in ("back", "leave"):
            self._left -= math.dist(pose[:2], (x, y))
        elif self.phase == "turn":
            self._turn_left -= abs(math.remainder(pose[2] - heading, math.tau))
        self._last = pose
