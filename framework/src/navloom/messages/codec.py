"""Messages as bytes: one MessagePack header, then each array's raw bytes at a multiple of 64.

Layout: `u32 length of the header (little endian) | header | padding to 64 | array | padding to 64 | array …`. The
header is a map: `envelope` (key, sequence, tick, stamp_ns, cause_ns, epoch), `fields` by name, and `arrays`, a list of
(dtype, shape, offset from the first array). In `fields` an array is its place in that list. Schema name and version
travel beside the bytes. Nothing is executed in decoding, and nothing is allocated beyond the values that a header's
class declares: a header longer than that class allows is refused unread, and arrays are read-only views of the bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import MISSING, fields
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from navloom.messages.bounds import ALIGNMENT, LARGEST_HEADER, header_limit
from navloom.messages.envelope import Envelope
from navloom.messages.headers import read_header
from navloom.messages.kinds import DTYPES, MAX_ARRAYS, Kind, Message, MessageError, brief
from navloom.messages.packing import PACKER, PAD, Arrays, Pads, writer_of
from navloom.messages.schema import SCHEMAS

__all__ = ["CodecError", "UnknownSchema", "add_blocks", "decode", "encode", "lead_of", "pack_time", "read_envelope",
           "schema_label"]  # fmt: skip

SHORT, SHORT_LIST = 4096, 256
"""Bytes of a header, and items of each list in it, up to which it is built as a whole: the fastest, 3 MB at most."""
_LENGTH = struct.Struct("<I")
_pack_length = _LENGTH.pack
_ENVELOPE = b"\x83" + PACKER.pack("envelope")
"""Begin of a map of three, with its first key."""
_SIX = b"\x96"
"""Begin of a list of six."""

Read = Callable[[Any, list[NDArray[Any]]], Any]


class CodecError(ValueError):
    """Bytes that are not the message they claim to be; the text names the place, the value and the expectation."""


class UnknownSchema(CodecError):
    """A message of a class, or of a version of it, that is not declared in this process."""


_READERS: dict[type[Message], tuple[Read, int]] = {}
"""How each class is read, and bytes of its header at most."""


def schema_label(cls: type[Message]) -> str:
    """Name and version that travel beside the bytes, as `navloom.Odometry/1`."""
    return f"{cls.schema_name}/{cls.schema_version}"


def encode(message: Message, envelope: Envelope | tuple[str, int, int, int, int, int]) -> bytes:
    """Bytes of a message in its envelope. The same contents, bit for bit, give the same bytes."""
    cls = type(message)
    rest, arrays, pads, size = writer_of(cls)(message)
    if len(arrays) > MAX_ARRAYS:
        raise CodecError(f"{schema_label(cls)}: holds {len(arrays)} arrays, expected at most {MAX_ARRAYS}")
    lead = _ENVELOPE + PACKER.pack(envelope)
    length = len(lead) + len(rest)
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
        pieces: Bytes, and arrays that stand for their memory.
        end: Byte at which the header ends.
        arrays, pads, size: As a writer gives them.

    Returns:
        How many bytes were appended.
    """
    gap = -end % ALIGNMENT
    pieces.append(PAD[gap])
    for pad, array in zip(pads, arrays, strict=True):
        if pad is not None:
            pieces += (pad, array)
    return gap + size


def lead_of(key: str) -> bytes:
    """Begin of the header of a message with sequence 0: what `pack_time` gives follows."""
    return _ENVELOPE + _SIX + PACKER.pack(key) + PACKER.pack(0)


def pack_time(when: tuple[int, ...]) -> bytes:
    """Tick, stamp, cause and epoch of an envelope, its end in the header."""
    return b"".join([PACKER.pack(number) for number in when])


def decode(data: bytes | memoryview, label: str) -> tuple[Message, Envelope]:
    """Message and envelope from bytes, which must not change afterwards: arrays are views of them.

    Unknown fields are passed over, and one with a default, as those added later have, may be missing. Only where the
    bytes lie at an odd address are arrays copied.

    Raises:
        CodecError: Unknown schema, another version, or bytes that do not fit the schema.
    """
    cls = _class_of(label)
    read, most = _READERS.get(cls) or _reader(cls)
    if data.__class__ is not bytes:
        data = memoryview(data).cast("B").toreadonly()
    if len(data) < 4:
        raise CodecError(f"{label}: got {len(data)} bytes, expected a header of at least 4")
    end = 4 + _LENGTH.unpack_from(data)[0]
    if end > len(data):
        raise CodecError(f"{label}: the header claims {end - 4} bytes, {len(data) - 4} are there")
    if end - 4 > most:
        raise CodecError(f"{label}: the header takes {end - 4} bytes, expected at most {most}")
    try:
        header = _header(data[4:end], cls)
        arrays = _arrays(header.get("arrays"), data, end + -end % ALIGNMENT)
        message = read(header.get("fields"), arrays)
        return message, _envelope(header.get("envelope"))
    except (CodecError, MessageError) as error:
        raise CodecError(f"{label}: {error}") from None


def read_envelope(data: bytes | memoryview) -> Envelope:
    """The envelope alone, whatever the message is. Raises CodecError."""
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


def _header(packed: bytes | memoryview, cls: type[Message] | None) -> dict[Any, Any]:
    """The map that a header is: of a long one only what is declared, for None the envelope alone."""
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
    """A short header, built as a whole; one with a long list in it is read as a long header is."""
    try:
        return msgpack.unpackb(packed, max_array_len=SHORT_LIST)
    except ValueError:
        if len(packed) <= SHORT_LIST:
            raise
        return read_header(packed, cls)


def _class_of(label: str) -> type[Message]:
    name, _, version = label.partition("/")
    cls = SCHEMAS.get(name)
    if cls is None:
        raise UnknownSchema(
            f"schema {brief(label)} is unknown here: the sender runs another set of plugins or versions"
        )
    if version != str(cls.schema_version):
        raise UnknownSchema(
            f"schema {brief(label)}: this side speaks version {cls.schema_version}; update the older side"
        )
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


def _reader(cls: type[Message]) -> tuple[Read, int]:
    found = _READERS.get(cls)
    if found is None:
        found = _READERS[cls] = _make_reader(cls), header_limit(cls)
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
        return _reader(kind.message)[0]
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
