"""The order in which a scanner's beams were measured, checked against the surfaces while the robot turns.

Drivers of scanners that spin clockwise reverse the ranges, but not their times (Slamtec/rplidar_ros, issue 55).
Undoing the motion within such a scan doubles its distortion, and the heading drifts with each turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["ORDERS", "Sweep"]

Floats = NDArray[np.float64]

ORDERS = (1.0, 0.0, -1.0)
"""As the scan says; all beams at once; the other way round; see `readings.ordered`."""
_LEAST_TURN = 0.05
"""Turn of the robot within a scan from which the orders can be told apart, rad."""
_LEAD, _CERTAIN = 5.0, 30.0
"""Difference of log likelihood from which another order is taken, and from which no more scans are compared."""


class Sweep:
    """Finds the order of the beams.

    Attributes:
        order: The one of `ORDERS` to be used.
    """

    def __init__(self) -> None:
        self.order = ORDERS[0]
        self._costs, self._is_certain = np.zeros(len(ORDERS)), False

    def is_due(self, turn_rate: float, time_offsets: Sequence[Floats]) -> bool:
        """Whether to compare scans of these times, (n,) s each: the robot turns, at this rate, rad/s, enough in one."""
        if self._is_certain or not turn_rate:
            return False
        return any(abs(turn_rate) * np.ptp(times) > _LEAST_TURN for times in time_offsets if len(times))

    def compare(self, cost: Callable[[float], float]) -> None:
        """Compare one scan: `cost` gives the negative log likelihood of its best fit in an order."""
        self._costs += [cost(order) for order in ORDERS]
        best, second = np.sort(self._costs)[:2]
        now = self._costs[ORDERS.index(self.order)]
        if now - best > _LEAD:
            self.order = ORDERS[int(np.argmin(self._costs))]
        self._is_certain = second - best > _CERTAIN
