"""Less noise in the ranges of a laser."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

BEAMS = 2  # on either side of one that is smoothed


@njit(cache=True, nogil=True)
def smoothed(ranges: NDArray[np.float64], range_max: float, agreement: float) -> NDArray[np.float64]:
    """Ranges whose noise is averaged out over the beams beside each: (n,), m.

    The nearest of many noisy readings of one surface is some deviations too near, and a gap between two surfaces would
    look that much narrower. Echoes that differ by more are of another surface; without a second one nothing is changed.

    Args:
        ranges: (n,), m, by rising bearing. range_max: m. agreement: m.
    """
    found = ranges.copy()
    for i in range(ranges.size):
        if not 0.0 < ranges[i] <= range_max:
            continue
        total, count = 0.0, 0
        for k in range(max(0, i - BEAMS), min(ranges.size, i + BEAMS + 1)):
            if 0.0 < ranges[k] <= range_max and abs(ranges[k] - ranges[i]) <= agreement:
                total += ranges[k]
                count += 1
        found[i] = total / count
    return found


def warm_up_smoothing() -> None:
    """Compile it for ranges that may be written and those that may not."""
    ranges = np.ones(3)
    for is_writeable in (True, False):
        ranges.flags.writeable = is_writeable
        smoothed(ranges, 8.0, 0.1)
