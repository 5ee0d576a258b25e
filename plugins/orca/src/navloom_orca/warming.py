"""Compilation of every kernel before the first tick."""

from __future__ import annotations

import numpy as np
from navloom_avoidance.beams import Beams
from navloom_avoidance.bodies import TrackedBodies
from navloom_avoidance.robot import Robot
from navloom_dwa.avoidance import Given

from navloom_orca.avoidance import Reciprocal
from navloom_orca.params import OrcaParams


def warm_up() -> None:
    """Run ticks with a laser, sonars and a track."""
    square = np.array([[0.4, 0.4], [-0.4, 0.4], [-0.4, -0.4], [0.4, -0.4]])
    method = Reciprocal(OrcaParams(), Robot(square, 0.5, 0.4, 0.5, 1.0, half_track=0.3), 0.05)
    arrays = np.zeros((3, 2)), np.linspace(-1.0, 1.0, 3), np.full(3, 0.2), np.full(3, 0.6)
    cones = Beams.fixed(*arrays, np.tile([0.3, 4.0], (3, 1)), np.zeros(3, np.int64))
    laser = Beams.fixed(*arrays, np.tile([0.1, 8.0], (3, 1)), np.zeros(3, np.int64))
    bodies = TrackedBodies(np.array([[2.0, 0.0]]), np.array([[-1.0, 0.0]]), np.full(1, 0.3), 0.01 * np.eye(4)[None])
    for time in (0.0, 0.05, 0.1):
        method.step([laser], cones, Given(time, (0.0, 0.0, 0.0), (0.0, 0.0), (3.0, 0.0), 1.0, 1.0, bodies))
