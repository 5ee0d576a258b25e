"""Recently seen surfaces, as a signed distance averaged over many scans.

Curless and Levoy 1996, in the plane: each beam measures how far the lattice nodes near its end are before or behind the
surface. The zero of the mean over many beams locates the surface far more precisely than one noisy reading.
"""

from __future__ import annotations

import math

import numpy as np
from navloom_scans.field import DistanceField
from numba import njit
from numpy.typing import NDArray

__all__ = ["LocalSurface", "warm_up"]

Floats = NDArray[np.float64]

_CLEARING = 0.2
"""Weight of a beam that passes through a node, relative to one that ends near it: it may only graze a thin post."""


class LocalSurface:
    """A square lattice of signed distances around the robot; it follows the robot and drops what it leaves.

    Attributes:
        field: Field for `matching.fit_pose`; NaN if nothing was seen. `add` and `follow` change it in place.
    """

    def __init__(self, spacing: float, reach: float, before: float, behind: float, memory: float) -> None:
        """Create an empty lattice.

        Args:
            spacing: Distance between neighbouring nodes, m.
            reach: The lattice extends at least this far on each side of the robot, m.
            before, behind: Depth of a surface towards the sensor and away from it, m.
            memory: Highest weight of a node, in beams: about how many of the last beams count.
        """
        self.spacing, self.before, self.behind, self.memory = spacing, before, behind, memory
        self._half = math.ceil(1.5 * reach / spacing)
        self._slack = 0.5 * reach
        count = 2 * self._half + 1
        self._values = np.full((count, count), np.nan, np.float32)
        self._weights = np.zeros((count, count), np.float32)
        self._frame = np.array([-self._half * spacing, -self._half * spacing, 1.0, 0.0, spacing])
        # Read-only as that of a map is: numba compiles a kernel again for a writable array.
        shown = self._values.view()
        shown.flags.writeable = False
        self.field = DistanceField(shown, self._frame)

    def follow(self, x: float, y: float) -> None:
        """Move the lattice by whole nodes if a point, m, map frame, is far from its middle."""
        middle = self._frame[:2] + self._half * self.spacing
        if max(abs(x - middle[0]), abs(y - middle[1])) <= self._slack:
            return
        columns, rows = round((x - middle[0]) / self.spacing), round((y - middle[1]) / self.spacing)
        self._frame[:2] += self.spacing * columns, self.spacing * rows
        _shift(self._values, rows, columns, np.float32(np.nan))
        _shift(self._weights, rows, columns, np.float32(0.0))

    def add(self, beams: Floats, pose: Floats) -> None:
        """Add the beams of one scan to the averages.

        Args:
            beams: (n, 4) end point, m, and unit direction, base frame.
            pose: (3,) pose of the base, x, y, m, heading, rad, map frame.
        """
        _add(self._values, self._weights, self._frame, beams, pose, self.before, self.behind, self.memory)


def _shift(array: NDArray[np.float32], rows: int, columns: int, empty: np.float32) -> None:
    """Move the values of [r + rows, c + columns] to [r, c]; cells without a source become `empty`."""
    kept = np.full_like(array, empty)
    height, width = array.shape
    if abs(rows) < height and abs(columns) < width:
        kept[max(0, -rows) : height - max(0, rows), max(0, -columns) : width - max(0, columns)] = array[
            max(0, rows) : height - max(0, -rows), max(0, columns) : width - max(0, -columns)
        ]
    array[:] = kept


@njit(cache=True, nogil=True, error_model="numpy")
def _add(values, weights, frame, beams, pose, before, behind, memory):  # type: ignore[no-untyped-def]
    """Update the nodes along each beam, from its point nearest to the base to `behind` its end."""
    c, s, spacing = math.cos(pose[2]), math.sin(pose[2]), frame[4]
    rows, columns = values.shape
    for i in range(beams.shape[0]):
        x = pose[0] + c * beams[i, 0] - s * beams[i, 1] - frame[0]
        y = pose[1] + s * beams[i, 0] + c * beams[i, 1] - frame[1]
        dx, dy = c * beams[i, 2] - s * beams[i, 3], s * beams[i, 2] + c * beams[i, 3]
        length = max(0.0, beams[i, 0] * beams[i, 2] + beams[i, 1] * beams[i, 3])
        last_row, last_column, steps = -1, -1, int((length + behind) / (0.5 * spacing)) + 1
        for k in range(steps + 1):
            along = 0.5 * spacing * k - length
            column, row = math.floor((x + along * dx) / spacing + 0.5), math.floor((y + along * dy) / spacing + 0.5)
            if (row == last_row and column == last_column) or not (0 <= row < rows and 0 <= column < columns):
                continue
            last_row, last_column = row, column
            distance = (x - column * spacing) * dx + (y - row * spacing) * dy
            if distance < -behind:
                break
            weight, old = 1.0, weights[row, column]
            if distance > before:
                if old == 0.0:
                    continue
                distance, weight = before, _CLEARING
            if old == 0.0:
                values[row, column] = distance
            else:
                values[row, column] += weight / (old + weight) * (distance - values[row, column])
            weights[row, column] = min(memory, old + weight)


def warm_up() -> None:
    """Compile the kernel for its array types."""
    surface = LocalSurface(0.05, 0.5, 0.1, 0.1, 10.0)
    surface.add(np.array([[0.2, 0.0, 1.0, 0.0]]), np.zeros(3))
