"""Worlds of the BARN data set (Perille et al. 2020), many in one `.npz` file.

The file holds: `world` (n,) the worlds' numbers; `cyl` (k, 3) x, y, radius of all cylinders, m, those of the i-th world
from `cyl_off[i]` up to `cyl_off[i + 1]`; `start` (3,) x, y, heading; `goal` (2,); `goal_tol`, m; `time_limit`, s; and,
if scores are relative to it, `path_len_m` (n,) the length of the organisers' path through each world, m.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from navloom.geometry.world import Cylinder, Place, World
from navloom.inputs import Arrays
from navloom.worlds import WorldError, did_you_mean, file_of, readable
from numpy.typing import NDArray

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
    path = file_of(name, base)
    arrays = _Arrays(path)
    offsets = arrays.read("cyl_off", (-1,)).astype(np.int64)
    if not offsets.size:
        raise WorldError(f"{path}: array 'cyl_off' is empty, expected one number more than there are worlds")
    numbers = arrays.read("world", (len(offsets) - 1,)).astype(np.int64)
    matches = np.flatnonzero(numbers == int(number)) if len(number) < 10 else np.zeros(0, dtype=np.int64)
    if not matches.size:
        there = ", ".join(str(n) for n in numbers[:400].tolist())
        raise WorldError(f"{path}: there is no world {number}; the file has {there}")
    cylinders = arrays.read("cyl", (-1, 3))
    first, last = offsets[matches[0] : matches[0] + 2].tolist()
    if not 0 <= first <= last <= len(cylinders):
        raise WorldError(f"{path}: cylinders {first} to {last} of world {number}, expected 0 to {len(cylinders)}")
    if last - first > _MOST:
        raise WorldError(f"{path}: {last - first} cylinders of world {number}, expected at most {_MOST}")
    reference = None
    if arrays.has("path_len_m"):
        reference = float(arrays.read("path_len_m", (len(numbers),))[matches[0]])
        if reference <= 0.0:
            raise WorldError(f"{path}: path_len_m of world {number} is {reference:g}, expected a length > 0 in metres")
    return _world(f"barn:{argument}", cylinders[first:last], arrays, reference)


def barn_numbers(name: str, base: Path) -> list[int]:
    """The numbers of a file's worlds, increasing. Raises WorldError if the file is missing or damaged."""
    numbers: list[int] = _Arrays(file_of(name, base)).read("world", (-1,)).astype(np.int64).tolist()
    return sorted(numbers)


def _world(name: str, cylinders: Floats, arrays: _Arrays, reference: float | None) -> World:
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


class _Arrays:
    """The arrays of a file, with checks."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with readable(path):
            self._arrays = Arrays(path, WorldError)

    def has(self, name: str) -> bool:
        return name in self._arrays.names

    def read(self, name: str, shape: tuple[int, ...]) -> Floats:
        """One array as float64; -1 in `shape` means any length.

        Raises:
            WorldError: The array is missing, damaged, of another shape, or contains anything but finite numbers.
        """
        if not self.has(name):
            raise WorldError(f"{self.path}: array {name!r} is missing; {did_you_mean(name, self._arrays.names)}")
        array = self._arrays.read(name)
        fits = len(array.shape) == len(shape) and all(w in (-1, g) for w, g in zip(shape, array.shape, strict=True))
        if not fits or array.dtype.kind not in "iuf":
            raise WorldError(f"{self.path}: array {name!r} of {array.dtype} {array.shape}, expected numbers {shape}")
        numbers = array.astype(np.float64)
        if not (np.abs(numbers) <= 1e7).all():
            raise WorldError(f"{self.path}: array {name!r} has a value beyond ±1e7, expected metres and seconds")
        return numbers
