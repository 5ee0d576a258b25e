"""Encodes messages as bytes: one MessagePack header, then each array's raw bytes at a multiple of 64.

Layout: `u32 length of the header (little endian) | header | padding to 64 | array | padding to 64 | array …`. The
header is a map: `envelope` (key, sequence, tick, stamp_ns, cause_ns, epoch), `fields` by name, and `arrays`, a list of
(dtype, shape, offset from the first array). In `fields` an array is its index in that list. Schema name and version are
sent separately from the bytes. Decoding executes nothing and allocates only the values that the message class declares:
a header longer than the class allows is refused unread, and arrays are read-only views of the bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import MISSING, fields
from typing import Any

import msgpack
from numpy.typing import NDArray

from navloom.errors import NavloomError
from navloom.messages.arrays import memory_of, views
from navloom.messages.bounds import ALIGNMENT, LARGEST_HEADER, header_limit
from navloom.messages.envelope import Envelope
from navloom.messages.headers import read_header
from navloom.messages.kinds import MAX_ARRAYS, Kind, Message, MessageError, brief
from navloom.messages.packing import PAD, Arrays, Pads, pack, writer_of
from navloom.messages.schema import OLDER, SCHEMAS

__all__ = ["CodecError", "UnknownSchema", "add_blocks", "decode", "encode", "lead_of", "pack_time", "read_envelope",
           "redirected", "schema_label"]  # fmt: skip

SHORT, SHORT_LIST = 4096, 256
"""Largest header, bytes, and longest list in it that are unpacked at once, which is fastest and takes at most 3 MB."""
_LENGTH = struct.Struct("<I")
_pack_length = _LENGTH.pack
_ENVELOPE = b"\x83" + pack("envelope")
"""First bytes of a map of three, with its first key."""
_SIX = b"\x96"
"""First byte of a list of six."""

Read = Callable[[Any, list[NDArray[Any]]], Any]


class CodecError(NavloomError, ValueError):
    """Bytes are not the message that they claim to be. The text names the place, the value and the expectation."""


class UnknownSchema(CodecError):
    """A message's class, or its version of the class, is not declared in this process."""


_WAYS: dict[str, tuple[type[Message], type[Message], int]] = {}
"""By label: the class of today and of that version, and the largest header, bytes."""
_READERS: dict[type[Message], Read] = {}
"""By class: the reader of a header's values that accepts any version."""


def schema_label(cls: type[Message]) -> str:
    """Schema name and version that are sent with the bytes, as `navloom.Odometry/1`."""
    return f"{cls.schema_name}/{cls.schema_version}"


def encode(message: Message, envelope: Envelope | tuple[str, int, int, int, int, int]) -> bytes:
    """Bytes of a message in its envelope. Equal contents, bit for bit, give equal bytes."""
    cls = type(message)
    rest, arrays, pads, size = writer_of(cls)(message)
    if len(arrays) > MAX_ARRAYS:
        raise CodecError(f"{schema_label(cls)}: holds {len(arrays)} arrays, expected at most {MAX_ARRAYS}")
    lead = _ENVELOPE + pack(envelope)
    length = len(lead) + len(rest)
    # The limit is looked up only for long headers: few are.
    if length > SHORT and length > header_limit(cls):
        raise CodecError(f"{schema_label(cls)}: the header takes {length} bytes, expected at most {header_limit(cls)}")
    if not size:
        return _pack_length(length) + lead + rest
    pieces: list[Any] = [_pack_length(length), lead, rest]
    add_blocks(pieces, 4 + length, arrays, pads, size)
    return b"".join(pieces)


def add_blocks(pieces: list[Any], end: int, arrays: Arrays, pads: Pads, size: int) -> int:
    """Append the arrays of a message, each after its padding.

    Args:
        pieces: Bytes and arrays, to be joined.
        end: Offset at which the header ends, bytes.
        arrays, pads, size: As returned by a writer.

    Returns:
        Number of bytes appended.
    """
    gap = -end % ALIGNMENT
    pieces.append(PAD[gap])
    for pad, array in zip(pads, arrays, strict=True):
        if pad is not None:
            pieces += (pad, array)
    return gap + size


def lead_of(key: str) -> bytes:
    """First part of the header of a message with sequence 0, to be followed by `pack_time`."""
    return _ENVELOPE + _SIX + pack(key) + pack(0)


def pack_time(when: tuple[int, ...]) -> bytes:
    """Tick, stamp, cause and epoch of an envelope: its last part in the header."""
    return b"".join([pack(number) for number in when])


def decode(data: bytes | memoryview, label: str) -> tuple[Message, Envelope]:
    """Message and envelope from bytes, which must not change afterwards: arrays are views of them.

    Unknown fields are ignored, and a field with a default may be missing, as fields added later have one. A message of
    an older version that is declared here is returned as the present one. Arrays are copied only if the bytes are at an
    unaligned address.

    Raises:
        CodecError: Unknown schema, another version, or bytes that do not fit the schema.
    """
    way = _WAYS.get(label)
    if way is None or SCHEMAS.get(way[0].schema_name) is not way[0]:
        way = _new_way(label)
    now, cls, most = way
    if data.__class__ is not bytes:
        data = memoryview(data).cast("B").toreadonly()
    if len(data) < 4:
        raise CodecError(f"{label}: got {len(data)} bytes, expected a header of at least 4")
    end = 4 + _LENGTH.unpack_from(data)[0]
    if end > len(data):
        raise CodecError(f"{label}: the header claims {end - 4} bytes, {len(data) - 4} are there")
    # Refused before it is unpacked: a header of a few bytes may claim a list of a billion items.
    if end - 4 > most:
        raise CodecError(f"{label}: the header takes {end - 4} bytes, expected at most {most}")
    try:
        header = _header(data[4:end], cls)
        arrays = views(header.get("arrays"), memory_of(data), end + -end % ALIGNMENT)
        message = _reader(cls)(header.get("fields"), arrays)
        return message if cls is now else message.upgraded(), _envelope(header.get("envelope"))
    except (CodecError, MessageError) as error:
        raise CodecError(f"{label}: {error}") from None


