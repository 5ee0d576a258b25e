"""Presence and position of a world's obstacles at a time and height."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navloom.geometry.world import Box, Interval, Obstacle, position_at

__all__ = ["box_corners", "centre_at", "is_fixed", "is_present", "overlaps"]


def is_present(obstacle: Obstacle, time: float, sweep_ended: bool) -> bool:
    """Whether an obstacle has appeared at a run time, s; `sweep_ended`: the first stop-and-scan sweep is over."""
    return sweep_ended if obstacle.appears_after_sweep else time >= obstacle.appears_at


def is_fixed(obstacle: Obstacle) -> bool:
    """Whether an obstacle exists from the start and never moves."""
    return not obstacle.waypoints and is_present(obstacle, 0.0, False)


def overlaps(z: Interval, height: Interval) -> bool:
    """Whether two height intervals, m, share more than a point: a girder at 1.2 m lets a robot of 1.2 m pass."""
    return z[0] < height[1] and z[1] > height[0]


def centre_at(obstacle: Obstacle, time: float) -> tuple[float, float]:
    """Centre of an obstacle at a run time, s: m, map frame."""
    return position_at(obstacle.waypoints, obstacle.loops, time) if obstacle.waypoints else obstacle.centre


def box_corners(box: Box, time: float = 0.0) -> NDArray[np.float64]:
    """(4, 2) corners of a box at a run time, m, map frame, counter-clockwise."""
    x, y = centre_at(box, time)
    half_x, half_y = 0.5 * (box.x[1] - box.x[0]), 0.5 * (box.y[1] - box.y[0])
    cosine, sine = math.cos(box.yaw), math.sin(box.yaw)
    signs = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    turn = np.array([(cosine, sine), (-sine, cosine)])
    corners: NDArray[np.float64] = signs * (half_x, half_y) @ turn + (x, y)
    return corners
