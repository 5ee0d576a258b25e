"""Which echoes the map explains: those within the pose's uncertainty of a mapped wall."""

from __future__ import annotations

import math

from navloom_scans.field import sample
from numba import njit

__all__ = ["MOST_MARGIN", "explain"]

MOST_MARGIN = 0.5
"""Largest distance of an echo from the wall that explains it, m: with more, corridors would be without people."""


@njit(cache=True, nogil=True, error_model="numpy")
def explain(values, frame, cells, beams, motion, margin, found):  # type: ignore[no-untyped-def]
    """What the map says of the echo of each beam: 1 if a wall explains it, 0 if the place is free, -1 if unknown.

    Args:
        values, frame: Attributes of a `DistanceField`, whose nodes are half a cell apart.
        cells: (rows, columns) occupancy of the map, below 0 for unknown.
        beams: (n, 5) as those of `views.place_beams`.
        motion: (5,) x, y, m, heading, rad, of the frame of the beams in the map; x, y of the robot in that frame, m.
        margin: (3,) largest distance from a wall, m; three standard deviations of the position, m, and of the heading.
        found: (n,) output.
    """
    c, s = math.cos(motion[2]), math.sin(motion[2])
    for i in range(beams.shape[0]):
        x = motion[0] + c * beams[i, 2] - s * beams[i, 3]
        y = motion[1] + s * beams[i, 2] + c * beams[i, 3]
        far = math.hypot(beams[i, 2] - motion[3], beams[i, 3] - motion[4])
        distance, _, _, is_inside = sample(values, frame, x, y)
        if not is_inside:
            found[i] = -1
            continue
        if distance < min(margin[0] + margin[1] + margin[2] * far, MOST_MARGIN):
            found[i] = 1
            continue
        dx, dy, cell = x - frame[0], y - frame[1], 2.0 * frame[4]
        row = min(int((frame[2] * dy - frame[3] * dx) / cell), cells.shape[0] - 1)
        column = min(int((frame[2] * dx + frame[3] * dy) / cell), cells.shape[1] - 1)
        found[i] = 0 if cells[row, column] >= 0 else -1
