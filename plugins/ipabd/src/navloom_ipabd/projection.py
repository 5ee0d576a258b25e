"""Convert ranges to points, by eq. (1) of Hoang et al. 2013 or by the true geometry of a rigidly pitched laser."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navloom_ipabd.sweep import SweepImage

__all__ = ["paper_points", "project", "rigid_pitch_points"]

Floats = NDArray[np.float64]


def paper_points(ranges: Floats, pitches: Floats, bearings: Floats) -> Floats:
    """Points of a pan-tilt sensor: Hoang et al. 2013, eq. (1), rotated from y forward to x forward.

    The paper writes x = R cosα cosβ, y = R cosα sinβ, z = R sinα with y forward. With the bearing b = β - 90°,
    forward is R cosα cos b and left is R cosα sin b.

    Args:
        ranges: (frames, beams) R, m; +inf gives non-finite points.
        pitches: (frames,) α, rad, up positive.
        bearings: (beams,) b, rad, 0 ahead, counter-clockwise.

    Returns:
        (frames, beams, 3) x forward, y left, z up, m, relative to the sensor, along the axes of base.
    """
    level = ranges * np.cos(pitches)[:, None]
    height = ranges * np.sin(pitches)[:, None]
    return _stack(level * np.cos(bearings), level * np.sin(bearings), height)


def rigid_pitch_points(ranges: Floats, pitches: Floats, bearings: Floats) -> Floats:
    """Points of a planar laser that is pitched about its left axis: x = R cos b cosα, y = R sin b, z = R cos b sinα.

    For arguments and result, see `paper_points`.
    """
    cos_b = np.cos(bearings)
    forward = np.cos(pitches)[:, None] * cos_b
    up = np.sin(pitches)[:, None] * cos_b
    return _stack(ranges * forward, ranges * np.sin(bearings), ranges * up)


def project(sweep: SweepImage) -> Floats:
    """Points of a sweep in base, as if the robot had not moved.

    Returns:
        (frames, beams, 3) x, y, z, m, base frame, z above the floor. Not finite if there was no return.
    """
    points = paper_points if sweep.geometry == "paper" else rigid_pitch_points
    with np.errstate(invalid="ignore"):  # no return: inf times 0
        in_base: Floats = points(sweep.ranges, sweep.pitches, sweep.bearings) + np.asarray(sweep.mount)
    return in_base


def _stack(x: Floats, y: Floats, z: Floats) -> Floats:
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1)
