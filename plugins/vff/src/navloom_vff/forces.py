"""The virtual forces: Borenstein & Koren 1989, one function per equation.

Forces are pure numbers: 1 is the pull of the target.
"""

import math

import numpy as np
from navloom_avoidance.himm import TOP
from numba import njit
from numpy.typing import NDArray

TURN = 2.0 * math.pi


def force_constant(balance: float) -> float:
    """F_cr, m^2, at which one cell of full certainty, `balance` m away, pushes as hard as the target pulls."""
    return balance * balance / TOP


@njit(cache=True, nogil=True)
def cell_force(certainty: float, distance: float, constant: float) -> float:
    """|F(i, j)| = F_cr C(i, j) / d^2.

    Args:
        certainty: C, 0..15. distance: d, m, > 0. constant: F_cr, m^2.
    """
    return constant * certainty / (distance * distance)


@njit(cache=True, nogil=True)
def repulsive_force(
    cells: NDArray[np.float64],
    radius: float,
    constant: float,
    least: float,
    horizon: float,
    heading: float,
    histogram: NDArray[np.float64],
) -> tuple[float, float]:
    """F_r, the sum of the forces with which the cells push the robot's centre away.

    Args:
        cells: (n, 3), occupied cells: x, y, m, base frame, and certainty.
        radius: Distances are measured from the disc of this radius, m; 0 makes the robot a point.
        constant: F_cr, m^2. least: Shortest distance that counts, m, > 0.
        horizon: Cells farther than this from the centre do not push, m.
        heading: Heading of the base in the pose frame, rad.
        histogram: (sectors,), filled in: sum of the magnitudes by direction of the cell, pose frame. Sector 0 starts at
            0 rad, counter-clockwise.

    Returns:
        x and y in the base frame.
    """
    sectors = histogram.size
    histogram[:] = 0.0
    x = y = 0.0
    for i in range(cells.shape[0]):
        distance = math.hypot(cells[i, 0], cells[i, 1])
        # A cell exactly at the centre has no direction to push in.
        if distance > horizon or distance == 0.0:
            continue
        force = cell_force(cells[i, 2], max(distance - radius, least), constant)
        x -= force * cells[i, 0] / distance
        y -= force * cells[i, 1] / distance
        bearing = heading + math.atan2(cells[i, 1], cells[i, 0])
        histogram[math.floor(bearing * sectors / TURN) % sectors] += force
    return x, y


def travel_cosine(push: tuple[float, float], heading: float) -> float:
    """cos(theta) = V . F_r / (|V| |F_r|): -1 towards the obstacle that pushes, 0 along it, +1 away from it.

    Args:
        push: F_r, in the frame of the heading; no force gives 0.
        heading: Direction of travel, rad. It replaces V, which has no direction while the robot is stopped.
    """
    strength = math.hypot(*push)
    return (push[0] * math.cos(heading) + push[1] * math.sin(heading)) / strength if strength > 0.0 else 0.0


def damping_factor(cosine: float, weight: float, may_pull: bool) -> float:
    """F_r' / F_r = w + (1 - w) (-cos theta): 1 towards an obstacle, w along it.

    Away from it the printed formula gives 2 w - 1: below w = 0.5 the obstacle would pull the robot back.

    Args:
        cosine: travel_cosine(). weight: w, 0..1 (0.25). may_pull: False replaces negative values by 0.
    """
    factor = weight - (1.0 - weight) * cosine
    return factor if may_pull else max(0.0, factor)


def resultant(push: tuple[float, float], factor: float, pull: float) -> float:
    """Direction delta of R = F_t + F_r', rad.

    Args:
        push: F_r. factor: damping_factor(). pull: Direction of the target force, rad, same frame; its magnitude is 1.
    """
    return math.atan2(math.sin(pull) + factor * push[1], math.cos(pull) + factor * push[0])
