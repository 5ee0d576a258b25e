"""Obstacles near the robot: remembered points of lasers and cells of sonars, each with its margin."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_avoidance.beams import Beams
from navloom_avoidance.certainty import insert_beams, new_window, occupied_cells, place_beams
from navloom_avoidance.points import obstacles_in_base, remember
from navloom_avoidance.smoothing import smoothed
from navloom_avoidance.support import new_record

Floats = NDArray[np.float64]
Pose = tuple[float, float, float]
MOST_OBSTACLES, MOST_POINTS = 4096, 8192


@dataclass(frozen=True)
class EchoSettings:
    """What is remembered, and how far.

    Attributes:
        margins: Margins for laser points and for sonar cells, m. memory: How long points out of sight count, s.
        reach: Points farther away are dropped, m. spacing: One remembered point is kept in a square of this side, m.
        agreement: Neighbouring readings of a laser this near to each other are averaged, m; 0 for none.
        cone_cell, cone_window: Side of a cell of the sonars' window, m, and cells along its side.
        cone_reach: Sonar arcs count up to here from the base, m; axes always.
        explained: A sonar's echo adds nothing to a laser point this near to its arc, m.
        blind_depth: An echo at range_min counts this far before it too, m.
    """

    margins: tuple[float, float]
    memory: float
    reach: float
    spacing: float = 0.03
    agreement: float = 0.1
    cone_cell: float = 0.1
    cone_window: int = 41
    cone_reach: float = 0.95
    blind_depth: float = 0.25
    explained: float = 0.1


@njit(cache=True, nogil=True)
def limits_of_unexplained(
    points: Floats,
    pose: Pose,
    origins: Floats,
    bearings: Floats,
    half_angles: Floats,
    ranges: Floats,
    limits: Floats,
    tolerance: float,
    margin: float,
) -> Floats:
    """Limits with which sonars whose echo a laser explains give free space up to it, and no echo.

    An arc spans what a laser sees as an opening: next to a door post it would close the door. What no laser sees,
    as glass or a table top, keeps its arc. An echo at range_min is explained by any nearer point too.

    Args:
        points: (n, 3), x, y, m, pose frame, and a time, from `points.remember`.
        pose: x, y, m, heading, rad, of the base.
        origins, bearings, half_angles, ranges, limits: Of the sonars, see `Beams`.
        tolerance: Largest distance of a point from the arc of the echo that it explains, m.
        margin: Free space ends this far before an explained echo, m.

    Returns:
        (k, 2) range_min and range_max of each sonar, m.
    """
    found = limits.copy()
    placed = place_beams(pose, origins, bearings, half_angles, ranges, limits, margin, np.inf)
    for k in range(ranges.size):
        x, y, ax, ay, _, echo, cos_half, sin_half = placed[k]
        if echo == np.inf:
            continue
        is_blind = echo <= limits[k, 0]
        for i in range(points.shape[0]):
            dx, dy = points[i, 0] - x, points[i, 1] - y
            beyond = math.sqrt(dx * dx + dy * dy) - echo
            if beyond > tolerance or (beyond < -tolerance and not is_blind):
                continue
            along, across = dx * ax + dy * ay, abs(dy * ax - dx * ay)
            if along > 0.0 and across * cos_half - along * sin_half <= tolerance:
                found[k, 1] = 0.0 if is_blind else echo - margin
                break
    return found


class Echoes:
    """Memory of what the range sensors saw, for one robot.

    Args:
        edges: Half planes of the footprint, see `clearance.footprint_edges`.
        settings: What is remembered.
    """

    def __init__(self, edges: Floats, settings: EchoSettings) -> None:
        self.edges, self.settings = edges, settings
        self._obstacles, self._gaps = np.zeros((MOST_OBSTACLES, 3)), np.zeros(MOST_OBSTACLES)
        self._points, self._cells = np.zeros((MOST_POINTS, 3)), np.zeros((settings.cone_window**2, 3))
        self._at_once = new_record(0)
        self.reset()

    def reset(self) -> None:
        """Forget every echo."""
        self._grid, self._origin = new_window(self.settings.cone_window)
        self._count, self._has_cones = 0, False

    def see(self, lasers: Sequence[Beams], cones: Beams | None, pose: Pose, time: float) -> tuple[Floats, Floats]:
        """Enter the readings of a tick.

        Args:
            lasers: Readings of each laser. cones: Readings of all sonars, or None.
            pose: x, y, m, heading, rad, of the base in the pose frame. time: s.

        Returns:
            (n, 3) x, y and margin, m, base frame, and (n,) their gaps to the footprint, m, rising; see
            `points.obstacles_in_base`. Both are overwritten in the next tick.
        """
        s = self.settings
        for beams in lasers:
            farthest = float(beams.limits[0, 1])
            ranges = smoothed(beams.ranges, farthest, s.agreement) if s.agreement > 0.0 else beams.ranges.view()
            ranges.flags.writeable = False
            self._count = remember(
                self._points, self._count, pose, beams.origins, beams.bearings, ranges, farthest, time, s.memory,
                s.reach, s.spacing, self.edges,
            )  # fmt: skip
        if cones is not None:
            self._has_cones = True
            margin = 0.5 * s.cone_cell
            limits = limits_of_unexplained(
                self._points[: self._count], pose, cones.origins, cones.bearings, cones.half_angles, cones.ranges,
                cones.limits, s.explained, margin,
            )  # fmt: skip
            insert_beams(
                self._grid, self._origin, s.cone_cell, pose, cones.origins, cones.bearings, cones.half_angles,
                cones.ranges, limits, cones.sensors, margin, s.blind_depth, True, False, self._at_once, 0,
            )  # fmt: skip
        cells = self._cells[:0]
        if self._has_cones:
            cells = self._cells[: occupied_cells(self._grid, self._origin, s.cone_cell, pose, self.edges, self._cells)]
        n = obstacles_in_base(
            self._points[: self._count], cells, s.cone_reach, pose, self.edges, s.margins, s.reach,
            self._obstacles, self._gaps,
        )  # fmt: skip
        return self._obstacles[:n], self._gaps[:n]
