"""Reads the arrays of a data set of worlds; every error names the file, the array and what was expected."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from navloom.inputs import Arrays
from navloom.worlds import WorldError, did_you_mean, readable
from numpy.typing import NDArray

__all__ = ["WorldArrays"]

Floats = NDArray[np.float64]


class WorldArrays:
    """The arrays of a file, with checks.

    Attributes:
        path: The file.
        names: Names of the arrays.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with readable(path):
            self._arrays = Arrays(path, WorldError)
        self.names = self._arrays.names

    def span(self, numbers: str, offsets: str, number: str) -> tuple[int, int, int]:
        """Place of a world, by its number as text, and where its part of another array begins and ends.

        Args:
            numbers: Array of the (n,) numbers of the worlds.
            offsets: Array of (n + 1,) places at which the worlds' parts begin and end.
            number: The number, digits.

        Raises:
            WorldError: An array does not fit, or there is no such world.
        """
        ends = self.read(offsets, (-1,)).astype(np.int64)
        if not ends.size:
            raise WorldError(f"{self.path}: array {offsets!r} is empty, expected one number more than there are worlds")
        known = self.read(numbers, (len(ends) - 1,)).astype(np.int64)
        matches = np.flatnonzero(known == int(number)) if len(number) < 10 else np.zeros(0, dtype=np.int64)
        if not matches.size:
            there = ", ".join(str(n) for n in known[:400].tolist())
            raise WorldError(f"{self.path}: there is no world {number}; the file has {there}")
        place = int(matches[0])
        return place, int(ends[place]), int(ends[place + 1])

    def has(self, name: str) -> bool:
        return name in self.names

    def read(self, name: str, shape: tuple[int, ...]) -> Floats:
        """One array as float64; -1 in `shape` means any length.

        Raises:
            WorldError: The array is missing, damaged, of another shape, or contains anything but finite numbers.
        """
        if not self.has(name):
            raise WorldError(f"{self.path}: array {name!r} is missing; {did_you_mean(name, self.names)}")
        array = self._arrays.read(name)
        fits = len(array.shape) == len(shape) and all(w in (-1, g) for w, g in zip(shape, array.shape, strict=True))
        if not fits or array.dtype.kind not in "iuf":
            raise WorldError(f"{self.path}: array {name!r} of {array.dtype} {array.shape}, expected numbers {shape}")
        numbers = array.astype(np.float64)
        if not (np.abs(numbers) <= 1e7).all():
            raise WorldError(f"{self.path}: array {name!r} has a value beyond ±1e7, expected metres and seconds")
        return numbers
