"""Recently seen surfaces, as a signed distance averaged over many scans, and free space.

Curless and Levoy 1996, in the plane: each beam measures how far the lattice nodes near its end are before or behind the
surface. The zero of the mean over many beams locates the surface far more precisely than one noisy reading.

What stands in space that beams have looked through has moved there: Wang and Thorpe 2002, "Simultaneous localization
and mapping with detection and tracking of moving objects".
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

_AHEAD = 0.1
"""How much farther than `before` from its end a beam looks through a node, m: several times the noise of a range."""
_ROUND = 2
"""Nodes round an echo that must have been free as well: beams that graze a wall look through those before it only."""
_FREE_FOR = 10.0
"""How long space counts as free after a beam looked through it, s: longer than a body takes to cross the view."""
_LEAST_ECHOES, _LEAST_WIDTH = 5, 0.15
"""Neighbouring echoes in free space, and their width, m, from which they are a body that moves and no thin post."""
_SETTLED, _LONG = 1.0, 4.0
"""Age from which a surface stands still, s: a body that moves at 0.3 m/s or more leaves its own `before` in it. And the
width from which it does at once, m: among people, a robot that sets off beside a long wall would else have nothing to
hold to for as long. Two bodies side by side are narrower."""
_WIDE, _SETTLED_NARROW = 2.0, 3.0
"""Width from which a thing is a wall and no body, m; age from which a narrower one stands still, s: bodies that turn
round come back to where they were."""
_MOSTLY = 0.75
"""Share of a narrow thing's echoes that must be on settled surfaces: the side to which a body moves is on new ones."""
_GAP = 0.5
"""Distance of neighbouring echoes from which they belong to two things, m."""


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
        # Of the surfaces that stand still, with the age of each node, both as `settled` last found them; and the first
        # column of each row that has changed since, and the one after the last.
        self._age, self._settled = np.full_like(self._values, -np.inf), np.full_like(self._values, np.nan)
        self._changed = np.empty((count, 2), np.int64)
        self._changed[:] = 0, count
        # When beams first and last ended near a node, since one looked through it, and when one last did, s.
        self._first, self._last, self._through = np.full((3, count, count), np.float32(-np.inf))
        self._first[:] = np.inf

    def follow(self, x: float, y: float) -> None:
        """Move the lattice by whole nodes if a point, m, map frame, is far from its middle."""
        middle = self._frame[:2] + self._half * self.spacing
        if max(abs(x - middle[0]), abs(y - middle[1])) <= self._slack:
            return
        columns, rows = round((x - middle[0]) / self.spacing), round((y - middle[1]) / self.spacing)
        self._frame[:2] += self.spacing * columns, self.spacing * rows
        _shift(self._values, rows, columns, np.float32(np.nan))
        _shift(self._weights, rows, columns, np.float32(0.0))
        _shift(self._first, rows, columns, np.float32(np.inf))
        _shift(self._last, rows, columns, np.float32(-np.inf))
        _shift(self._through, rows, columns, np.float32(-np.inf))
        # Scans are matched with the last settled surfaces before these are brought up to date.
        _shift(self._settled, rows, columns, np.float32(np.nan))
        _shift(self._age, rows, columns, np.float32(-np.inf))
        self._changed[:] = 0, len(self._values)

    def settled(self) -> DistanceField:
        """The field of the surfaces alone that stand still. The next call changes it in place."""
        _settle(self._values, self._first, self._last, self._changed, self._age, self._settled)
        shown = self._settled.view()
        shown.flags.writeable = False
        return DistanceField(shown, self._frame)

    def forget_unsettled(self) -> None:
        """Forget the surfaces that `settled` last found to be too young to stand still."""
        young = ~(self._age >= _SETTLED)
        self._values[young], self._weights[young] = np.nan, 0.0

    def standing(self, beams: Floats, pose: Floats, only_wide: bool = False) -> Floats:
        """Those of the echoes, (n, 4) as for `add`, of things most of which `settled` last found on settled surfaces.

        With `only_wide` of walls alone, since a thing as narrow as a body may have rested for a while.
        """
        kept = np.empty(len(beams), np.bool_)
        _mark_standing(self._age, self._frame, beams, pose, math.inf if only_wide else _SETTLED_NARROW, kept)
        found: Floats = beams[kept]
        return found

    def look(self, beams: Floats, echoes: int, pose: Floats, time: float) -> None:
        """Note where beams, (n, 4) as for `add`, the last ones without an echo, end and look through at a time, s."""
        ages = np.zeros(len(beams), np.float32)
        _mark_walls(beams[:echoes], ages)
        lattices = self._first, self._last, self._through, self._changed
        _look(*lattices, self._frame, beams, echoes, ages, pose, np.float32(time), self.before, self.behind)

    def has_moving(self, beams: Floats, pose: Floats, time: float) -> bool:
        """Whether neighbouring echoes, (n, 4) as for `add`, are where space was free before a time, s.

        Where something has stood for a second, space is not free: a post that a scan looked through, turned a little
        wrong, from far away, has not moved there.
        """
        lattices = self._through, self._first, self._last
        return bool(_has_moving(*lattices, self._frame, beams, pose, np.float32(time - _FREE_FOR)))

    def add(self, beams: Floats, pose: Floats) -> None:
        """Add the beams of one scan to the averages.

        Args:
            beams: (n, 4) end point, m, and unit direction, base frame.
            pose: (3,) pose of the base, x, y, m, heading, rad, map frame.
        """
        lattices = self._values, self._weights, self._changed
        _add(*lattices, self._frame, beams, pose, self.before, self.behind, self.memory)


