"""Field values of messages, for `message_types`: filled in from keyword arguments, checked, and shown as plain values.

`store` is the typestore of `rosbags` throughout.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from navloom_ros.errors import UnfitMessage

__all__ = ["filled", "misfit", "plain", "spare_bytes", "with_unsigned_bytes"]

_ALIASES = {"bool": "bool_", "char": "uint8"}
"""numpy's names of primitives, where they differ."""
_IDENTITY = {"geometry_msgs/msg/Quaternion": {"w": 1.0}}
"""Default values in `.msg` texts that are not zero, which `rosbags` drops."""


def dtype_of(base: str) -> np.dtype[Any]:
    """numpy type of an array of a primitive."""
    return np.dtype(_ALIASES.get(base, base))


def filled(store: Any, name: str, values: Mapping[str, Any], place: str = "") -> Any:
    """A message with these values, and defaults elsewhere.

    Args:
        store: Typestore of `rosbags`.
        name: Type of the message.
        values: By field.
        place: Path of this message in the outer one, for the error, as `.pose.orientation`.

    Raises:
        UnfitMessage: No such field, or a value does not fit it.
    """
    definition = store.get_msgdef(name)
    known = [field for field, _ in definition.fields]
    for given in values:
        if given not in known:
            raise UnfitMessage(f"{name}{place} has no field {given!r}; it has {', '.join(known)}")
    values = {**_IDENTITY.get(name, {}), **values}
    made = {
        field: _value(store, descriptor, values.get(field), f"{place}.{field}")
        for field, descriptor in definition.fields
    }
    return definition.cls(**made)


def _value(store: Any, descriptor: Any, given: Any, place: str) -> Any:
    kind, rest = descriptor
    if kind == Nodetype.BASE:
        return _DEFAULTS.get(rest[0], 0) if given is None else given
    if kind == Nodetype.NAME:
        return filled(store, rest, given or {}, place) if given is None or isinstance(given, Mapping) else given
    (inner, of), count = rest
    length = count if kind == Nodetype.ARRAY else 0
    if inner == Nodetype.BASE and of[0] != "string":
        return _array(of[0], np.zeros(length, dtype_of(of[0])) if given is None else given, place)
    if given is None:
        return [_value(store, (inner, of), None, place) for _ in range(length)]
    if isinstance(given, (str, Mapping)) or not isinstance(given, Sequence):
        raise UnfitMessage(f"{place[1:]}: {type(given).__name__}; expected a list")
    return [_value(store, (inner, of), one, f"{place}[{index}]") for index, one in enumerate(given)]


_DEFAULTS: dict[str, Any] = {"bool": False, "string": "", "float32": 0.0, "float64": 0.0}


def _array(base: str, given: Any, place: str) -> np.ndarray[Any, Any]:
    try:
        if isinstance(given, (bytes, bytearray, memoryview)):
            return np.frombuffer(given, dtype_of(base))
        return np.ascontiguousarray(given, dtype_of(base)).reshape(-1)
    except (ValueError, TypeError, OverflowError) as error:
        raise UnfitMessage(f"{place[1:]}: not an array of {base}: {error}") from None


def misfit(store: Any, message: Any, name: str, place: str = "") -> str:
    """The first field that does not fit its type, as a sentence; empty if there is none.

    Checks what `rosbags` does not: it accepts an array of another type with as many bytes, or a message of another type
    with the same fields.
    """
    for field, descriptor in _checked_fields(store, name):
        value = getattr(message, field, None)
        kind, rest = descriptor
        where = f"{place}.{field}"
        if kind == Nodetype.NAME:
            problem = _nested(store, value, rest, where)
        elif rest[0][0] == Nodetype.NAME:
            problem = _list(store, value, rest[0][1], where)
        else:
            problem = _unfit_array(value, rest[0][1][0], rest[1] if kind == Nodetype.ARRAY else None, where)
        if problem:
            return problem if place else f"{name}: {problem}"
    return ""