def read_envelope(data: bytes | memoryview) -> Envelope:
    """Only the envelope, of a message of any class. Raises CodecError."""
    view = memoryview(data).cast("B")
    end = 4 + _LENGTH.unpack_from(view)[0] if len(view) >= 4 else 0
    if not 4 < end <= len(view):
        raise CodecError(f"got {len(view)} bytes, expected a header that fits into them")
    if end - 4 > LARGEST_HEADER:
        raise CodecError(f"the header takes {end - 4} bytes, expected at most {LARGEST_HEADER}")
    try:
        return _envelope(_header(view[4:end], None).get("envelope"))
    except MessageError as error:
        raise CodecError(str(error)) from None


def redirected(data: bytes | memoryview, key: str) -> tuple[bytes, Envelope]:
    """A message under another key, and its envelope then. Its class need not be known: nothing else is touched.

    Raises:
        CodecError: Bytes without an envelope.
    """
    envelope = read_envelope(data)._replace(key=key)
    view = memoryview(data).cast("B")
    end = 4 + _LENGTH.unpack_from(view)[0]
    unpacker = msgpack.Unpacker(max_buffer_size=end)
    unpacker.feed(view[4:end])
    lead, rest = b"", view[4:end]
    for _ in range(unpacker.read_map_header()):
        name, begin = unpacker.unpack(), 4 + unpacker.tell()
        unpacker.skip()
        if name == "envelope":  # the last of that name counts, as in decoding
            lead, rest = bytes(view[4:begin]) + pack(envelope), view[4 + unpacker.tell() : end]
    length, arrays = len(lead) + len(rest), view[end + -end % ALIGNMENT :]
    return b"".join(
        [_pack_length(length), lead, rest, PAD[-(4 + length) % ALIGNMENT] if arrays else b"", arrays]
    ), envelope


def _header(packed: bytes | memoryview, cls: type[Message] | None) -> dict[Any, Any]:
    """The header as a map: of a long one only the declared fields, and only the envelope if `cls` is None."""
    try:
        header = _built(packed, cls) if cls is not None and len(packed) <= SHORT else read_header(packed, cls)
    except MessageError:
        raise
    except Exception as error:
        raise CodecError(f"the header is not MessagePack: {brief(error)}") from None
    if not isinstance(header, dict):
        raise CodecError(f"the header is {type(header).__name__}, expected a map")
    return header


def _built(packed: bytes | memoryview, cls: type[Message]) -> Any:
    """A short header, unpacked at once; one that holds a long list is read like a long header."""
    try:
        return msgpack.unpackb(packed, max_array_len=SHORT_LIST)
    except ValueError:
        if len(packed) <= SHORT_LIST:
            raise
        return read_header(packed, cls)


def _new_way(label: str) -> tuple[type[Message], type[Message], int]:
    now, cls = _classes_of(label)
    way = _WAYS[label] = now, cls, header_limit(cls)
    return way


def _classes_of(label: str) -> tuple[type[Message], type[Message]]:
    """The class of today, and that of the label's version."""
    name, _, version = label.partition("/")
    cls = SCHEMAS.get(name)
    if cls is None:
        raise UnknownSchema(
            f"schema {brief(label)} is unknown here: the sender runs another set of plugins or versions"
        )
    # Versions differ in meaning, not only in fields: guessing would drive a robot by wrong numbers.
    if version != str(cls.schema_version) and label not in OLDER:
        raise UnknownSchema(
            f"schema {brief(label)}: this side speaks version {cls.schema_version}; update the older side"
        )
    return cls, OLDER.get(label, cls)


def _envelope(value: Any) -> Envelope:
    if not isinstance(value, list) or len(value) < 6:
        raise CodecError(f"envelope is {brief(value)}, expected key, sequence, tick, stamp, cause and epoch")
    key, sequence, tick, stamp, cause, epoch = value[:6]
    if (
        type(key) is not str
        or not type(sequence) is type(tick) is type(stamp) is type(cause) is type(epoch) is int
        or (sequence | tick | stamp | cause | epoch) >> 63  # nonzero if one is negative
    ):
        raise CodecError(f"envelope is {brief(value)}, expected one string and five whole numbers >= 0")
    return Envelope(key, sequence, tick, stamp, cause, epoch)


def _reader(cls: type[Message]) -> Read:
    found = _READERS.get(cls)
    if found is None:
        found = _READERS[cls] = _make_reader(cls)
    return found


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
            # Messages of this version have all fields; only others need the slower way below.
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
    """The reader of a value of this kind; None if the message's own check is enough."""
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
