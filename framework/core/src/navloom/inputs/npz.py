"""Reads the arrays of an `.npz` file; the size of each is checked before it is unpacked or allocated."""

from __future__ import annotations

import io
import math
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from navloom.inputs.bounds import ARRAYS_MB, Refusal, bytes_of, read_file, too_large

__all__ = ["Arrays"]

MOST_MEMBERS = 10_000
"""Most arrays of a file; `zipfile` creates an object for each when it opens the file."""
_ENTRY = b"PK\x01\x02"


class _Refused(Exception):
    """A fault of an array, without the file's name."""


class Arrays:
    """An `.npz` file of numbers.

    Args:
        path: The file.
        refusal: Makes the error for a file that is damaged, too large, or contains anything but numbers.

    Raises:
        OSError: The file is missing or cannot be read.
    """

    def __init__(self, path: Path, refusal: Refusal) -> None:
        self.path, self._refusal = path, refusal
        self._content = read_file(path, ARRAYS_MB, refusal)
        self._left = self._limit = bytes_of(ARRAYS_MB, refusal)
        # Counted in the bytes, before `zipfile` makes an object of each.
        if self._content.count(_ENTRY) > MOST_MEMBERS:
            raise refusal(f"{path}: more than {MOST_MEMBERS} arrays, expected at most {MOST_MEMBERS}")
        try:
            self._archive = zipfile.ZipFile(io.BytesIO(self._content))
        except Exception as error:  # `zipfile` and numpy do not document what they raise for damaged files
            raise refusal(f"{path}: damaged .npz file: {_words(error)}; copy the file again") from None
        self.names = tuple(name.removesuffix(".npy") for name in self._archive.namelist())
        """Names of the arrays."""

    def read(self, name: str) -> NDArray[Any]:
        """One array of numbers or booleans, as it was stored. Raises the caller's error."""
        try:
            return self._read(name)
        except _Refused as error:
            raise self._refusal(f"{self.path}: array {name!r}{error}") from None
        except Exception as error:
            raise self._refusal(
                f"{self.path}: damaged .npz file at {name!r}: {_words(error)}; copy the file again"
            ) from None

    def _read(self, name: str) -> NDArray[Any]:
        member = self._archive.getinfo(f"{name}.npy")
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            # `zipfile` bounds the unpacked size only for these two methods; numpy writes no other.
            raise _Refused(f" is packed by method {member.compress_type}, expected numpy's own, 0 or 8")
        with self._archive.open(member) as file:
            # Later versions are for long names of fields, which plain numbers do not have.
            if npy.read_magic(file) != (1, 0):
                raise _Refused(" has no header of version 1.0, expected plain numbers")
            with warnings.catch_warnings():  # about headers written by Python 2, which can be read
                warnings.simplefilter("ignore")
                shape, column_first, dtype = npy.read_array_header_1_0(file)
            if dtype.kind not in "biuf" or dtype.itemsize > 16 or any(size < 0 for size in shape):
                raise _Refused(f" of {_words(dtype)} {_words(shape)}, expected numbers")
            count = math.prod(shape)
            # Callers convert to float64, which makes a bit mask 8 times as large.
            self._left -= count * max(dtype.itemsize, 8)
            if self._left < 0:
                raise _Refused(too_large(f" of {dtype} {_words(shape)}: with it {self._claimed()} MB", self._limit))
            values = np.frombuffer(file.read(count * dtype.itemsize), dtype=dtype, count=count)
        return values.reshape(shape, order="F" if column_first else "C")

    def _claimed(self) -> str:
        return f"{(self._limit - self._left) / 1e6:.6g}"


def _words(given: object) -> str:
    text = str(given) or type(given).__name__
    return text if len(text) <= 200 else f"{text[:197]}..."
