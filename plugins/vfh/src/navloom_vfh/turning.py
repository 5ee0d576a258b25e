"""Directions that the turning circles leave free: Ulrich & Borenstein 1998 (VFH+), masked polar histogram."""

import math

import numpy as np
from navloom_avoidance.steering import TURN
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def turning_radius(speed: float, max_turn: float) -> float:
    """Smallest turning radius, m, at a speed, m/s, and a turn rate of at most max_turn, rad/s; 0 when stopped."""
    return max(0.0, speed) / max_turn


@njit(cache=True, nogil=True)
def turning_limits(
    cells: NDArray[np.float64],
    place: tuple[float, float, float],
    circle: float,
    radius: float,
    certainty: float,
) -> tuple[float, float]:
    """phi_r and phi_l: how far the robot can turn to either side at this speed before a cell blocks it.

    A cell on the right blocks all directions right of it if it is nearer than r_r + r to the centre of the right
    turning circle; likewise on the left.

    Args:
        cells: (n, 3), x, y, m, base frame, and certainty 0..15.
        place: x, y, m, heading, rad, base frame: (0, 0, 0) is the robot.
        circle: Turning radius r_r = r_l, m. radius: Radius r of the robot with its safety distance, m.
        certainty: Cells with this certainty or less do not count.

    Returns:
        rad, relative to the heading: phi_r in [-pi, 0], phi_l in [0, pi].
    """
    right, left = -math.pi, math.pi
    cos_t, sin_t = math.cos(place[2]), math.sin(place[2])
    limit = (circle + radius) * (circle + radius)
    for i in range(cells.shape[0]):
        if cells[i, 2] <= certainty:
            continue
        dx, dy = cells[i, 0] - place[0], cells[i, 1] - place[1]
        x, y = dx * cos_t + dy * sin_t, dy * cos_t - dx * sin_t
        across = abs(y) - circle
        if y == 0.0 or x * x + across * across >= limit:
            continue
        bearing = math.atan2(y, x)
        if bearing < 0.0:
            right = max(right, bearing)
        else:
            left = min(left, bearing)
    return right, left


@njit(cache=True, nogil=True)
def masked_histogram(
    blocked: NDArray[np.float64], heading: float, right: float, left: float, masked: NDArray[np.float64]
) -> None:
    """H^m: a sector is free where the binary histogram is free and its direction lies between phi_r and phi_l.

    The sector of the heading is not masked: the robot need not turn to get there.

    Args:
        blocked: (sectors,), 1 for blocked and 0 for free. heading: rad, in the frame of the sectors.
        right, left: turning_limits(). masked: (sectors,), filled with 1 and 0.
    """
    sectors = blocked.size
    alpha = TURN / sectors
    ahead = math.floor(heading / alpha) % sectors
    for k in range(sectors):
        off = ((k + 0.5) * alpha - heading + math.pi) % TURN - math.pi
        is_within = right <= off <= left or k == ahead
        masked[k] = 0.0 if blocked[k] == 0.0 and is_within else 1.0
