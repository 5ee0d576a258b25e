"""Known space around a robot: where it was within the last metres, and what its sensors saw as free there.

A periodic grid in the odometry frame: a cell represents every place that is a whole number of grid sizes away. Entries
reach less far than the grid, and expire before the robot can reach the next place of the same cell.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["SeenSpace"]

Floats = NDArray[np.float64]

SIZE = 256
"""Cells per side, a power of two."""
CELL = 0.05
"""Edge of a cell, m."""
REACH = 3.0
"""How far from the sensor free space is entered, m."""
SLACK = 0.1
"""Distance from seen space within which space counts as seen, m: the gaps between the cones of a ring are free."""
FURTHER = 1e-4
"""Motion into unknown space that counts as rounding, m."""
NEVER = -1e9
BESIDE = 2
"""Cells next to a sonar that an echo below its minimum range does not affect: the robot's edge is there."""
TAKEN = NEVER + 1.0
"""`looked` entry of a cell that became unknown because a sonar reported an echo nearer than its minimum range."""


class SeenSpace:
    """Known space in the odometry frame.

    Args:
        footprint: (n, 2) corners, m, base frame.
        memory: Travelled distance for which space stays known, m.
        fresh: A cell that a sensor looked at within this time is left to the echoes, s.
    """

    def __init__(self, footprint: Floats, memory: float, fresh: float) -> None:
        self.memory, self.fresh = memory, fresh
        self._free = np.full((SIZE, SIZE), NEVER)
        self._stood = np.full((SIZE, SIZE), NEVER)
        self._looked = np.full((SIZE, SIZE), NEVER)
        self._assumed = np.zeros((SIZE, SIZE), np.bool_)
        self.rim, self.outward = _rim(footprint)
        self._radius = float(np.hypot(footprint[:, 0], footprint[:, 1]).max())
        self._has_begun = False

    def stand(self, pose: Floats, way: float) -> None:
        """Mark the footprint at a pose (3,), m and rad, after a way, m. At the start, the room to turn is assumed to be
        free until a sensor says otherwise.
        """
        if not self._has_begun:
            self._has_begun = True
            # Otherwise a robot that cannot see behind itself could never turn on the spot.
            angles = np.arange(0.0, 2.0 * math.pi, CELL / (2.0 * self._radius))
            for radius in np.arange(0.0, self._radius + CELL, 0.5 * CELL):
                ring = np.stack([pose[0] + radius * np.cos(angles), pose[1] + radius * np.sin(angles)], axis=1)
                # What stands there, seen by no sensor and on no map, is touched: a box behind a laser of 270° at the
                # start.
                _assume(self._stood, self._assumed, ring, way)
        _stand(self._stood, self._assumed, self.rim, pose, way)

    def look(self, poses: Floats, beams: tuple[Floats, Floats, Floats, Floats], limits: Floats, at: Floats) -> None:
        """Enter a scan.

        Args:
            poses: (n, 3) poses of the base, m and rad, odometry frame, at the time of each beam.
            beams: Origins (n, 2), bearings, half angles and ranges, as in `RangeScan`.
            limits: (2,) range_min and range_max, m.
            at: (2,) time, s, and way, m.
        """
        # Separate arrays instead of objects, because numba compiles kernels for arrays.
        known = (self._free, self._stood, self._looked, self._assumed)
        _look(*known, poses, *beams, limits, np.array([*at, at[1] - self.memory]))

    def first_unseen(self, poses: Floats, count: int, base: Floats, time: float, way: float) -> int:
        """Index of the first pose of a roll-out that enters unknown space; -1 for none.

        Where the footprint is already in unknown space, only motion farther into it counts.

        Args:
            poses: (count or more, 3) in the frame of `base`, m and rad.
            count: Number of poses.
            base: (3,) pose of the base in the odometry frame, m and rad.
            time: Run time, s.
            way: Distance travelled so far, m.
        """
        since = (way - self.memory, time - self.fresh)
        known = (self._free, self._stood, self._looked)
        return int(_first_unseen(*known, self.rim, self.outward, poses, count, base, *since))


