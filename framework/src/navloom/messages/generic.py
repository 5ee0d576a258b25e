"""Messages whose class is not known here, as far as their header alone tells: envelope, fields and arrays."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import msgpack
from numpy.typing import NDArray

from navloom.messages.bounds import ALIGNMENT
from navloom.messages.codec import CodecError, _arrays, read_envelope
from navloom.messages.envelope import Envelope
from navloom.messages.kinds import MAX_ITEMS, Message

__all__ = ["GenericMessage", "decode_generic"]

MOST_NAMES = 256
"""Most entries of a map in such a header."""
DEEPEST = 16
"""Most lists and maps round a value in such a header."""
MOST_VALUES = 1 << 15
"""Most values in such a header, at all depths."""


class GenericMessage(Message):
    """A message of a class that is not known here. It holds what was sent, and nothing of it is checked.

    Attributes:
        label: Schema name and version, as `navloom_people.Tracks/1`.
        fields: By name: numbers, texts, None, tuples and maps. A whole number may be the place of an array: only the
            class tells which.
        arrays: In the order of the header; read-only.
        why: Why its class is not known here, and what helps.
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
        CodecError: Bytes that are no message of whatever class.
    """
    try:
        envelope = read_envelope(data)
        view = memoryview(data).cast("B").toreadonly()
        end = 4 + int.from_bytes(view[:4], "little")
        try:
            header = msgpack.unpackb(
                view[4:end], max_array_len=MAX_ITEMS, max_map_len=MOST_NAMES, max_bin_len=0, max_ext_len=0
            )
        except Exception as error:
            raise CodecError(f"the header is not MessagePack of a message: {str(error)[:80]}") from None
        fields = _plain(header.get("fields"), 0, [MOST_VALUES])
        if not isinstance(fields, dict):
            raise CodecError(f"fields is {type(fields).__name__}, expected a map")
        arrays = _arrays(header.get("arrays"), data if isinstance(data, bytes) else view, end + -end % ALIGNMENT)
        return GenericMessage(label, fields, tuple(arrays), why), envelope
    except CodecError as error:
        raise CodecError(f"{label}: {error}") from None


def _plain(value: Any, depth: int, left: list[int]) -> Any:
    """A value of a header, with tuples for lists; `left` holds how many values it may have."""
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
