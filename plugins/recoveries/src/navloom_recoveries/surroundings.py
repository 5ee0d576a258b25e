"""What a robot has sensed near it in the last moments, and which commands keep clear of it. Pure; SI."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from navloom_recoveries.motion import gap, is_free

__all__ = ["Surroundings"]

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]

_REACTION = 0.2
"""Reaction time that is added to the braking time, s."""
_ROUNDING = 1e-6
"""Decrease of a gap that still counts as unchanged, m."""


class Surroundings:
    """Remembers echoes, and checks commands against them.

    Args:
        edges: Of the footprint, see `motion.edges_of`.
        memory: How long an echo counts, s.
        deceleration: m/s².
        delay: Lag and dead time of the motors, s.
    """

    def __init__(self, edges: Floats, memory: float, deceleration: float, delay: float) -> None:
        self._edges, self._memory, self._deceleration, self._delay = edges, memory, deceleration, delay
        self._echoes: deque[tuple[float, Floats]] = deque()

    def clear(self) -> None:
        """Forget all echoes: those of an earlier attempt may be of what has left since."""
        self._echoes.clear()

    def remember(self, time: float, pose: Pose, points: Iterable[Floats]) -> Floats:
        """(k, 2) echoes of the last `memory` seconds, m, in the current base frame.

        Args:
            time: Run time, s.
            pose: x, y, m, heading, rad, in any frame that does not move.
            points: (k, 2) echoes of each new scan, m, base frame.
        """
        x, y, heading = pose
        cos, sin = math.cos(heading), math.sin(heading)
        for point in points:
            placed = np.stack([x + cos * point[:, 0] - sin * point[:, 1], y + sin * point[:, 0] + cos * point[:, 1]], 1)
            self._echoes.append((time, placed))
        while self._echoes and self._echoes[0][0] < time - self._memory:
            self._echoes.popleft()
        if not self._echoes:
            return np.empty((0, 2))
        moved = np.concatenate([placed for _, placed in self._echoes]) - (x, y)
        return np.stack([cos * moved[:, 0] + sin * moved[:, 1], cos * moved[:, 1] - sin * moved[:, 0]], 1)

    def may(self, seen: Floats, v: float, w: float, margin: float) -> bool:
        """Whether a command keeps the margin, m, or brings points within the margin no nearer.

        All gaps are compared on one set of echoes, so its noise does not matter.
        """
        margin = min(margin, gap(seen, self._edges) - _ROUNDING)
        return is_free(seen, self._edges, v, w, self.horizon(v), margin)

    def horizon(self, v: float) -> float:
        """Time to react and to brake, s."""
        return abs(v) / self._deceleration + _REACTION + self._delay
