"""Coarse search for other poses near a given one at which a scan fits the map, best first."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from navloom_scans.field import DistanceField, distance_field

__all__ = ["candidates", "warm_up"]

Floats = NDArray[np.float64]

_STEP, _TURN = 0.1, math.radians(2.5)
"""Spacing of the positions and headings that are tried, m and rad."""
_WIDTH = 0.25
"""Misfit from which a beam does not support a pose, m: half a step and half a turn move an end point this far."""
_BEAMS = 90
"""About how many beams are used: enough to separate poses roughly."""
_APART, _TURNED = 3, 3
"""Least difference of two candidates, in steps of position or in steps of heading."""


@njit(cache=True, nogil=True, error_model="numpy")
def _scores(values, frame, points, pose, step, turn, width, scores):  # type: ignore[no-untyped-def]
    """Score of the points at each pose of a lattice around a pose.

    Args:
        values, frame: Attributes of a `DistanceField`.
        points: (n, 2) end points, m, base frame.
        pose: (3,) middle of the lattice: x, y, m, heading, rad, map frame.
        step, turn: Spacing of the lattice, m and rad.
        width: Misfit from which a point adds nothing, m; a perfect fit adds 1.
        scores: (2 k + 1, 2 m + 1, 2 m + 1) filled, indexed by heading, y and x.
    """
    half_turns, half_steps = scores.shape[0] // 2, scores.shape[1] // 2
    c, s, per_metre = frame[2], frame[3], 1.0 / frame[4]
    rows, columns = values.shape
    for k in range(scores.shape[0]):
        heading = pose[2] + (k - half_turns) * turn
        ch, sh = math.cos(heading), math.sin(heading)
        for j in range(scores.shape[1]):
            for i in range(scores.shape[2]):
                x0 = pose[0] + (i - half_steps) * step - frame[0]
                y0 = pose[1] + (j - half_steps) * step - frame[1]
                total = 0.0
                for n in range(points.shape[0]):
                    x = x0 + ch * points[n, 0] - sh * points[n, 1]
                    y = y0 + sh * points[n, 0] + ch * points[n, 1]
                    u, v = (c * x + s * y) * per_metre + 0.5, (c * y - s * x) * per_metre + 0.5
                    if 0.0 <= u < columns and 0.0 <= v < rows:
                        misfit = abs(values[np.int64(v), np.int64(u)])
                        if misfit < width:
                            total += 1.0 - misfit / width
                scores[k, j, i] = total


def candidates(
    field: DistanceField, beams: Floats, pose: Floats, reach: float, turn: float, count: int, coarse: int = 1
) -> Floats:
    """Poses on a lattice around a pose at which the beams fit best.

    Args:
        field: Distance field of the map.
        beams: (n, 4) end point, m, and direction, base frame.
        pose: (3,) x, y, m, heading, rad, map frame.
        reach: Half the width of the search along x and y, m.
        turn: Largest change of heading in the search, rad.
        count: Largest number of poses returned.
        coarse: Multiple of the usual spacing of the lattice, and of the misfit that is allowed.

    Returns:
        (k, 3) poses, the best first, each apart from the others in position or heading.
    """
    points = np.ascontiguousarray(beams[:: max(1, len(beams) // _BEAMS), :2])
    step, angle = coarse * _STEP, coarse * _TURN
    steps, turns = round(reach / step), round(turn / angle)
    scores = np.empty((2 * turns + 1, 2 * steps + 1, 2 * steps + 1))
    _scores(field.values, field.frame, points, pose, step, angle, coarse * _WIDTH, scores)
    found = []
    for _ in range(count):
        k, j, i = (int(n) for n in np.unravel_index(int(np.argmax(scores)), scores.shape))
        if scores[k, j, i] <= 0.0:
            break
        found.append([pose[0] + (i - steps) * step, pose[1] + (j - steps) * step, pose[2] + (k - turns) * angle])
        near_k, near_j = slice(max(0, k - _TURNED + 1), k + _TURNED), slice(max(0, j - _APART + 1), j + _APART)
        # Neighbours of the best would be all further candidates otherwise.
        scores[near_k, near_j, max(0, i - _APART + 1) : i + _APART] = 0.0
    return np.array(found).reshape(-1, 3)


def warm_up() -> None:
    """Compile the kernel."""
    field = distance_field(np.eye(3, dtype=np.bool_), 0.1, (0.0, 0.0, 0.0), 1.0)
    candidates(field, np.array([[0.1, 0.1, 1.0, 0.0]]), np.zeros(3), 0.1, 0.05, 1)
