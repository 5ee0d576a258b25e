"""Known space of tests: robots that stand in it, beams that look into it, and questions about its cells."""

from __future__ import annotations

import copy
import math

import numpy as np
from navloom.navigation.monitor_known_space import SeenSpace
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MEMORY, FRESH = 5.0, 0.5
CELL = 0.05
ACROSS = 12.8
"""Size of the grid, m: 256 cells of 5 cm."""
NORTH = 0.5 * math.pi
RISING = math.atan2(0.6, 0.8)
"""A direction of cosine 0.8 and sine 0.6."""
DOT = np.array([(0.001, 0.001), (-0.001, 0.001), (-0.001, -0.001), (0.001, -0.001)])
"""A footprint that is within one cell."""


def centre(x: float, y: float) -> tuple[float, float]:
    """Centre of the cell of a place, m."""
    return (math.floor(x / CELL) + 0.5) * CELL, (math.floor(y / CELL) + 0.5) * CELL


def knows(space: SeenSpace, x: float, y: float, time: float = 0.0, way: float = 0.0) -> bool:
    """Whether a robot of no size that comes from 1 m to the left may go to a place."""
    probe = copy.copy(space)
    probe.rim, probe.outward = np.zeros((1, 2)), np.array([(1.0, 0.0)])
    return probe.first_unseen(np.array([(-1.0, 0.0, 0.0), (0.0, 0.0, 0.0)]), 2, np.array([x, y, 0.0]), time, way) < 0


def look(
    space: SeenSpace,
    bearing: float,
    distance: float,
    half: float = 0.0,
    origin: tuple[float, float] = (0.0, 0.0),
    base: tuple[float, float, float] = (0.025, 0.025, 0.0),
    limits: tuple[float, float] = (0.2, 4.0),
    at: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Enter a scan of one beam."""
    beam = np.array([origin]), np.array([bearing]), np.array([half]), np.array([distance])
    space.look(np.array([base]), beam, np.array(limits), np.array(at))


def known_cells(space: SeenSpace, reach: float, **at: float) -> set[tuple[int, int]]:
    """Columns and rows of the known cells about the origin of the odometry, as far as a reach, m."""
    cells = range(-round(reach / CELL), round(reach / CELL))
    return {(i, k) for i in cells for k in cells if knows(space, (i + 0.5) * CELL, (k + 0.5) * CELL, **at)}


def stood(*places: tuple[float, float], way: float = 0.0) -> SeenSpace:
    """A space in which a robot of no size stood far away first, and then in some places."""
    space = SeenSpace(DOT, MEMORY, FRESH)
    space.stand(np.array([5.0, -5.0, 0.0]), -100.0)
    for x, y in places:
        space.stand(np.array([x, y, 0.0]), way)
    return space
