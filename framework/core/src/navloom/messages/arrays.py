"""The arrays behind a header, as views of the bytes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom.messages.bounds import ALIGNMENT
from navloom.messages.kinds import DTYPES, MAX_ARRAYS, MessageError, brief

__all__ = ["Memory", "memory_of", "views"]

Memory = bytes | NDArray[np.uint8]
"""Memory that arrays are views of: bytes, or an array over another buffer, whose flags show if it can be written."""


def memory_of(data: bytes | memoryview) -> Memory:
    """The bytes of a message as memory for arrays."""
    # Slices of bytes compare fastest, and their arrays are read-only by themselves.
    return data if data.__class__ is bytes else np.frombuffer(data, np.uint8)


def views(table: Any, memory: Memory, start: int) -> list[NDArray[Any]]:
    """Views of the arrays that a header lists, each checked to be inside the bytes, at a multiple of 64.

    Raises:
        MessageError: The table is malformed, or an array is outside the bytes or not aligned.
    """
    if not isinstance(table, list) or len(table) > MAX_ARRAYS:
        raise MessageError(f"arrays is {type(table).__name__}, expected a list of at most {MAX_ARRAYS}")
    arrays: list[NDArray[Any]] = []
    for number, entry in enumerate(table):
        try:
            array = _view(entry, memory, start)
        except (TypeError, KeyError):
            raise MessageError(f"array {number} is {brief(entry)}, expected dtype, shape and offset") from None
        except ValueError:
            raise MessageError(
                f"array {number} is {brief(entry)}, expected it at a multiple of {ALIGNMENT} "
                f"within the {len(memory)} bytes given"
            ) from None
        if not array.flags.aligned:  # numba kernels would be compiled again for unaligned arrays
            array = array.copy()
            array.flags.writeable = False
        arrays.append(array)
    return arrays


def _view(entry: Any, memory: Memory, start: int) -> NDArray[Any]:
    """The array of an entry. Raises TypeError or KeyError if it is malformed, ValueError if it is out of place."""
    name, shape, offset = entry
    dtype = DTYPES[name]
    count = 1
    for size in shape:
        # `type`, not `isinstance`: True is an int in Python, and not in a header.
        if type(size) is not int or size < 0:
            raise TypeError
        count *= size
    if type(offset) is not int or offset < 0:
        raise TypeError
    if offset % ALIGNMENT or len(shape) > 8 or (count and offset + count * dtype.itemsize > len(memory) - start):
        raise ValueError
    # An empty array has no place, and its offset may be beyond the end.
    return np.ndarray(shape, dtype, memory, start + offset if count else 0)
