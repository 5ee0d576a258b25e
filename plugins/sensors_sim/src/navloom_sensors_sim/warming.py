"""Compiles every kernel with the types of a run, or loads it from the cache, so that no control tick compiles."""

from __future__ import annotations

import numpy as np

from navloom_sensors_sim.beams import read_cones, read_laser
from navloom_sensors_sim.casting import Obstacles, cast_block
from navloom_sensors_sim.clearance import clearance_at
from navloom_sensors_sim.motion import STATE, drive_tick, omni_tick, steer_tick
from navloom_sensors_sim.sweeping import read_frames

__all__ = ["warm_up"]


def warm_up() -> None:
    """Run each kernel once in an empty world."""
    obstacles = Obstacles(np.zeros((0, 9)), np.zeros((0, 6)), np.zeros((0, 0), np.float32), np.zeros(7))
    rays, ranges, track = np.ones((3, 1)), np.empty(1), np.zeros((2, 6))
    footprint = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
    at = np.zeros(len(STATE))
    drive_tick(at, track, np.ones(8), np.ones(5), np.zeros(2), np.zeros(2), footprint, 1.0, obstacles)
    steer_tick(at, track, np.ones(12), np.ones(5), np.zeros(2), np.zeros(2), footprint, 1.0, obstacles)
    omni_tick(at, np.zeros((2, 7)), np.ones(8), np.ones(5), np.zeros(3), np.zeros(3), footprint, 1.0, obstacles)
    clearance_at(at[0], at[1], at[2], footprint, 1.0, obstacles)
    cast_block(rays, rays, obstacles, True, 1.0, ranges, np.empty(1, np.int64))
    read_laser(at, rays, rays, obstacles, np.ones(5), np.zeros(1), ranges)
    read_cones(at, rays, rays, obstacles, np.ones(6), False, np.zeros(1), np.ones((1, 3)), ranges)
    read_frames(track, np.zeros(1), np.ones(3), rays[None], obstacles, np.ones(4), np.zeros((1, 1)), np.empty((1, 1)))
