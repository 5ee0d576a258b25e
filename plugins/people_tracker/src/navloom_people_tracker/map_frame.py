"""Tracks in the map frame."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["in_map"]

Floats = NDArray[np.float64]


def in_map(
    means: Floats, covariances: Floats, odometry_to_map: Floats, robot: Floats, pose_covariance: Floats
) -> tuple[Floats, Floats]:
    """States (n, 4) and covariances (n, 4, 4) in the map frame, with the uncertainty of the robot's pose.

    Args:
        means, covariances: x, y, m, vx, vy, m/s, odometry frame.
        odometry_to_map: (3,) pose of the odometry frame in the map frame, m, rad.
        robot: (3,) pose of the robot in the odometry frame, m, rad.
        pose_covariance: (3, 3) of the robot's x, y, m, heading, rad, map frame.
    """
    c, s = math.cos(odometry_to_map[2]), math.sin(odometry_to_map[2])
    turn = np.zeros((4, 4))
    turn[:2, :2] = turn[2:, 2:] = [[c, -s], [s, c]]
    found = means @ turn.T
    away = found[:, :2] - robot[:2] @ turn[:2, :2].T
    found[:, :2] += odometry_to_map[:2]
    # An error of the heading turns position and velocity round the robot.
    lever = np.zeros((len(means), 4, 3))
    lever[:, 0, 0] = lever[:, 1, 1] = 1.0
    lever[:, :, 2] = np.column_stack([-away[:, 1], away[:, 0], -found[:, 3], found[:, 2]])
    return found, turn @ covariances @ turn.T + lever @ pose_covariance @ lever.transpose(0, 2, 1)
