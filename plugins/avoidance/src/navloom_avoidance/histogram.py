"""Polar histogram, its enlargement by the robot's size, and the free slots in it.

Borenstein & Koren 1991 (VFH: density, smoothing, slots), Ulrich & Borenstein 1998 (VFH+: enlargement), as inherited by
Hoang et al. 2013, III.C. Directions are in the pose frame: sector k spans [k, k + 1) * alpha.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_avoidance.certainty import AXIS_CERTAINTY
from navloom_avoidance.steering import TURN


@njit(cache=True, nogil=True)
def cell_magnitude(certainty: float, distance: float, reach: float) -> float:
    """m = c^2 (a - b d) with a = 1/9 and a - b reach = 0: 1 for an axis cell at the robot, 0 at the reach and beyond.

    The reach is a separate length, not the window's diagonal, so that the threshold is valid for any window.
    """
    if distance >= reach:
        return 0.0
    return certainty * certainty * (1.0 - distance / reach) / (AXIS_CERTAINTY * AXIS_CERTAINTY)


@njit(cache=True, nogil=True)
def sector_density(
    cells: NDArray[np.float64],
    heading: float,
    cell: float,
    reach: float,
    per_arc_cell: bool,
    density: NDArray[np.float64],
) -> None:
    """VFH density: the sum of the magnitudes of the cells in each sector.

    Args:
        cells: (n, 3), x, y, m, base frame, and certainty.
        heading: Heading of the base in the pose frame, rad.
        cell, reach: m.
        per_arc_cell: Divide by the number of cells that an arc has in one sector, if it is more than one, so that a
            full arc does not weigh more the farther (and wider) it is. False gives the plain sum.
        density: (sectors,), output.
    """
    sectors = density.size
    alpha = TURN / sectors
    density[:] = 0.0
    for i in range(cells.shape[0]):
        distance = math.hypot(cells[i, 0], cells[i, 1])
        bearing = heading + math.atan2(cells[i, 1], cells[i, 0])
        weight = min(1.0, cell / (alpha * distance)) if per_arc_cell and distance > 0.0 else 1.0
        k = math.floor(bearing / alpha) % sectors
        density[k] += weight * cell_magnitude(cells[i, 2], distance, reach)


@njit(cache=True, nogil=True)
def smooth(density: NDArray[np.float64], half_width: int, smoothed: NDArray[np.float64]) -> None:
    """VFH smoothing: h'_k = sum of (l + 1 - |i|) h_k+i for |i| <= l, divided by 2 l + 1 (Borenstein & Koren 1991).

    Args:
        density: (sectors,). half_width: l, sectors; 0 copies. smoothed: (sectors,), output.
    """
    sectors = density.size
    total = 2.0 * half_width + 1.0
    for k in range(sectors):
        value = 0.0
        for i in range(-half_width, half_width + 1):
            value += (half_width + 1.0 - abs(i)) * density[(k + i) % sectors]
        smoothed[k] = value / total


def smoothing_gain(half_width: int, is_enlarged: bool) -> float:
    """Factor by which smooth() changes the density of one obstacle in its middle.

    A threshold times this factor blocks the same obstacle for any l.

    Args:
        half_width: l, sectors.
        is_enlarged: The obstacle fills all 2 l + 1 sectors, which gives (l + 1)^2 / (2 l + 1). A point obstacle fills
            one, which gives (l + 1) / (2 l + 1).
    """
    middle = half_width + 1.0
    return (middle * middle if is_enlarged else middle) / (2.0 * half_width + 1.0)


def window_reach(window: int, cell: float) -> float:
    """d_max of VFH, m: sqrt(2) (ws - 1) / 2 cells, from the middle of the window to that of its corner cell."""
    return 0.5 * math.sqrt(2.0) * (window - 1) * cell


@njit(cache=True, nogil=True)
def enlarged_density(
    cells: NDArray[np.float64], heading: float, radius: float, reach: float, density: NDArray[np.float64]
) -> None:
    """Largest magnitude among the cells that a robot of the given radius would meet in the direction of each sector.

    VFH+: a cell at distance d blocks the directions within gamma = arcsin(radius / d) of its bearing, 90 deg if it is
    nearer than the radius. Unlike the sum, the largest value does not depend on the number of cells of an arc.

    Args:
        cells, heading, reach, density: As for sector_density().
        radius: Half width of the robot plus the safety distance, m.
    """
    sectors = density.size
    alpha = TURN / sectors
    density[:] = 0.0
    for i in range(cells.shape[0]):
        distance = math.hypot(cells[i, 0], cells[i, 1])
        magnitude = cell_magnitude(cells[i, 2], distance, reach)
        if magnitude <= 0.0:
            continue
        bearing = heading + math.atan2(cells[i, 1], cells[i, 0])
        gamma = math.asin(radius / distance) if distance > radius else 0.5 * math.pi
        first = math.ceil((bearing - gamma) / alpha - 0.5)
        last = math.floor((bearing + gamma) / alpha - 0.5)
        if last < first:
            first = last = math.floor(bearing / alpha)
        for k in range(first, last + 1):
            if magnitude > density[k % sectors]:
                density[k % sectors] = magnitude


@njit(cache=True, nogil=True)
def free_slots(density: NDArray[np.float64], threshold: float, slots: NDArray[np.int64]) -> int:
    """Runs of sectors below the threshold, around the circle.

    Args:
        density: (sectors,). threshold: A sector with a lower density is free.
        slots: (sectors // 2 + 1, 2), output: first sector, in [0, sectors), and number of sectors, counter-clockwise.

    Returns:
        Number of slots. All free is one slot (0, sectors).
    """
    sectors = density.size
    start = -1
    for k in range(sectors):
        if density[k] >= threshold:
            start = k
            break
    if start < 0:
        slots[0, 0], slots[0, 1] = 0, sectors
        return 1
    count, width = 0, 0
    for i in range(1, sectors + 1):
        k = (start + i) % sectors
        if density[k] < threshold:
            if width == 0:
                slots[count, 0] = k
            width += 1
        elif width > 0:
            slots[count, 1] = width
            count, width = count + 1, 0
    return count


@njit(cache=True, nogil=True)
def slot_directions(
    slots: NDArray[np.int64],
    count: int,
    sectors: int,
    widest: int,
    inset: float,
    target: float,
    directions: NDArray[np.float64],
) -> int:
    """Candidate directions of the slots: VFH's middle of a narrow slot, a little inside each edge of a wide one.

    A target direction that is as far from both edges of a wide slot is a candidate too (VFH+), so that the robot drives
    straight to the target through open space.

    Args:
        slots, count: As from free_slots(). sectors: Number of sectors of the full circle.
        widest: s_max, sectors: a larger slot is wide. inset: From the edge of a wide slot, sectors; s_max / 2 in VFH.
        target: Direction of the target, rad, pose frame.
        directions: (>= 3 * count,), output, rad, pose frame, not wrapped.

    Returns:
        Number of directions.
    """
    alpha = TURN / sectors
    n = 0
    for i in range(count):
        right = slots[i, 0] * alpha
        width = slots[i, 1] * alpha
        half = min(inset * alpha, 0.5 * width)
        if slots[i, 1] == sectors:
            directions[n] = target
            n += 1
        elif slots[i, 1] <= widest:
            directions[n] = right + 0.5 * width
            n += 1
        else:
            directions[n], directions[n + 1] = right + half, right + width - half
            n += 2
            if half <= (target - right) % TURN <= width - half:
                directions[n] = target
                n += 1
    return n
