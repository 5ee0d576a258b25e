"""Largest size of a message on the wire, from its declaration alone: larger ones are refused before they are read.

Arrays come after the header, so a header holds only names, numbers, short texts and lists of small messages.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from navloom.messages.kinds import MAX_ARRAYS, Array, Kind, Message

__all__ = ["ALIGNMENT", "LARGEST_HEADER", "LATER_FIELDS", "header_limit", "size_limit"]

ALIGNMENT = 64
"""Every array begins at a multiple of this, bytes."""
LARGEST_HEADER = 1 << 18
"""Largest header, whatever its class declares, bytes."""
LATER = 256
"""Reserve in a header for fields that a later version adds, bytes."""
LATER_FIELDS = 32
"""Most such fields in any map of a header."""
KEY = 255
"""Largest key of a stream, bytes."""
_LENGTH, _NUMBER, _WHOLE_MAP, _NAMES, _DTYPE = 4, 9, 1, ("envelope", "fields", "arrays"), 4


_LIMITS: dict[type[Message], int] = {}


def header_limit(cls: type[Message]) -> int:
    """Largest header of a message of this class, bytes."""
    limit = _LIMITS.get(cls)
    if limit is None:
        limit = _LIMITS[cls] = _header_limit(cls)
    return limit


def _header_limit(cls: type[Message]) -> int:
    envelope = 1 + _text(KEY) + 5 * _NUMBER
    arrays = 3 + min(MAX_ARRAYS * _entry(8), sum(_entry(len(array.shape)) for array in _arrays(cls)))
    names = sum(_text(len(name)) for name in _NAMES)
    return min(LARGEST_HEADER, _WHOLE_MAP + names + envelope + _fields(cls) + arrays + LATER)


def size_limit(cls: type[Message]) -> int | None:
    """Largest message of this class, bytes; None if one of its arrays may have any size."""
    size = _aligned(_LENGTH + header_limit(cls))
    for array in _arrays(cls):
        shape = [edge for edge in array.shape if isinstance(edge, int)]
        if len(shape) < len(array.shape):
            return None
        size += _aligned(int(np.prod(shape)) * np.dtype(array.dtype).itemsize)
    return size


def _fields(cls: type[Message]) -> int:
    return 3 + sum(_text(len(name)) + _value(kind) for name, kind in cls.kinds.items())


def _value(kind: Kind) -> int:
    if kind.form == "message":
        assert kind.message is not None
        return _fields(kind.message)
    if kind.form == "tuple":
        assert kind.item is not None
        return 3 + kind.most * _value(kind.item)
    if kind.form == "str":
        return _text(max(kind.most, *(len(choice.encode()) for choice in kind.choices), 0))
    return {"float": _NUMBER, "int": _NUMBER, "bool": 1, "array": 3}[kind.form]


def _text(size: int) -> int:
    """Size of a text of `size` bytes in MessagePack, bytes."""
    return size + (1 if size < 32 else 2 if size < 256 else 3 if size < 65536 else 5)


def _entry(dimensions: int) -> int:
    """Size of an entry of the table of arrays (element type, shape, offset), bytes."""
    return 1 + _DTYPE + 1 + dimensions * _NUMBER + _NUMBER


def _aligned(size: int) -> int:
    return size + -size % ALIGNMENT


def _arrays(cls: type[Message]) -> Iterator[Array]:
    """Every array that a message of this class can hold; at most MAX_ARRAYS for a tuple field."""
    for kind in cls.kinds.values():
        yield from _arrays_of(kind)


def _arrays_of(kind: Kind) -> Iterator[Array]:
    if kind.array is not None:
        yield kind.array
    elif kind.message is not None:
        yield from _arrays(kind.message)
    elif kind.item is not None:
        for _ in range(min(kind.most, MAX_ARRAYS)):
            yield from _arrays_of(kind.item)
