"""Worlds of the BARN data set (Perille et al. 2020), many in one `.npz` file.

The file holds: `world` (n,) the worlds' numbers; `cyl` (k, 3) x, y, radius of all cylinders, m, those of the i-th world
from `cyl_off[i]` up to `cyl_off[i + 1]`; `start` (3,) x, y, heading; `goal` (2,); `goal_tol`, m; `time_limit`, s; and,
if scores are relative to it, `path_len_m` (n,) the length of the organisers' path through each world, m.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from navloom.geometry.world import Cylinder, Place, World
from navloom.worlds import WorldError, file_of
from numpy.typing import NDArray

from navloom_maps.arrays import WorldArrays

__all__ = ["barn_numbers", "barn_world"]

_MOST = 100_000
"""Most cylinders of one world, since each becomes an object."""
_MARGIN = 1.0
Floats = NDArray[np.float64]


def barn_world(argument: str, base: Path) -> World:
    """World scheme `barn:F.npz#17`: world number 17 of a file.

    Raises:
        WorldError: The file is missing or damaged, an array is missing or has a wrong shape, or there is no such world.
    """
    name, sharp, number = argument.partition("#")
    if not sharp or not number.isascii() or not number.isdigit():
        raise WorldError(f"barn:{argument}: {number!r} after '#', expected a world's number, as in barn:{name}#17")
    arrays = WorldArrays(file_of(name, base))
    place, first, last = arrays.span("world", "cyl_off", number)
    cylinders = arrays.read("cyl", (-1, 3))
    if not 0 <= first <= last <= len(cylinders):
        raise WorldError(
            f"{arrays.path}: cylinders {first} to {last} of world {number}, expected 0 to {len(cylinders)}"
        )
    if last - first > _MOST:
        raise WorldError(f"{arrays.path}: {last - first} cylinders of world {number}, expected at most {_MOST}")
    reference = None
    if arrays.has("path_len_m"):
        reference = float(arrays.read("path_len_m", arrays.read("world", (-1,)).shape)[place])
        if reference <= 0.0:
            raise WorldError(
                f"{arrays.path}: path_len_m of world {number} is {reference:g}, expected a length > 0 in metres"
            )
    return _world(f"barn:{argument}", cylinders[first:last], arrays, reference)


def barn_numbers(name: str, base: Path) -> list[int]:
    """The numbers of a file's worlds, increasing. Raises WorldError if the file is missing or damaged."""
    numbers: list[int] = WorldArrays(file_of(name, base)).read("world", (-1,)).astype(np.int64).tolist()
    return sorted(numbers)


def _world(name: str, cylinders: Floats, arrays: WorldArrays, reference: float | None) -> World:
    start = arrays.read("start", (3,))
    goal = arrays.read("goal", (2,))
    if cylinders.size and cylinders[:, 2].min() <= 0.0:
        raise WorldError(f"{arrays.path}: a cylinder of radius {cylinders[:, 2].min()}, expected > 0")
    places = np.concatenate([cylinders[:, :2], start[None, :2], goal[None]])
    low, high = places.min(axis=0) - _MARGIN, places.max(axis=0) + _MARGIN
    return World(
        name,
        tuple(Cylinder(f"cylinder {k}", x, y, r) for k, (x, y, r) in enumerate(cylinders.tolist(), start=1)),
        start=Place(*start.tolist()),
        goal=Place(*goal.tolist()),
        bounds=(float(low[0]), float(low[1]), float(high[0]), float(high[1])),
        goal_tolerance=float(arrays.read("goal_tol", ())),
        time_limit=float(arrays.read("time_limit", ())),
        reference_length=reference,
    )
