"""Messages as bytes: one MessagePack header, then each array's raw bytes at a multiple of 64.

Layout: `u32 length of the header (little endian) | header | padding to 64 | array | padding to 64 | array …`. The
header is a map: `envelope` (key, sequence, tick, stamp_ns, cause_ns, epoch), `fields` by name, and `arrays`, a list of
(dtype, shape, offset from the first array). In `fields` an array is its place in that list. Schema name and version
travel beside the bytes. Nothing is executed in decoding, and nothing is allocated beyond the header's own values:
arrays are read-only views of the bytes.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from navloom.messages.envelope import Envelope
from navloom.messages.schema import SCHEMAS, Kind, Message, MessageError

__all__ = ["CodecError", "decode", "encode", "schema_label"]

ALIGNMENT = 64
MAX_ARRAYS = 256
DTYPES = frozenset({"<f8", "<f4", "<i8", "<i4", "|i1", "|u1", "|b1"})
_LENGTH = struct.Struct("<I")
_PAD = [bytes(n) for n in range(ALIGNMENT)]

Write = Callable[[Any, list[NDArray[Any]]], Any]
Read = Callable[[str, Any, list[NDArray[Any]]], Any]


class CodecError(ValueError):
    """Bytes that are not the message they claim to be; the text names the place, the value and the expectation."""


def schema_label(cls: type[Message]) -> str:
    """Name and version that travel beside the bytes, as `navloom.Odometry/1`."""
    return f"{cls.schema_name}/{cls.schema_version}"


def encode(message: Message, envelope: Envelope) -> bytes:
    """Bytes of a message in its envelope. Equal messages in equal envelopes give equal bytes."""
    arrays: list[NDArray[Any]] = []
    body = {"envelope": envelope, "fields": _writer(type(message))(message, arrays)}
    if not arrays:
        body["arrays"] = arrays
        header = msgpack.packb(body)
        return _LENGTH.pack(len(header)) + header
    table = []
    blocks: list[bytes] = []
    offset = 0
    for array in arrays:
        table.append((array.dtype.str, array.shape, offset))
        raw = array.tobytes()
        pad = -len(raw) % ALIGNMENT
        blocks += (raw, _PAD[pad])
        offset += len(raw) + pad
    body["arrays"] = table
    header = msgpack.packb(body)
    return b"".join((_LENGTH.pack(len(header)), header, _PAD[-(4 + len(header)) % ALIGNMENT], *blocks))


def decode(data: bytes | memoryview, label: str) -> tuple[Message, Envelope]:
    """Message and envelope from bytes; arrays are views of the bytes. Unknown fields are passed over.

    Raises:
        CodecError: Unknown schema, another version, or bytes that do not fit the schema.
    """
    cls = _class_of(label)
    view = memoryview(data).cast("B") if not isinstance(data, bytes) else memoryview(data)
    if len(view) < 4:
        raise CodecError(f"{label}: got {len(view)} bytes, expected a header of at least 4")
    end = 4 + _LENGTH.unpack(view[:4])[0]
    if end > len(view):
        raise CodecError(f"{label}: the header claims {end - 4} bytes, {len(view) - 4} are there")
    try:
        header = msgpack.unpackb(view[4:end], raw=False, strict_map_key=True)
    except Exception as error:
        raise CodecError(f"{label}: the header is not MessagePack: {error}") from None
    if not isinstance(header, dict):
        raise CodecError(f"{label}: the header is {type(header).__name__}, expected a map")
    arrays = _arrays(label, header.get("arrays"), view, end + -end % ALIGNMENT)
    message = _reader(cls)(label, header.get("fields"), arrays)
    return message, _envelope(label, header.get("envelope"))


def _class_of(label: str) -> type[Message]:
    name, _, version = label.partition("/")
    cls = SCHEMAS.get(name)
    if cls is None:
        raise CodecError(f"schema {label!r} is unknown here: the sender runs another set of plugins or versions")
    if version != str(cls.schema_version):
        raise CodecError(f"schema {label!r}: this side speaks version {cls.schema_version}; update the older side")
    return cls


def _envelope(label: str, value: Any) -> Envelope:
    if not isinstance(value, list) or len(value) < 6:
        raise CodecError(f"{label}: envelope is {value!r}, expected key, sequence, tick, stamp, cause and epoch")
    if not isinstance(value[0], str) or not all(type(number) is int for number in value[1:6]):
        raise CodecError(f"{label}: envelope is {value!r}, expected one string and five whole numbers")
    return Envelope(*value[:6])


def _arrays(label: str, table: Any, view: memoryview, start: int) -> list[NDArray[Any]]:
    """Views of the arrays a header lists, each checked to lie inside the bytes."""
    if not isinstance(table, list) or len(table) > MAX_ARRAYS:
        raise CodecError(f"{label}: arrays is not a list of at most {MAX_ARRAYS}")
    arrays = []
    for number, entry in enumerate(table):
        if not isinstance(entry, list) or len(entry) != 3 or entry[0] not in DTYPES:
            raise CodecError(f"{label}: array {number} is {entry!r}, expected dtype, shape and offset")
        dtype, shape, offset = np.dtype(entry[0]), entry[1], entry[2]
        whole = [offset, *shape] if isinstance(shape, list) and len(shape) <= 8 else [None]
        if not all(type(size) is int and 0 <= size < 2**40 for size in whole):
            raise CodecError(f"{label}: array {number} has shape {shape!r} at {offset!r}, expected whole numbers")
        count = math.prod(shape)
        if start + offset + count * dtype.itemsize > len(view):
            raise CodecError(f"{label}: array {number} ({dtype}, {shape}) reaches beyond the {len(view)} bytes given")
        flat = np.frombuffer(view, dtype, count, start + offset) if count else np.empty(0, dtype)
        array = flat.reshape(shape)
        array.flags.writeable = False
        arrays.append(array)
    return arrays


@cache
def _writer(cls: type[Message]) -> Write:
    names = tuple(cls.kinds)
    read = cls.read_fields
    special = [(name, write) for name, kind in cls.kinds.items() if (write := _value_writer(kind)) is not None]

    def write_message(message: Any, arrays: list[NDArray[Any]]) -> dict[str, Any]:
        values = dict(zip(names, read(message), strict=True))
        for name, write in special:
            values[name] = write(values[name], arrays)
        return values

    return write_message


def _value_writer(kind: Kind) -> Write | None:
    """How a value of this kind is written; None where MessagePack takes it as it is."""
    inner: Write
    if kind.form == "array":

        def inner(value: Any, arrays: list[NDArray[Any]]) -> Any:
            arrays.append(value)
            return len(arrays) - 1

    elif kind.form == "message":
        assert kind.message is not None
        inner = _writer(kind.message)
    elif kind.form == "tuple":
        assert kind.item is not None
        item = _value_writer(kind.item)
        if item is None:
            return None
        each = item

        def inner(value: Any, arrays: list[NDArray[Any]]) -> Any:
            return [each(entry, arrays) for entry in value]

    else:
        return None
    if not kind.optional:
        return inner
    return lambda value, arrays: None if value is None else inner(value, arrays)


@cache
def _reader(cls: type[Message]) -> Read:
    readers = [(name, _value_reader(kind), kind.optional) for name, kind in cls.kinds.items()]

    def read_message(place: str, values: Any, arrays: list[NDArray[Any]]) -> Message:
        if not isinstance(values, dict):
            raise CodecError(f"{place}: got {type(values).__name__}, expected a map of fields")
        made = {}
        for name, read, optional in readers:
            if name not in values:
                raise CodecError(f"{place}: field {name!r} is missing; got {', '.join(map(str, values)) or 'none'}")
            value = values[name]
            made[name] = None if optional and value is None else read(f"{place}.{name}", value, arrays)
        try:
            return cls(**made)
        except MessageError as error:
            raise CodecError(f"{place}: {error}") from None

    return read_message


def _value_reader(kind: Kind) -> Read:
    if kind.form == "array":

        def read_array(place: str, value: Any, arrays: list[NDArray[Any]]) -> Any:
            if type(value) is not int or not 0 <= value < len(arrays):
                raise CodecError(f"{place}: got {value!r}, expected the number of one of {len(arrays)} arrays")
            return arrays[value]

        return read_array
    if kind.form == "message":
        assert kind.message is not None
        return _reader(kind.message)
    if kind.form == "tuple":
        assert kind.item is not None
        item = _value_reader(kind.item)

        def read_tuple(place: str, value: Any, arrays: list[NDArray[Any]]) -> Any:
            if not isinstance(value, list):
                raise CodecError(f"{place}: got {type(value).__name__}, expected a list")
            return tuple(item(f"{place}[{number}]", entry, arrays) for number, entry in enumerate(value))

        return read_tuple

    def read_plain(place: str, value: Any, arrays: list[NDArray[Any]]) -> Any:
        if kind.form == "float" and type(value) is not float:
            raise CodecError(f"{place}: got {value!r}, expected a number")
        return value

    return read_plain
