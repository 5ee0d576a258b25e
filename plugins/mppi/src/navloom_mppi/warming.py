"""Compilation of every kernel before the first tick."""

from __future__ import annotations

import numpy as np
from navloom_avoidance.beams import Beams
from navloom_avoidance.robot import Robot

from navloom_mppi.control import Given, PathIntegral
from navloom_mppi.params import MppiParams


def warm_up() -> None:
    """Run ticks with a laser and sonars, and draw the last."""
    square = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
    robot = Robot(square, 0.5, 0.4, 0.5, 1.0, half_track=0.3)
    bearings = np.linspace(-1.0, 1.0, 3)
    arrays = np.zeros((3, 2)), bearings, np.full(3, 0.2), np.full(3, 0.6)
    cones = Beams.fixed(*arrays, np.tile([0.3, 4.0], (3, 1)), np.zeros(3, np.int64))
    laser = Beams.fixed(*arrays, np.tile([0.1, 8.0], (3, 1)), np.zeros(3, np.int64))
    method = PathIntegral(MppiParams(samples=4), robot, 0.05, np.random.default_rng(0))
    path = np.array([[0.0, 0.0], [3.0, 0.0]])
    for time in (0.0, 0.05, 0.1):
        method.step([laser], cones, Given(time, (0.0, 0.0, 0.0), (0.0, 0.0), path))
    method.drawn()
