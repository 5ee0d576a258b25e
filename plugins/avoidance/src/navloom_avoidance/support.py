"""Consistency rule of the certainty grid: an echo counts only if an earlier one supports it. Not in the paper.

Crosstalk gives single false echoes: the next firing of the sonar sees through them. An obstacle gives another echo at
the same place. A record of the window's cells stores where the last scans had echoes that no cone has seen through.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

LONGEST_MEMORY = 60
"""Most scans in a record: the echoes of a cell are the bits of one int64."""


def new_record(size: int) -> NDArray[np.int64]:
    """Empty record for a window of `size` cells per side; with size 0, every echo counts at once.

    Returns:
        heard: (size, size) int64; bit k of a cell: it had an echo k scans ago, and no cone has seen through it since.
    """
    return np.zeros((size, size), np.int64)


@njit(cache=True, nogil=True)
def age_record(heard: NDArray[np.int64], memory: int) -> None:
    """Age the echoes of a record by one scan, in place, and forget those older than `memory` scans."""
    kept = (1 << (memory + 1)) - 1
    for r in range(heard.shape[0]):
        for c in range(heard.shape[1]):
            heard[r, c] = (heard[r, c] << 1) & kept


@njit(cache=True, nogil=True)
def has_support(heard: NDArray[np.int64], row: int, column: int) -> bool:
    """Whether a cell, or one of the eight around it, had an echo in an earlier scan."""
    size = heard.shape[0]
    for r in range(max(0, row - 1), min(size, row + 2)):
        for c in range(max(0, column - 1), min(size, column + 2)):
            if heard[r, c] >> 1 != 0:
                return True
    return False
