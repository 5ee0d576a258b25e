"""Obstacles near the robot: remembered points of lasers and cells of sonars, each with its margin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from navloom_avoidance.beams import Beams
from navloom_avoidance.certainty import insert_beams, new_window, occupied_cells
from navloom_avoidance.smoothing import smoothed
from navloom_avoidance.support import new_record
from navloom_dwa.points import obstacles_in_base, remember
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]
MOST_OBSTACLES, MOST_POINTS = 4096, 8192
SPACING = 0.03  # m: one remembered point is kept in a square of this side
AGREEMENT = 0.1  # m: neighbouring readings of a laser this near to each other are averaged
CONE_CELL, CONE_WINDOW = 0.1, 41  # m, and cells along a side of the sonars' window
CONE_REACH = 0.95  # m: sonar arcs count up to here from the base; axes always
BLIND_DEPTH = 0.25  # m: an echo at range_min counts this far before it too


class Echoes:
    """Memory of what the range sensors saw, for one robot.

    Args:
        edges: Half planes of the footprint.
        margins: Margins for laser points and for sonar cells, m.
        memory: How long points out of sight count, s.
        reach: Points farther away are dropped, m.
    """

    def __init__(self, edges: Floats, margins: tuple[float, float], memory: float, reach: float) -> None:
        self.edges, self.margins, self.memory, self.reach = edges, margins, memory, reach
        self._obstacles, self._gaps = np.zeros((MOST_OBSTACLES, 3)), np.zeros(MOST_OBSTACLES)
        self._points, self._cells = np.zeros((MOST_POINTS, 3)), np.zeros((CONE_WINDOW**2, 3))
        self._at_once = new_record(0)
        self.reset()

    def reset(self) -> None:
        """Forget every echo."""
        self._grid, self._origin = new_window(CONE_WINDOW)
        self._count, self._has_cones = 0, False

    def see(self, lasers: Sequence[Beams], cones: Beams | None, pose: Pose, time: float) -> tuple[Floats, Floats]:
        """Enter the readings of a tick.

        Args:
            lasers: Readings of each laser. cones: Readings of all sonars, or None.
            pose: x, y, m, heading, rad, of the base in the pose frame. time: s.

        Returns:
            (n, 3) x, y and margin, m, base frame, and (n,) their gaps to the footprint, m, rising.
        """
        for beams in lasers:
            farthest = float(beams.limits[0, 1])
            ranges = smoothed(beams.ranges, farthest, AGREEMENT)
            ranges.flags.writeable = False
            self._count = remember(
                self._points, self._count, pose, beams.origins, beams.bearings, ranges, farthest, time, self.memory,
                self.reach, SPACING, self.edges,
            )  # fmt: skip
        if cones is not None:
            self._has_cones = True
            insert_beams(
                self._grid, self._origin, CONE_CELL, pose, cones.origins, cones.bearings, cones.half_angles,
                cones.ranges, cones.limits, cones.sensors, 0.5 * CONE_CELL, BLIND_DEPTH, True, False, self._at_once, 0,
            )  # fmt: skip
        cells = self._cells[:0]
        if self._has_cones:
            cells = self._cells[: occupied_cells(self._grid, self._origin, CONE_CELL, pose, self.edges, self._cells)]
        n = obstacles_in_base(
            self._points[: self._count], cells, CONE_REACH, pose, self.edges, self.margins, self.reach,
            self._obstacles, self._gaps,
        )  # fmt: skip
        return self._obstacles[:n], self._gaps[:n]
