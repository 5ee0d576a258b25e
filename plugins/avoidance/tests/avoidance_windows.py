"""Certainty windows for tests: filled by beams in degrees, read by place."""

import math

import numpy as np
from navloom_avoidance.certainty import insert_beams, new_window
from navloom_avoidance.support import new_record

CELL, SIZE = 0.1, 41
CENTRE = (0.05, 0.05, 0.0)  # the middle of cell (0, 0), which is the middle of the window


def insert(
    window, beams, pose=CENTRE, margin=0.0, depth=0.0, clears_blind=True, forgets=False, sensors=None,
    heard=None, memory=0,
):  # fmt: skip
    """Beams are rows of bearing in degrees, half angle in degrees, range; origin at the base, limits 0.3 and 4 m."""
    rows = np.array(beams, float)
    n = len(rows)
    number = np.zeros(n, np.int64) if sensors is None else np.array(sensors, np.int64)
    insert_beams(
        *window, CELL, pose, np.zeros((n, 2)), np.radians(rows[:, 0]), np.radians(rows[:, 1]), rows[:, 2].copy(),
        np.tile([0.3, 4.0], (n, 1)), number, margin, depth, clears_blind, forgets,
        new_record(0) if heard is None else heard, memory,
    )  # fmt: skip


def filled_window():
    """A window with every cell occupied and the robot at CENTRE."""
    window = new_window(SIZE)
    window[0][:], window[1][:] = 2, -20
    return window


def at(window, x, y):
    grid, origin = window
    return int(grid[math.floor(y / CELL) - origin[1], math.floor(x / CELL) - origin[0]])
