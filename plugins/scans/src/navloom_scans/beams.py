"""Converts range readings to points in the base frame at one time."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["beam_points", "keep_near", "warm_up"]

Floats = NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy")
def beam_points(origins, bearings, half_angles, time_offsets, ranges, limits, motion, beams):  # type: ignore[no-untyped-def]
    """End points of the beams that locate a surface, in the base frame at the time of the odometry.

    Left out are beams without an echo, readings at a limit of the sensor, and beams too wide to locate their echo.

    Args:
        origins: (n, 2) m, base frame. bearings: (n,) rad. half_angles: (n,) rad. time_offsets: (n,) s. ranges: (n,) m.
        limits: (3,) readings must be above the first and below the second, m; widest half angle, rad.
        motion: (4,) velocity vx, vy, m/s, and wz, rad/s, base frame; time of the scan's stamp minus that of the
            odometry, s. The velocity is assumed constant in between.
        beams: (n, 4) filled from the front: x, y of the end point, m; unit direction of the beam; base frame.

    Returns:
        Number of rows filled.
    """
    count = 0
    for i in range(ranges.shape[0]):
        reading = ranges[i]
        if not limits[0] < reading < limits[1] or half_angles[i] > limits[2]:
            continue
        dx, dy = math.cos(bearings[i]), math.sin(bearings[i])
        x, y = origins[i, 0] + reading * dx, origins[i, 1] + reading * dy
        time = motion[3] + time_offsets[i]
        if time != 0.0:
            turn = motion[2] * time
            half = 0.5 * turn
            chord = time * (math.sin(half) / half if abs(half) > 1e-8 else 1.0)
            c, s, ch, sh = math.cos(turn), math.sin(turn), math.cos(half), math.sin(half)
            x, y = (
                c * x - s * y + chord * (ch * motion[0] - sh * motion[1]),
                s * x + c * y + chord * (sh * motion[0] + ch * motion[1]),
            )
            dx, dy = c * dx - s * dy, s * dx + c * dy
        beams[count, 0], beams[count, 1], beams[count, 2], beams[count, 3] = x, y, dx, dy
        count += 1
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def keep_near(beams, reach):  # type: ignore[no-untyped-def]
    """Move the rows of `beam_points` that end within a reach, m, to the front, in place; returns their number."""
    count = 0
    for i in range(beams.shape[0]):
        if math.hypot(beams[i, 0], beams[i, 1]) <= reach:
            for k in range(beams.shape[1]):
                beams[count, k] = beams[i, k]
            count += 1
    return count


def warm_up() -> None:
    """Compile the kernels for the read-only arrays of messages."""
    keep_near(np.zeros((1, 4)), 1.0)
    one, place = np.ones(1), np.zeros((1, 2))
    one.flags.writeable = place.flags.writeable = False
    beam_points(place, one, one, one, one, np.array([0.0, 2.0, 2.0]), np.zeros(4), np.empty((1, 4)))
