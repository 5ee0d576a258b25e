"""Certainty grid of the VFF: one cell per reading, counted up and down (HIMM, Borenstein & Koren).

A reading counts +3 in the cell on its acoustic axis at the measured distance, and -1 in the cells of the axis before
it. The rest of the arc is left out: the robot's motion spreads the readings of an obstacle over neighbouring cells.
"""

import math
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_avoidance.beams import Beams
from navloom_avoidance.certainty import place_beams, scroll_window

TOP = 15  # largest certainty
_SEEN_THROUGH, _SEEN = 1, 2


class WindowParams(Protocol):
    """Parameters of a certainty window whose cells count readings.

    Attributes:
        window: Side of the window, cells. cell: Side of a cell, m.
        clear_margin: Last part of the way to an echo that a beam does not count down, m.
        blind_depth, count_up, count_down: See count_readings().
    """

    @property
    def window(self) -> int: ...
    @property
    def cell(self) -> float: ...
    @property
    def clear_margin(self) -> float: ...
    @property
    def blind_depth(self) -> float: ...
    @property
    def count_up(self) -> int: ...
    @property
    def count_down(self) -> int: ...


def enter_readings(
    grid: NDArray[np.uint8],
    origin: NDArray[np.int64],
    votes: NDArray[np.uint8],
    beams: Beams,
    pose: tuple[float, float, float],
    params: WindowParams,
) -> None:
    """Move the window to the robot and count the readings of one tick.

    Args:
        grid: (window, window), certainty 0..15, in place. origin: Place of grid[0, 0], in cells, in place.
        votes: (window, window), work array.
        beams: Readings, base frame. pose: x, y, m, heading, rad, of the base.
        params: Parameters of the window.
    """
    p = params
    scroll_window(grid, origin, pose[0], pose[1], p.cell)
    placed = place_beams(
        pose, beams.origins, beams.bearings, beams.half_angles, beams.ranges, beams.limits, p.clear_margin,
        0.75 * p.window * p.cell,
    )  # fmt: skip
    count_readings(grid, origin, p.cell, placed, beams.limits, p.blind_depth, p.count_up, p.count_down, votes)


@njit(cache=True, nogil=True)
def vote_line(
    votes: NDArray[np.uint8],
    origin: NDArray[np.int64],
    cell: float,
    apex: tuple[float, float],
    axis: tuple[float, float],
    far: float,
) -> None:
    """Mark every cell that an axis crosses up to a distance from its sensor as seen through.

    Args:
        votes: (size, size), in place. origin, cell: Place of votes[0, 0], in cells, and side of a cell, m.
        apex: Position of the sensor, m, pose frame. axis: Unit vector, pose frame. far: Distance, m.
    """
    size = votes.shape[0]
    x, y = apex[0] / cell, apex[1] / cell
    c, r = math.floor(x), math.floor(y)
    right, up = axis[0] > 0.0, axis[1] > 0.0
    step_c, step_r = cell / max(abs(axis[0]), 1.0e-12), cell / max(abs(axis[1]), 1.0e-12)
    next_c = step_c * (c + 1.0 - x if right else x - c)
    next_r = step_r * (r + 1.0 - y if up else y - r)
    distance = 0.0
    while distance < far:
        i, k = r - origin[1], c - origin[0]
        if 0 <= i < size and 0 <= k < size:
            votes[i, k] = _SEEN_THROUGH
        if next_c < next_r:
            distance, next_c = next_c, next_c + step_c
            c += 1 if right else -1
        else:
            distance, next_r = next_r, next_r + step_r
            r += 1 if up else -1


@njit(cache=True, nogil=True)
def count_readings(
    grid: NDArray[np.uint8],
    origin: NDArray[np.int64],
    cell: float,
    placed: NDArray[np.float64],
    limits: NDArray[np.float64],
    blind_depth: float,
    up: int,
    down: int,
    votes: NDArray[np.uint8],
) -> None:
    """Count the readings of one tick: HIMM, +3 for an echo, -1 where an axis saw through, within 0..15.

    A cell counts once per tick, and an echo takes precedence over being seen through: otherwise a laser with ten beams
    per cell would count ten times, and the result would depend on the order of the beams.

    Args:
        grid: (size, size), certainty 0..15, in place. origin, cell: Its place, in cells, and side of a cell, m.
        placed: (n, 8), beams in the pose frame, from navloom_avoidance.certainty.place_beams().
        limits: (n, 2), smallest and largest range of each beam, m.
        blind_depth: A reading at the smallest range counts this far before it too, m: the obstacle may be nearer.
        up, down: Increment (3) and decrement (1).
        votes: (size, size), work array.
    """
    size = grid.shape[0]
    votes[:, :] = 0
    for i in range(placed.shape[0]):
        vote_line(votes, origin, cell, (placed[i, 0], placed[i, 1]), (placed[i, 2], placed[i, 3]), placed[i, 4])
    for i in range(placed.shape[0]):
        distance = placed[i, 5]
        least = distance - (blind_depth if distance <= limits[i, 0] else 0.0)
        while 0.0 < distance < np.inf and distance >= least:
            k = math.floor((placed[i, 0] + distance * placed[i, 2]) / cell) - origin[0]
            r = math.floor((placed[i, 1] + distance * placed[i, 3]) / cell) - origin[1]
            if 0 <= r < size and 0 <= k < size:
                votes[r, k] = _SEEN
            distance -= 0.5 * cell
    for r in range(size):
        for k in range(size):
            if votes[r, k] == _SEEN:
                grid[r, k] = min(TOP, int(grid[r, k]) + up)
            elif votes[r, k] == _SEEN_THROUGH:
                grid[r, k] = max(0, int(grid[r, k]) - down)
