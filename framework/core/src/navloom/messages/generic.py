"""Messages of an unknown class, decoded from their header alone: envelope, fields and arrays."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import msgpack
from numpy.typing import NDArray

from navloom.messages.arrays import memory_of, views
from navloom.messages.bounds import ALIGNMENT
from navloom.messages.codec import CodecError, read_envelope
from navloom.messages.envelope import Envelope
from navloom.messages.kinds import MAX_ITEMS, Message, MessageError

__all__ = ["GenericMessage", "decode_generic"]

MOST_NAMES = 256
"""Most entries of a map in such a header."""
DEEPEST = 16
"""Deepest nesting of lists and maps in such a header."""
MOST_VALUES = 1 << 15
"""Most values in such a header, at all depths."""


class GenericMessage(Message):
    """A message of a class that is unknown here. Its contents are as sent, and not checked.

    Attributes:
        label: Schema name and version, as `navloom_people.Tracks/1`.
        fields: Values by name: numbers, texts, None, tuples and maps. An integer may be the index of an array: only the
            class would tell.
        arrays: Arrays in the order of the header; read-only.
        why: Why its class is unknown here, and what helps.
    """

    __slots__ = ("arrays", "fields", "label", "why")
    label: str
    fields: Mapping[str, Any]
    arrays: tuple[NDArray[Any], ...]
    why: str
    schema_name = "navloom.GenericMessage"

    def __init__(self, label: str, fields: Mapping[str, Any], arrays: tuple[NDArray[Any], ...], why: str = "") -> None:
        for name, value in (("label", label), ("fields", MappingProxyType(dict(fields))), ("arrays", arrays),
                            ("why", why)):  # fmt: skip
            object.__setattr__(self, name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"a message cannot be changed: {name}")

    def __reduce__(self) -> tuple[Any, ...]:
        return GenericMessage, (self.label, dict(self.fields), self.arrays, self.why)


def decode_generic(data: bytes | memoryview, label: str, why: str = "") -> tuple[GenericMessage, Envelope]:
    """A message and its envelope from the header alone, which is bounded in length, items and depth.

    Raises:
        CodecError: The bytes are no message of any class.
    """
    try:
        envelope = read_envelope(data)
        view = memoryview(data).cast("B").toreadonly()
        end = 4 + int.from_bytes(view[:4], "little")
        try:
            # Nothing is known of the class, so that the bounds are those of all classes.
            header = msgpack.unpackb(
                view[4:end], max_array_len=MAX_ITEMS, max_map_len=MOST_NAMES, max_bin_len=0, max_ext_len=0
            )
        except Exception as error:
            raise CodecError(f"the header is not MessagePack of a message: {str(error)[:80]}") from None
        fields = _plain(header.get("fields"), 0, [MOST_VALUES])
        if not isinstance(fields, dict):
            raise CodecError(f"fields is {type(fields).__name__}, expected a map")
        arrays = views(header.get("arrays"), memory_of(data), end + -end % ALIGNMENT)
        return GenericMessage(label, fields, tuple(arrays), why), envelope
    except (CodecError, MessageError) as error:
        raise CodecError(f"{label}: {error}") from None


def _plain(value: Any, depth: int, left: list[int]) -> Any:
    """A value of a header, with tuples for lists; `left` holds the number of values that may follow."""
    left[0] -= 1
    if depth > DEEPEST or left[0] < 0:
        what = f"is nested deeper than {DEEPEST}" if depth > DEEPEST else f"holds more than {MOST_VALUES} values"
        raise CodecError(f"fields {what}")
    if isinstance(value, list):
        return tuple([_plain(entry, depth + 1, left) for entry in value])
    if isinstance(value, dict):
        if not all(isinstance(name, str) for name in value):
            raise CodecError("fields holds a map whose keys are no names")
        return {name: _plain(entry, depth + 1, left) for name, entry in value.items()}
    return value