def _shift(array: NDArray[np.float32], rows: int, columns: int, empty: np.float32) -> None:
    """Move the values of [r + rows, c + columns] to [r, c]; cells without a source become `empty`."""
    kept = np.full_like(array, empty)
    height, width = array.shape
    if abs(rows) < height and abs(columns) < width:
        kept[max(0, -rows) : height - max(0, rows), max(0, -columns) : width - max(0, columns)] = array[
            max(0, rows) : height - max(0, -rows), max(0, columns) : width - max(0, -columns)
        ]
    array[:] = kept


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _note(changed, row, column):  # type: ignore[no-untyped-def]
    """Note that a node has changed."""
    changed[row, 0], changed[row, 1] = min(changed[row, 0], column), max(changed[row, 1], column + 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _settle(values, first, last, changed, age, settled):  # type: ignore[no-untyped-def]
    """Bring the age of each node, s, and the values of those that are settled, NaN elsewhere, up to date."""
    for row in range(values.shape[0]):
        for column in range(changed[row, 0], changed[row, 1]):
            age[row, column] = last[row, column] - first[row, column]
            settled[row, column] = values[row, column] if age[row, column] >= _SETTLED else np.float32(np.nan)
        changed[row, 0], changed[row, 1] = values.shape[1], 0


@njit(cache=True, nogil=True, error_model="numpy")
def _add(values, weights, changed, frame, beams, pose, before, behind, memory):  # type: ignore[no-untyped-def]
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
            _note(changed, row, column)


@njit(cache=True, nogil=True, error_model="numpy")
def _look(first, last, through, changed, frame, beams, echoes, ages, pose, time, before, behind):  # type: ignore[no-untyped-def]
    """Set the times of the nodes along each beam, from its point nearest to the base to `behind` its end.

    A surface that is seen for the first time has the age of its beam in `ages`, (n,), s.
    """
    c, s, spacing = math.cos(pose[2]), math.sin(pose[2]), frame[4]
    rows, columns = through.shape
    for i in range(beams.shape[0]):
        x = pose[0] + c * beams[i, 0] - s * beams[i, 1] - frame[0]
        y = pose[1] + s * beams[i, 0] + c * beams[i, 1] - frame[1]
        dx, dy = c * beams[i, 2] - s * beams[i, 3], s * beams[i, 2] + c * beams[i, 3]
        length = beams[i, 0] * beams[i, 2] + beams[i, 1] * beams[i, 3]
        for k in range(int((length + behind) / spacing) + 1):
            along = spacing * k - length
            column, row = math.floor((x + along * dx) / spacing + 0.5), math.floor((y + along * dy) / spacing + 0.5)
            if not (0 <= row < rows and 0 <= column < columns):
                continue
            if along < -before - _AHEAD:
                through[row, column] = time
                if first[row, column] != np.inf:
                    first[row, column] = np.inf
                    _note(changed, row, column)
            elif i < echoes and along >= -before:
                # Unseen for as long as it takes to settle, it may be another body by now.
                if first[row, column] == np.inf or time - last[row, column] > _SETTLED_NARROW:
                    first[row, column] = time - ages[i]
                last[row, column] = time
                _note(changed, row, column)


@njit(cache=True, nogil=True, error_model="numpy")
def _group(beams, begin):  # type: ignore[no-untyped-def]
    """Index after the group of neighbouring echoes that begins at an index, and the group's width, m."""
    end = begin + 1
    while (
        end < beams.shape[0]
        and math.hypot(beams[end, 0] - beams[end - 1, 0], beams[end, 1] - beams[end - 1, 1]) <= _GAP
    ):
        end += 1
    return end, math.hypot(beams[end - 1, 0] - beams[begin, 0], beams[end - 1, 1] - beams[begin, 1])


@njit(cache=True, nogil=True, error_model="numpy")
def _mark_walls(beams, ages):  # type: ignore[no-untyped-def]
    """Fill `ages`, (n,), s, for groups of neighbouring echoes that are as wide as a long wall."""
    begin = 0
    while begin < beams.shape[0]:
        end, width = _group(beams, begin)
        if width >= _LONG:
            ages[begin:end] = _SETTLED
        begin = end


@njit(cache=True, nogil=True, error_model="numpy")
def _has_moving(through, first, last, frame, beams, pose, since):  # type: ignore[no-untyped-def]
    """Whether enough neighbouring echoes are where all nodes round them were looked through since a time, s.

    Nodes where something has settled since do not count as looked through.
    """
    c, s, spacing = math.cos(pose[2]), math.sin(pose[2]), frame[4]
    rows, columns, run, begin = through.shape[0], through.shape[1], 0, 0
    for i in range(beams.shape[0]):
        x, y = pose[0] + c * beams[i, 0] - s * beams[i, 1], pose[1] + s * beams[i, 0] + c * beams[i, 1]
        column, row = math.floor((x - frame[0]) / spacing + 0.5), math.floor((y - frame[1]) / spacing + 0.5)
        is_free = _ROUND <= row < rows - _ROUND and _ROUND <= column < columns - _ROUND
        for k in range((2 * _ROUND + 1) ** 2 if is_free else 0):
            down, across = row - _ROUND + k // (2 * _ROUND + 1), column - _ROUND + k % (2 * _ROUND + 1)
            stood = last[down, across] - first[down, across]
            if not (through[down, across] >= since and stood < _SETTLED):
                is_free = False
                break
        if run and math.hypot(beams[i, 0] - beams[i - 1, 0], beams[i, 1] - beams[i - 1, 1]) > _GAP:
            run = 0
        if not is_free:
            run = 0
            continue
        begin = begin if run else i
        run += 1
        width = math.hypot(beams[i, 0] - beams[begin, 0], beams[i, 1] - beams[begin, 1])
        if run >= _LEAST_ECHOES and width >= _LEAST_WIDTH:
            return True
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def _mark_standing(age, frame, beams, pose, settled, kept):  # type: ignore[no-untyped-def]
    """Fill `kept`, (n,), for beams whose group of neighbouring echoes is mostly at nodes that are old enough."""
    c, s, spacing, begin = math.cos(pose[2]), math.sin(pose[2]), frame[4], 0
    rows, columns = age.shape
    while begin < beams.shape[0]:
        end, width = _group(beams, begin)
        old = 0
        for i in range(begin, end):
            x, y = pose[0] + c * beams[i, 0] - s * beams[i, 1], pose[1] + s * beams[i, 0] + c * beams[i, 1]
            column, row = math.floor((x - frame[0]) / spacing + 0.5), math.floor((y - frame[1]) / spacing + 0.5)
            if 0 <= row < rows and 0 <= column < columns:
                old += age[row, column] >= settled
        kept[begin:end] = width >= _WIDE or old >= _MOSTLY * (end - begin)
        begin = end


def warm_up() -> None:
    """Compile the kernels for their array types."""
    surface, beams = LocalSurface(0.05, 0.5, 0.1, 0.1, 10.0), np.array([[0.2, 0.0, 1.0, 0.0]])
    surface.add(beams, np.zeros(3))
    surface.look(beams, 1, np.zeros(3), 0.0)
    surface.has_moving(beams, np.zeros(3), 0.0)
    surface.settled()
    surface.standing(beams, np.zeros(3))