def _rim(footprint: Floats) -> tuple[Floats, Floats]:
    """(k, 2) points on the outline, at most a cell apart, m, and (k, 2) unit directions away from the origin."""
    points = []
    for start, end in zip(footprint, np.roll(footprint, -1, axis=0), strict=True):
        steps = max(1, math.ceil(math.dist(start, end) / CELL))
        points += [start + (end - start) * k / steps for k in range(steps)]
    rim = np.array(points)
    return rim, rim / np.hypot(rim[:, 0], rim[:, 1])[:, None]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _cell(value):  # type: ignore[no-untyped-def]
    # `floor` and not `int`, which would put both sides of 0 into one cell; the mask is the remainder, but faster.
    return math.floor(value / CELL) & (SIZE - 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _assume(stood, assumed, points, way):  # type: ignore[no-untyped-def]
    """Mark cells as occupied by the robot before, by assumption."""
    for i in range(points.shape[0]):
        row, column = _cell(points[i, 1]), _cell(points[i, 0])
        stood[row, column], assumed[row, column] = way, True


@njit(cache=True, nogil=True, error_model="numpy")
def _stand(stood, assumed, rim, pose, way):  # type: ignore[no-untyped-def]
    """Mark the cells under the outline; the outline covered the inner cells earlier."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    for i in range(rim.shape[0]):
        x = pose[0] + cos * rim[i, 0] - sin * rim[i, 1]
        y = pose[1] + sin * rim[i, 0] + cos * rim[i, 1]
        stood[_cell(y), _cell(x)], assumed[_cell(y), _cell(x)] = way, False


@njit(cache=True, nogil=True, error_model="numpy")
def _look(free, stood, looked, assumed, poses, origins, bearings, half_angles, ranges, limits, at):  # type: ignore[no-untyped-def]
    """Enter the cells that each beam read through as free.

    If a sonar reports an echo nearer than its minimum range, its cells up to there become unknown, except those that a
    beam read through recently. `at` is time, s, way, m, and the way from which on entries still count, m.
    """
    for i in range(ranges.shape[0]):
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        x = poses[i, 0] + cos * origins[i, 0] - sin * origins[i, 1]
        y = poses[i, 1] + sin * origins[i, 0] + cos * origins[i, 1]
        axis = poses[i, 2] + bearings[i]
        far = min(ranges[i], limits[1], REACH)
        echo = ranges[i] < limits[1] and ranges[i] <= REACH
        # A sonar measures nothing below its minimum, so that the echo may come from anywhere within it; as free space,
        # it would let a square robot turn its corner into a wall.
        is_near = half_angles[i] > 0.0 and ranges[i] <= limits[0]
        rays = math.ceil(2.0 * half_angles[i] * far / CELL) + 1
        for ray in range(rays):
            angle = axis + (half_angles[i] * (2.0 * ray / (rays - 1) - 1.0) if rays > 1 else 0.0)
            step_x, step_y = CELL * math.cos(angle), CELL * math.sin(angle)
            steps = int(far / CELL)
            for k in range(BESIDE if is_near else 0, steps):
                row, column = _cell(y + k * step_y), _cell(x + k * step_x)
                if not is_near:
                    free[row, column], looked[row, column] = at[1], at[0]
                # What another beam read through on its way stays free.
                elif free[row, column] < at[2]:
                    free[row, column], looked[row, column] = NEVER, TAKEN
                    # Where the robot really stood it stays known; only the room to turn was an assumption.
                    if assumed[row, column]:
                        stood[row, column], assumed[row, column] = NEVER, False
            if echo:
                row = _cell(y + far * math.sin(angle))
                column = _cell(x + far * math.cos(angle))
                looked[row, column] = at[0]
                # The end of a sonar's cone is an arc of which one point reflects: the rest may well be free.
                if half_angles[i] == 0.0:
                    free[row, column] = NEVER


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _is_unknown(free, stood, looked, x, y, since_way, since_time):  # type: ignore[no-untyped-def]
    row, column = _cell(y), _cell(x)
    # What a sensor looks at now is judged by its echoes, not by this grid.
    if looked[row, column] >= since_time or max(free[row, column], stood[row, column]) >= since_way:
        return False
    if free[row, column] == NEVER and looked[row, column] > NEVER:
        return True
    return (
        free[row, _cell(x + SLACK)] < since_way
        and free[row, _cell(x - SLACK)] < since_way
        and free[_cell(y + SLACK), column] < since_way
        and free[_cell(y - SLACK), column] < since_way
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _first_unseen(  # type: ignore[no-untyped-def]
    free, stood, looked, rim, outward, poses, count, base, since_way, since_time
):
    starts, began = np.empty((rim.shape[0], 2)), np.zeros(rim.shape[0], np.bool_)
    cos_base, sin_base = math.cos(base[2]), math.sin(base[2])
    for place in range(count):
        heading = base[2] + poses[place, 2]
        x = base[0] + cos_base * poses[place, 0] - sin_base * poses[place, 1]
        y = base[1] + sin_base * poses[place, 0] + cos_base * poses[place, 1]
        cos, sin = math.cos(heading), math.sin(heading)
        for i in range(rim.shape[0]):
            px = x + cos * rim[i, 0] - sin * rim[i, 1]
            py = y + sin * rim[i, 0] + cos * rim[i, 1]
            is_unknown = _is_unknown(free, stood, looked, px, py, since_way, since_time)
            if place == 0:
                starts[i, 0], starts[i, 1], began[i] = px, py, is_unknown
            elif is_unknown:
                dx, dy = px - starts[i, 0], py - starts[i, 1]
                away_x = cos_base * outward[i, 0] - sin_base * outward[i, 1]
                away_y = sin_base * outward[i, 0] + cos_base * outward[i, 1]
                # A robot whose edge is already in unknown space may still leave it.
                if not began[i] or dx * away_x + dy * away_y > FURTHER:
                    return place
    return -1
