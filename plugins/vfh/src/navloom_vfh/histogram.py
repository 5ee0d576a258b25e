"""Polar histograms: Borenstein & Koren 1991 (VFH) and Ulrich & Borenstein 1998 (VFH+), one function per equation.

Cells are in the base frame, directions in the pose frame: sector k spans [k, k + 1) * alpha. Magnitudes are pure
numbers: 1 is one cell of full certainty at the robot.
"""

import math

import numpy as np
from navloom_avoidance.certainty import AXIS_CERTAINTY
from navloom_avoidance.himm import TOP
from navloom_avoidance.histogram import cell_magnitude
from navloom_avoidance.steering import TURN
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def linear_magnitude(certainty: float, distance: float, reach: float) -> float:
    """VFH: m = c^2 (a - b d) with a = 1 and a - b d_max = 0.

    Args:
        certainty: 0..15; c is its share of 15. distance: d, m. reach: d_max, m.
    """
    return cell_magnitude(certainty * AXIS_CERTAINTY / TOP, distance, reach)


@njit(cache=True, nogil=True)
def quadratic_magnitude(certainty: float, distance: float, reach: float) -> float:
    """VFH+: m = c^2 (a - b d^2) with a = 1 and a - b reach^2 = 0; arguments as for linear_magnitude()."""
    if distance >= reach:
        return 0.0
    share, near = certainty / TOP, distance / reach
    return share * share * (1.0 - near * near)


@njit(cache=True, nogil=True)
def enlargement_angle(distance: float, radius: float) -> float:
    """VFH+: gamma = arcsin(r / d), rad, half the angle that a cell at d blocks for a robot of radius r; both m.

    A cell nearer than the radius blocks a half circle; a point robot (0) is blocked in the cell's own direction only.
    """
    return math.asin(radius / distance) if distance > radius else 0.5 * math.pi


@njit(cache=True, nogil=True)
def polar_histogram(
    cells: NDArray[np.float64],
    place: tuple[float, float],
    heading: float,
    radius: float,
    reach: float,
    horizon: float,
    is_quadratic: bool,
    density: NDArray[np.float64],
) -> None:
    """H_k, the sum of the magnitudes of all cells that block the directions of sector k.

    VFH sums the cells of a sector (radius 0). VFH+ sums the cells whose bearing is within gamma of the sector's middle.

    Args:
        cells: (n, 3), x, y, m, base frame, and certainty 0..15.
        place: Centre of the histogram, m, base frame: (0, 0) is the robot, others are projected places.
        heading: Heading of the base in the pose frame, rad.
        radius: Radius of the robot with its safety distance, m; 0 for a point.
        reach: m, see the magnitudes. horizon: Cells farther than this from the place do not count, m.
        is_quadratic: Whether to use quadratic_magnitude(), else linear_magnitude().
        density: (sectors,), filled.
    """
    sectors = density.size
    alpha = TURN / sectors
    density[:] = 0.0
    farthest = min(reach, horizon)
    for i in range(cells.shape[0]):
        x, y = cells[i, 0] - place[0], cells[i, 1] - place[1]
        distance = math.hypot(x, y)
        if distance > farthest:
            continue
        magnitude = (
            quadratic_magnitude(cells[i, 2], distance, reach)
            if is_quadratic
            else linear_magnitude(cells[i, 2], distance, reach)
        )
        bearing = heading + math.atan2(y, x)
        gamma = enlargement_angle(distance, radius) if radius > 0.0 else 0.0
        # The middle of sector k is at (k + 0.5) alpha.
        first = math.ceil((bearing - gamma) / alpha - 0.5)
        last = math.floor((bearing + gamma) / alpha - 0.5)
        # No middle is within gamma, but a cell blocks at least the sector that it is in.
        if last < first:
            first = last = math.floor(bearing / alpha)
        for k in range(first, last + 1):
            density[k % sectors] += magnitude


@njit(cache=True, nogil=True)
def binary_histogram(density: NDArray[np.float64], low: float, high: float, blocked: NDArray[np.float64]) -> None:
    """VFH+: a sector is blocked above tau_high, free below tau_low, and keeps its state in between.

    Args:
        density: (sectors,). low, high: tau_low <= tau_high.
        blocked: (sectors,), 1 for blocked and 0 for free, changed in place.
    """
    for k in range(density.size):
        if density[k] > high:
            blocked[k] = 1.0
        elif density[k] < low:
            blocked[k] = 0.0
