"""Noise reduction for the ranges of a laser."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

BEAMS = 2  # neighbours on each side that are averaged


@njit(cache=True, nogil=True)
def smoothed(ranges: NDArray[np.float64], range_max: float, agreement: float) -> NDArray[np.float64]:
    """Ranges (n,), m, each averaged with its neighbours to reduce noise.

    The nearest of many noisy readings of one surface is some standard deviations too near, which would make gaps look
    narrower. Echoes that differ by more than `agreement` are of another surface and are not averaged.

    Args:
        ranges: (n,), m, by increasing bearing. range_max: a reading of this or more is no echo, m. agreement: m.
    """
    found = ranges.copy()
    for i in range(ranges.size):
        if not 0.0 < ranges[i] < range_max:
            continue
        total, count = 0.0, 0
        for k in range(max(0, i - BEAMS), min(ranges.size, i + BEAMS + 1)):
            if 0.0 < ranges[k] < range_max and abs(ranges[k] - ranges[i]) <= agreement:
                total += ranges[k]
                count += 1
        found[i] = total / count
    return found


def warm_up_smoothing() -> None:
    """Compile the kernel for the read-only ranges of messages."""
    ranges = np.ones(3)
    ranges.flags.writeable = False
    smoothed(ranges, 8.0, 0.1)
