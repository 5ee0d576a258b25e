"""Candidates for a method's choice, computed from the window in one compiled call per tick."""

import math

import numpy as np
from navloom_avoidance.certainty import occupied_cells
from navloom_avoidance.histogram import free_slots, slot_directions, smooth
from navloom_avoidance.steering import TURN
from numba import njit
from numpy.typing import NDArray

from navloom_vfh.histogram import binary_histogram, polar_histogram
from navloom_vfh.turning import masked_histogram, turning_limits

Floats = NDArray[np.float64]
Window = tuple[NDArray[np.uint8], NDArray[np.int64], float]
Pose = tuple[float, float, float]


@njit(cache=True, nogil=True)
def density_ahead(density: Floats, heading: float) -> float:
    """h_c, the density of the sector of the heading; heading in rad, pose frame."""
    return float(density[math.floor(heading * density.size / TURN) % density.size])


@njit(cache=True, nogil=True)
def survey_valleys(
    window: Window,
    pose: Pose,
    edges: Floats,
    radius: float,
    reach: float,
    horizon: float,
    half_width: int,
    threshold: float,
    cells: Floats,
    density: Floats,
    slots: NDArray[np.int64],
) -> tuple[int, int, float]:
    """VFH: compute the occupied cells, the smoothed polar density and its valleys.

    Args:
        window: Certainty grid, its origin in cells, and side of a cell, m.
        pose: x, y, m, heading, rad, pose frame. edges: clearance.footprint_edges().
        radius, reach, horizon: As for histogram.polar_histogram(). half_width: l of the smoothing, sectors.
        threshold: A sector is free below it.
        cells, density, slots: Outputs, filled in: (size * size, 3), (sectors,), (sectors // 2 + 1, 2).

    Returns:
        Numbers of cells and valleys, and h'_c.
    """
    count = occupied_cells(window[0], window[1], window[2], pose, edges, cells)
    rough = np.empty_like(density)
    polar_histogram(cells[:count], (0.0, 0.0), pose[2], radius, reach, horizon, False, rough)
    smooth(rough, half_width, density)
    return count, free_slots(density, threshold, slots), density_ahead(density, pose[2])


@njit(cache=True, nogil=True)
def survey_openings(
    window: Window,
    pose: Pose,
    edges: Floats,
    radius: float,
    reach: float,
    horizon: float,
    thresholds: tuple[float, float],
    circle: float,
    certainty: float,
    widest: int,
    target: float,
    cells: Floats,
    density: Floats,
    blocked: Floats,
    slots: NDArray[np.int64],
    directions: Floats,
) -> tuple[int, int, int, bool, float]:
    """VFH+: compute occupied cells, primary, binary and masked histogram, openings and candidate directions.

    If the turning circle at the current speed leaves no opening, the robot must slow down, and the openings are those
    for a circle of 0.

    Args:
        window, pose, edges, radius, reach, horizon, cells, density, slots: As for survey_valleys().
        thresholds: tau_low and tau_high. circle, certainty: As for turning.turning_limits().
        widest: s_max, sectors. target: Direction of the target, rad, pose frame.
        blocked: (sectors,), binary histogram of the last tick, changed to that of this tick.
        directions: (3 * (sectors // 2 + 1),), filled in, rad, pose frame.

    Returns:
        Numbers of cells, openings and directions; whether the robot must slow down; h_c.
    """
    count = occupied_cells(window[0], window[1], window[2], pose, edges, cells)
    found, n, must_slow, ahead = openings(
        cells[:count], pose[2], radius, reach, horizon, thresholds, circle, certainty, widest, target, density,
        blocked, slots, directions,
    )  # fmt: skip
    return count, found, n, must_slow, ahead


@njit(cache=True, nogil=True)
def openings(
    near: Floats,
    heading: float,
    radius: float,
    reach: float,
    horizon: float,
    thresholds: tuple[float, float],
    circle: float,
    certainty: float,
    widest: int,
    target: float,
    density: Floats,
    blocked: Floats,
    slots: NDArray[np.int64],
    directions: Floats,
) -> tuple[int, int, bool, float]:
    """As survey_openings(), for cells (n, 3) that are known; return the same without the number of cells."""
    polar_histogram(near, (0.0, 0.0), heading, radius, reach, horizon, True, density)
    binary_histogram(density, thresholds[0], thresholds[1], blocked)
    masked = np.empty_like(density)
    must_slow = False
    while True:
        right, left = turning_limits(near, (0.0, 0.0, 0.0), circle, radius, certainty)
        masked_histogram(blocked, heading, right, left, masked)
        found = free_slots(masked, 0.5, slots)
        if found > 0 or circle == 0.0:
            break
        must_slow, circle = True, 0.0
    n = slot_directions(slots, found, density.size, widest, 0.5 * widest, target, directions)
    return found, n, must_slow and n > 0, density_ahead(density, heading)
