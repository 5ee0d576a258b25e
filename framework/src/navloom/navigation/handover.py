"""Who drives, controller or avoider: the same rule for every avoider, or comparing them would be confounded."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from navloom.messages import HandOver, Pose2D, RangeScan
from navloom.navigation.echoes import EchoMemory

__all__ = ["HandOverRule"]

Floats = NDArray[np.float64]


class HandOverRule:
    """Engages the avoider when something sensed lies on the way to the look-ahead point; releases with delay.

    Args:
        mode: "when_blocked", or "always"/"never" to fix it.
        release: How long the corridor must be free before the controller drives again, s.
        keep: How long an echo counts, s, since a ring of sonars does not see everything in each tick.
        spread: Share of a sonar's arc that counts, see `EchoMemory`.
    """

    def __init__(
        self, mode: Literal["when_blocked", "always", "never"], release: float, keep: float = 0.5, spread: float = 0.5
    ) -> None:
        self.mode, self.release = mode, release
        self.engaged = mode == "always"
        self._blocked_at = 0.0
        self._memory = EchoMemory(keep, spread)

    def reset(self) -> None:
        """Forget echoes and engagement."""
        self.engaged = self.mode == "always"
        self._memory.clear()

    def step(self, time: float, scans: Iterable[RangeScan], base: Pose2D, way: Floats, width: float) -> HandOver:
        """Whether the avoider drives in this tick.

        It engages when the strip along the trajectory is blocked. It releases when that and the straight strip to the
        target have been free for a while, since the robot may by then be beside the trajectory.

        Args:
            time: Run time, s.
            scans: Of this tick.
            base: Robot in the map.
            way: (k, 2) the trajectory from the reference point to the target, m, map frame.
            width: Half width of the strip, m.
        """
        for scan in scans:
            self._memory.add(scan, base, time)
        nearest = self._memory.nearest(base, way, width, time)
        if self.mode == "when_blocked":
            straight = np.array([(base.x, base.y), way[-1]]) if self.engaged else way
            if math.isfinite(nearest) or (
                self.engaged and math.isfinite(self._memory.nearest(base, straight, width, time))
            ):
                self.engaged, self._blocked_at = True, time
            elif self.engaged and time - self._blocked_at >= self.release:
                self.engaged = False
        return HandOver(self.engaged, nearest)