def _nested(store: Any, value: Any, name: str, place: str) -> str:
    if getattr(value, "__msgtype__", None) != name:
        return f"{place[1:]} is {_kind(value)}; expected {name}"
    return misfit(store, value, name, place)


def _list(store: Any, value: Any, name: str, place: str) -> str:
    if not isinstance(value, (list, tuple)):
        return f"{place[1:]} is {_kind(value)}; expected a list of {name}"
    for index, one in enumerate(value):
        if problem := _nested(store, one, name, f"{place}[{index}]"):
            return problem
    return ""


def _unfit_array(value: Any, base: str, length: int | None, place: str) -> str:
    expected = dtype_of(base)
    if not isinstance(value, np.ndarray) or value.dtype != expected or value.ndim != 1:
        return f"{place[1:]} is {_kind(value)}; expected a numpy array of {expected}, in one dimension"
    if not value.flags.c_contiguous:
        return f"{place[1:]} is a strided view; expected contiguous memory: use numpy.ascontiguousarray"
    if length is not None and len(value) != length:
        return f"{place[1:]} has {len(value)} elements; expected {length}"
    return ""


def _kind(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype}, shape {value.shape}"
    return str(getattr(value, "__msgtype__", type(value).__name__))


@lru_cache(4096)
def _checked_fields(store: Any, name: str) -> list[tuple[str, Any]]:
    """Fields that `rosbags` does not check: nested messages and arrays of numbers."""
    return [entry for entry in store.get_msgdef(name).fields if _is_unchecked(*entry[1])]


def _is_unchecked(kind: int, rest: Any) -> bool:
    return kind == Nodetype.NAME or (
        kind != Nodetype.BASE and (rest[0][0] == Nodetype.NAME or rest[0][1][0] != "string")
    )


def with_unsigned_bytes(descriptor: Any) -> Any:
    """The descriptor of a field, with `uint8` for `byte`."""
    kind, rest = descriptor
    if kind == Nodetype.BASE:
        return (kind, ("uint8", rest[1])) if rest[0] == "byte" else descriptor
    return descriptor if kind == Nodetype.NAME else (kind, (with_unsigned_bytes(rest[0]), rest[1]))


def spare_bytes(store: Any, message: Any) -> int:
    """Most unused bytes that Fast DDS may append to a message.

    Its size estimate aligns every sequence of 8-byte elements, even an empty one, which the data do not align: 4 bytes
    each, and the alignment of later fields may round that up to 8. Seen in messages of `rclpy.serialization`.
    """
    empty = _empty_wide(store, message)
    return 4 * empty + 4 if empty else 0


def _empty_wide(store: Any, message: Any) -> int:
    count = 0
    for field, (kind, rest) in store.get_msgdef(message.__msgtype__).fields:
        if kind == Nodetype.BASE:
            continue
        value = getattr(message, field)
        if kind == Nodetype.NAME:
            count += _empty_wide(store, value)
        elif rest[0][0] == Nodetype.NAME:
            count += sum(_empty_wide(store, one) for one in value)
        elif kind != Nodetype.ARRAY and isinstance(value, np.ndarray) and value.itemsize == 8 and not len(value):
            count += 1
    return count


def plain(store: Any, message: Any, most: int | None = None) -> Any:
    """A message as dicts, lists and numbers; a list longer than `most` is cut and its length appended."""
    if hasattr(message, "__msgtype__"):
        names = [field for field, _ in store.get_msgdef(message.__msgtype__).fields]
        return {name: plain(store, getattr(message, name), most) for name in names}
    if not isinstance(message, (list, np.ndarray)):
        return message
    shown = [plain(store, one, most) for one in message[:most]]
    shown = [one.item() if isinstance(one, np.generic) else one for one in shown]
    return shown if len(shown) == len(message) else [*shown, f"… {len(message)} elements"]
