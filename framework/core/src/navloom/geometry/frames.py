"""Rigid motions of the plane, SE(2), as arrays whose last axis is x, y, m, and heading, rad.

A motion is named after the frames that it joins: `base_to_map` is the pose of the base in the map, and transforms
points from the base frame to the map frame. All functions broadcast over leading axes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navloom.geometry.angles import wrap

__all__ = ["compose", "inverse", "transform"]

Floats = NDArray[np.float64]


def transform(base_to_map: ArrayLike, points_in_base: ArrayLike) -> Floats:
    """Transform points from the base frame to the map frame.

    Args:
        base_to_map: (..., 3) x, y, m, and heading, rad.
        points_in_base: (..., n, 2) m; (2,) for one point of one motion.

    Returns:
        (..., n, 2) m, map frame; (2,) for one point of one motion.
    """
    motion = np.asarray(base_to_map, dtype=np.float64)
    points = np.asarray(points_in_base, dtype=np.float64)
    if points.ndim > 1:
        motion = motion[..., None, :]
    cosine, sine = np.cos(motion[..., 2]), np.sin(motion[..., 2])
    x = motion[..., 0] + cosine * points[..., 0] - sine * points[..., 1]
    y = motion[..., 1] + sine * points[..., 0] + cosine * points[..., 1]
    return np.stack([x, y], axis=-1)


def compose(base_to_map: ArrayLike, laser_to_base: ArrayLike) -> Floats:
    """`laser_to_map`: the motion that first does `laser_to_base`, then `base_to_map`.

    Args:
        base_to_map, laser_to_base: (..., 3) x, y, m, and heading, rad.

    Returns:
        (..., 3), heading in [-π, π).
    """
    outer = np.asarray(base_to_map, dtype=np.float64)
    inner = np.asarray(laser_to_base, dtype=np.float64)
    cosine, sine = np.cos(outer[..., 2]), np.sin(outer[..., 2])
    x = outer[..., 0] + cosine * inner[..., 0] - sine * inner[..., 1]
    y = outer[..., 1] + sine * inner[..., 0] + cosine * inner[..., 1]
    return np.stack([x, y, wrap(np.asarray(outer[..., 2] + inner[..., 2]))], axis=-1)


def inverse(base_to_map: ArrayLike) -> Floats:
    """`map_to_base`: the motion that undoes `base_to_map`.

    Args:
        base_to_map: (..., 3) x, y, m, and heading, rad.

    Returns:
        (..., 3), heading in [-π, π).
    """
    motion = np.asarray(base_to_map, dtype=np.float64)
    cosine, sine = np.cos(motion[..., 2]), np.sin(motion[..., 2])
    x = -cosine * motion[..., 0] - sine * motion[..., 1]
    y = sine * motion[..., 0] - cosine * motion[..., 1]
    return np.stack([x, y, wrap(np.asarray(-motion[..., 2]))], axis=-1)
