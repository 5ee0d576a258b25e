"""Messages as bytes: one MessagePack header, then each array's raw bytes at a multiple of 64.

Layout: `u32 length of the header (little endian) | header | padding to 64 | array | padding to 64 | array …`. The
header is a map: `envelope` (key, sequence, tick, stamp_ns, cause_ns, epoch), `fields` by name, and `arrays`, a list of
(dtype, shape, offset from the first array). In `fields` an array is its place in that list. Schema name and version
travel beside the bytes. Nothing is executed in decoding, and nothing is allocated beyond the header's own values:
arrays are read-only views of the bytes.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable
from dataclasses import MISSING, fields
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from navloom.messages.envelope import Envelope
from navloom.messages.kinds import DTYPES, MAX_ITEMS, Kind, Message, MessageError, brief
from navloom.messages.schema import SCHEMAS

__all__ = ["CodecError", "decode", "encode", "read_envelope", "schema_label"]

ALIGNMENT = 64
MAX_ARRAYS = 256
_LENGTH = struct.Struct("<I")
_PAD = [bytes(n) for n in range(ALIGNMENT)]

Write = Callable[[Any, list[NDArray[Any]]], dict[str, Any]]
Read = Callable[[Any, list[NDArray[Any]]], Any]


class CodecError(ValueError):
    """Bytes that are not the message they claim to be; the text names the place, the value and the expectation."""


class _Packer(threading.local):
    """One packer for each thread: making one costs more than packing a message."""

    def __init__(self) -> None:
        self.pack: Callable[[Any], bytes] = msgpack.Packer().pack


_PACKER = _Packer()
_WRITERS: dict[type[Message], Write] = {}
_READERS: dict[type[Message], Read] = {}


def schema_label(cls: type[Message]) -> str:
    """Name and version that travel beside the bytes, as `navloom.Odometry/1`."""
    return f"{cls.schema_name}/{cls.schema_version}"


def encode(message: Message, envelope: Envelope | tuple[str, int, int, int, int, int]) -> bytes:
    """Bytes of a message in its envelope. The same contents, bit for bit, give the same bytes."""
    cls = type(message)
    write = _WRITERS.get(cls)
    if write is None:
        write = _WRITERS[cls] = _writer(cls)
    arrays: list[NDArray[Any]] = []
    body: dict[str, Any] = {"envelope": envelope, "fields": write(message, arrays), "arrays": arrays}
    if not arrays:
        header = _PACKER.pack(body)
        return _LENGTH.pack(len(header)) + header
    if len(arrays) > MAX_ARRAYS:
        raise CodecError(f"{schema_label(cls)}: holds {len(arrays)} arrays, expected at most {MAX_ARRAYS}")
    table = []
    blocks: list[Any] = []
    end = 0
    for array in arrays:
        pad = -end % ALIGNMENT
        size = array.nbytes
        table.append((array.dtype.str, array.shape, end + pad if size else 0))
        if size:
            blocks += (_PAD[pad], array)
            end += pad + size
    body["arrays"] = table
    header = _PACKER.pack(body)
    if blocks:
        blocks[0] = _PAD[-(4 + len(header)) % ALIGNMENT]
    return b"".join((_LENGTH.pack(len(header)), header, *blocks))


def decode(data: bytes | memoryview, label: str) -> tuple[Message, Envelope]:
    """Message and envelope from bytes, which must not change afterwards: arrays are views of them.

    Unknown fields are passed over, and one with a default, as those added later have, may be missing. Only where the
    bytes lie at an odd address are arrays copied.

    Raises:
        CodecError: Unknown schema, another version, or bytes that do not fit the schema.
    """
    cls = _class_of(label)
    if data.__class__ is not bytes:
        data = memoryview(data).cast("B").toreadonly()
    if len(data) < 4:
        raise CodecError(f"{label}: got {len(data)} bytes, expected a header of at least 4")
    end = 4 + _LENGTH.unpack_from(data)[0]
    if end > len(data):
        raise CodecError(f"{label}: the header claims {end - 4} bytes, {len(data) - 4} are there")
    try:
        header = msgpack.unpackb(data[4:end], max_array_len=min(end, MAX_ITEMS))
    except Exception as error:
        raise CodecError(f"{label}: the header is not MessagePack: {brief(error)}") from None
    if not isinstance(header, dict):
        raise CodecError(f"{label}: the header is {type(header).__name__}, expected a map")
    try:
        arrays = _arrays(header.get("arrays"), data, end + -end % ALIGNMENT)
        message = _reader(cls)(header.get("fields"), arrays)
        return message, _envelope(header.get("envelope"))
    except (CodecError, MessageError) as error:
        raise CodecError(f"{label}: {error}") from None


def read_envelope(data: bytes | memoryview) -> Envelope:
    """The envelope alone, whatever the message is. Raises CodecError."""
    view = memoryview(data).cast("B")
    end = 4 + _LENGTH.unpack_from(view)[0] if len(view) >= 4 else 0
    if not 4 < end <= len(view):
        raise CodecError(f"got {len(view)} bytes, expected a header that fits into them")
    try:
        header = msgpack.unpackb(view[4:end], max_array_len=min(end, MAX_ITEMS))
    except Exception as error:
        raise CodecError(f"the header is not MessagePack: {brief(error)}") from None
    return _envelope(header.get("envelope") if isinstance(header, dict) else None)


def _class_of(label: str) -> type[Message]:
    name, _, version = label.partition("/")
    cls = SCHEMAS.get(name)
    if cls is None:
        raise CodecError(f"schema {label!r} is unknown here: the sender runs another set of plugins or versions")
    if version != str(cls.schema_version):
        raise CodecError(f"schema {label!r}: this side speaks version {cls.schema_version}; update the older side")
    return cls


def _envelope(value: Any) -> Envelope:
    if not isinstance(value, list) or len(value) < 6:
        raise CodecError(f"envelope is {brief(value)}, expected key, sequence, tick, stamp, cause and epoch")
    key, sequence, tick, stamp, cause, epoch = value[:6]
    if (
        type(key) is not str
        or not type(sequence) is type(tick) is type(stamp) is type(cause) is type(epoch) is int
        or (sequence | tick | stamp | cause | epoch) >> 63  # one below 0 makes it negative
    ):
        raise CodecError(f"envelope is {brief(value)}, expected one string and five whole numbers >= 0")
    return Envelope(key, sequence, tick, stamp, cause, epoch)


def _arrays(table: Any, data: bytes | memoryview, start: int) -> list[NDArray[Any]]:
    """Views of the arrays a header lists, each checked to lie inside the bytes, at a multiple of 64."""
    if not isinstance(table, list) or len(table) > MAX_ARRAYS:
        raise CodecError(f"arrays is {type(table).__name__}, expected a list of at most {MAX_ARRAYS}")
    arrays: list[NDArray[Any]] = []
    # An array made on a view of bytes would have the bytes' owner for its base, and not tell that it cannot be written.
    memory = data if data.__class__ is bytes or not table else np.frombuffer(data, np.uint8)
    room = len(data) - start
    for number, entry in enumerate(table):
        try:
            name, shape, offset = entry
            dtype = DTYPES[name]
            count = 1
            for size in shape:
                if type(size) is not int or size < 0:
                    raise TypeError
                count *= size
            if type(offset) is not int or offset < 0:
                raise TypeError
            if offset % ALIGNMENT or len(shape) > 8 or (count and offset + count * dtype.itemsize > room):
                raise ValueError
            array: NDArray[Any] = np.ndarray(shape, dtype, memory, start + offset if count else 0)
        except (TypeError, KeyError):
            raise CodecError(f"array {number} is {brief(entry)}, expected dtype, shape and offset") from None
        except ValueError:
            raise CodecError(
                f"array {number} is {brief(entry)}, expected it to lie at a multiple of {ALIGNMENT} "
                f"within the {len(data)} bytes given"
            ) from None
        if not array.flags.aligned:  # compiled code is made for aligned arrays, and would be compiled anew
            array = array.copy()
            array.flags.writeable = False
        arrays.append(array)
    return arrays


def _writer(cls: type[Message]) -> Write:
    """A function made from source: a dict display is the fastest way from a message to what MessagePack takes.

    The source is made of the class's declaration alone; nothing that was sent or configured gets into it.
    """
    made: Write = eval(f"lambda message, arrays: {_fields_source(cls, 'message')}", {"__builtins__": {"len": len}})
    return made


def _fields_source(cls: type[Message], value: str) -> str:
    written = [f"{name!r}: {_value_source(kind, f'{value}.{name}', 0)}" for name, kind in cls.kinds.items()]
    return f"{{{', '.join(written)}}}"


def _value_source(kind: Kind, value: str, depth: int) -> str:
    """Expression that turns a value of this kind into what MessagePack takes."""
    if kind.form == "array":
        source = f"(arrays.append({value}) or len(arrays) - 1)"
    elif kind.form == "message":
        assert kind.message is not None
        source = _fields_source(kind.message, value)
    elif kind.form == "tuple":
        assert kind.item is not None
        item = f"item{depth}"
        source = f"[{_value_source(kind.item, item, depth + 1)} for {item} in {value}]"
        if source == f"[{item} for {item} in {value}]":
            source = value
    else:
        return value
    return f"(None if {value} is None else {source})" if kind.optional else source


def _reader(cls: type[Message]) -> Read:
    read = _READERS.get(cls)
    if read is None:
        read = _READERS[cls] = _make_reader(cls)
    return read


def _make_reader(cls: type[Message]) -> Read:
    names = tuple(cls.kinds)
    defaults = {f.name: f.default for f in fields(cls) if f.default is not MISSING}  # type: ignore[arg-type]
    special = [
        (place, name, read, kind.optional)
        for place, (name, kind) in enumerate(cls.kinds.items())
        if (read := _value_reader(kind)) is not None
    ]

    def read_message(values: Any, arrays: list[NDArray[Any]]) -> Message:
        if not isinstance(values, dict):
            raise CodecError(f"got {type(values).__name__}, expected a map of fields")
        try:
            given = [values[name] for name in names]
        except KeyError:
            missing = next((name for name in names if name not in values and name not in defaults), None)
            if missing is not None:
                raise CodecError(f"field {missing!r} is missing; got {brief(list(values))}") from None
            given = [values[name] if name in values else defaults[name] for name in names]
        for place, name, read, optional in special:
            value = given[place]
            if value is None and optional:
                continue
            try:
                given[place] = read(value, arrays)
            except (CodecError, MessageError) as error:
                raise CodecError(f"{name}: {error}") from None
        return cls(*given)

    return read_message


def _value_reader(kind: Kind) -> Read | None:
    """How a value of this kind is read; None where the message's own check is enough."""
    if kind.form == "array":
        return _read_array
    if kind.form == "message":
        assert kind.message is not None
        return _reader(kind.message)
    if kind.form == "tuple":
        assert kind.item is not None
        item, optional = _value_reader(kind.item), kind.item.optional
        if item is None:
            return None
        each = item

        def read_tuple(value: Any, arrays: list[NDArray[Any]]) -> Any:
            if not isinstance(value, list):
                raise CodecError(f"got {type(value).__name__}, expected a list")
            return tuple([None if entry is None and optional else each(entry, arrays) for entry in value])

        return read_tuple
    return None


def _read_array(value: Any, arrays: list[NDArray[Any]]) -> NDArray[Any]:
    if type(value) is not int or not 0 <= value < len(arrays):
        raise CodecError(f"got {brief(value)}, expected the number of one of {len(arrays)} arrays")
    return arrays[value]
