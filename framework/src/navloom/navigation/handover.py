"""The hand-over from controller to avoider: one rule for every avoider, so that a comparison is not confounded."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom.messages import HandOver, Pose2D, RangeScan, Twist2D
from navloom.navigation import echoes
from navloom.navigation.echoes import EchoMemory

__all__ = ["HandOverRule", "own_way", "warm_up"]

Floats = NDArray[np.float64]

NOWHERE = np.empty((0, 2))
HORIZON = 1.0
"""How far ahead the robot's own way is checked, s."""
OWN_STEP = 0.1
"""Distance between two points of that way, m."""
MOST_TURN = 0.5 * math.pi
"""Largest turn along the robot's own way, rad."""


def own_way(base: Pose2D, twist: Twist2D, reach: float) -> Floats:
    """The way of a robot that keeps a velocity: an arc.

    Args:
        base: Pose of the robot, map frame.
        twist: Commanded velocity.
        reach: Longest way, m.

    Returns:
        (k, 2) points, m, map frame, beginning at the robot; k = 0 if it does not drive forward.
    """
    if twist.vx <= 0.0:
        return NOWHERE
    way: Floats = _arc(base.x, base.y, base.heading, twist.vx, twist.wz, reach)
    return way


@njit(cache=True, nogil=True, error_model="numpy")
def _arc(x, y, heading, v, w, reach):  # type: ignore[no-untyped-def]
    length = min(reach, v * HORIZON)
    if abs(w) * length > MOST_TURN * v:
        length = MOST_TURN * v / abs(w)
    last = max(2, math.ceil(length / OWN_STEP) + 1) - 1
    way = np.empty((last + 1, 2))
    for k in range(last + 1):
        along = length if k == last else k * (length / last)
        half = 0.5 * (along * (w / v))
        chord = along * _sinc(half / math.pi)
        way[k, 0], way[k, 1] = x + chord * math.cos(heading + half), y + chord * math.sin(heading + half)
    return way


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _sinc(turns):  # type: ignore[no-untyped-def]
    """sin(π t) / (π t), as numpy.sinc."""
    angle = math.pi * (turns if turns != 0.0 else 1e-20)
    return math.sin(angle) / angle


def warm_up() -> None:
    """Compile the kernels, also those of the echo memory."""
    echoes.warm_up()
    own_way(Pose2D(0.0, 0.0, 0.0), Twist2D(0.5, 0.0, 0.1), 1.0)


class HandOverRule:
    """Engages the avoider when an obstacle lies on the way to the look-ahead point, and releases it with a delay.

    Args:
        mode: "when_blocked", or "always" or "never" for a fixed choice.
        release: How long the corridor must be free before the controller drives again, s.
        keep: How long an echo counts, s: a ring of sonars does not see everything in each tick.
        spread: Share of a sonar's arc that counts; see `EchoMemory`.
        margin: Part of the strip's half width that is room beside the robot, m. The robot's own way is checked
            without it: the next command changes that way, and a robot on a narrow trajectory swings a little.
    """

    def __init__(
        self,
        mode: Literal["when_blocked", "always", "never"],
        release: float,
        keep: float = 0.5,
        spread: float = 0.5,
        margin: float = 0.0,
    ) -> None:
        self.mode, self.release, self.margin = mode, release, margin
        self.engaged = mode == "always"
        self._blocked_at = 0.0
        self._memory = EchoMemory(keep, spread)

    def reset(self) -> None:
        """Forget echoes and engagement."""
        self.engaged = self.mode == "always"
        self._memory.clear()

    def step(
        self, time: float, scans: Iterable[RangeScan], base: Pose2D, way: Floats, width: float, own: Floats = NOWHERE
    ) -> HandOver:
        """Whether the avoider drives in this tick.

        It engages when the strip along the trajectory or the strip along the robot's own way is blocked; the two differ
        when the robot is beside the trajectory. It releases when both strips and the straight strip to the target
        have been free for `release`.

        Args:
            time: Run time, s.
            scans: Scans of this tick.
            base: Pose of the robot, map frame.
            way: (k, 2) the trajectory from the reference point to the target, m, map frame.
            width: Half width of the strip, m.
            own: (k, 2) the robot's own way (see `own_way`), m, map frame; k = 0 for none.
        """
        for scan in scans:
            self._memory.add(scan, base, time)
        nearest = self._memory.nearest(base, way, width, time)
        if len(own) > 1:
            nearest = min(nearest, self._memory.nearest(base, own, width - self.margin, time))
        if self.mode == "when_blocked":
            straight = np.array([(base.x, base.y), way[-1]]) if self.engaged else way
            if math.isfinite(nearest) or (
                self.engaged and math.isfinite(self._memory.nearest(base, straight, width, time))
            ):
                self.engaged, self._blocked_at = True, time
            elif self.engaged and time - self._blocked_at >= self.release:
                self.engaged = False
        return HandOver(self.engaged, nearest)
