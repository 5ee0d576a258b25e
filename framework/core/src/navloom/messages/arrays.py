"""The arrays behind a header, as views of the bytes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navloom.messages.bounds import ALIGNMENT
from navloom.messages.kinds import DTYPES, MAX_ARRAYS, MessageError, brief

__all__ = ["Memory", "memory_of", "recalling", "views"]

Memory = bytes | NDArray[np.uint8]
"""Memory that arrays are views of: bytes, or an array over another buffer, whose flags show if it can be written."""
# A comparison takes 1 µs after a wake-up, a check of the values 2 to 4 µs; of larger arrays, the comparison is slower.
RECALLED = 32768
"""Largest array that is compared with earlier ones, bytes."""
FORMS = 16
"""Most shapes of a field for which arrays are held."""
MISSES = 16
"""Consecutive arrays of a shape that differ from the held ones before the shape is no longer compared."""


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


def recalling(
    dtype: np.dtype[Any], refuse: Callable[[NDArray[Any]], None] | None
) -> Callable[[tuple[int, ...], Memory, int], NDArray[Any]]:
    """A function (shape, all bytes, offset) -> array that returns an earlier array of the shape again if it is equal.

    Most arrays of a scan, such as the origins and bearings of its beams, are the same in every scan. Comparing their
    bytes costs less than checking their values again. Two arrays are held of each shape, for two sensors of one type.

    Args:
        dtype: Element type.
        refuse: Raises MessageError for values that the field does not allow; None if it allows all.
    """
    held: dict[tuple[int, ...], tuple[_Known, int]] = {}
    changing: set[tuple[int, ...]] = set()

    def view(shape: tuple[int, ...], memory: Memory, at: int) -> NDArray[Any]:
        # Only bytes cannot change after they were compared.
        if memory.__class__ is not bytes or shape in changing:
            return checked(shape, memory, at)
        known, misses = held.get(shape, _NOTHING)
        for block, earlier in known:
            if memory[at : at + len(block)] == block:
                if misses:
                    held[shape] = known, 0
                return earlier
        array = checked(shape, memory, at)
        hold(shape, array, known, misses + 1)
        return array

    def checked(shape: tuple[int, ...], memory: Memory, at: int) -> NDArray[Any]:
        array: NDArray[Any] = np.ndarray(shape, dtype, memory, at)
        if refuse is not None:
            refuse(array)
        return array

    def hold(shape: tuple[int, ...], array: NDArray[Any], known: _Known, misses: int) -> None:
        if array.nbytes <= RECALLED and misses <= MISSES and (known or len(held) < FORMS):
            block = array.tobytes()  # a copy, so that the rest of the message is not held with it
            held[shape] = ((block, np.ndarray(shape, dtype, block)), *known[:1]), misses
        elif len(changing) < FORMS:
            changing.add(shape)
            held.pop(shape, None)

    return view


_Known = tuple[tuple[bytes, NDArray[Any]], ...]
"""Bytes and array of the arrays that are held of a shape, newest first."""
_NOTHING: tuple[_Known, int] = ((), 0)
