"""Properties of every message class, for any contents."""

from __future__ import annotations

import math
import struct
from dataclasses import MISSING, fields
from typing import Any

import msgpack
import navloom.messages
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from navloom.messages import SCHEMAS, Array, Envelope, Message
from navloom.messages.codec import CodecError, decode, encode, schema_label
from navloom.messages.schema import Kind

CLASSES = sorted(
    (cls for cls in SCHEMAS.values() if cls.__module__.startswith(navloom.messages.__name__)), key=lambda c: c.__name__
)
EACH = pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: cls.__name__)
QUICK = settings(max_examples=8, deadline=None, suppress_health_check=list(HealthCheck))
WHOLE = st.integers(-(2**63), 2**63 - 1)
RULED: dict[str, st.SearchStrategy[Any]] = {
    "heading": st.floats(-math.pi, math.pi),
    "positive": st.floats(0.0, exclude_min=True, allow_infinity=False),
    "not_negative": st.floats(0.0, allow_infinity=False),
    "stamp": st.integers(0, 2**63 - 1),
}
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)


@st.composite
def envelopes(draw: st.DrawFn) -> Envelope:
    return Envelope(draw(TEXT), *[draw(st.integers(0, 2**63 - 1)) for _ in range(5)])


@st.composite
def messages(draw: st.DrawFn, cls: type[Message]) -> Message:
    """A message with any contents its declaration allows."""
    sizes: dict[str, int] = {}
    return cls(*[draw(values(kind, sizes)) for kind in cls.kinds.values()])


def values(kind: Kind, sizes: dict[str, int]) -> st.SearchStrategy[Any]:
    made: st.SearchStrategy[Any]
    if kind.form == "array":
        assert kind.array is not None
        made = arrays(kind.array, sizes)
    elif kind.form == "message":
        assert kind.message is not None
        made = messages(kind.message)
    elif kind.form == "tuple":
        assert kind.item is not None
        made = st.lists(values(kind.item, {}), max_size=3).map(tuple)
    elif kind.form == "float":
        made = RULED.get(kind.rule, floats(kind.infinite, None, 64))
    elif kind.form == "str":
        made = st.sampled_from(kind.choices) if kind.choices else TEXT
    else:
        made = {"int": RULED.get(kind.rule, WHOLE), "bool": st.booleans()}[kind.form]
    return st.none() | made if kind.optional else made


def floats(infinite: bool, at_least: float | None, width: Any) -> st.SearchStrategy[float]:
    finite = st.floats(at_least, allow_nan=False, allow_infinity=False, width=width)
    return finite | st.just(math.inf) if infinite else finite


@st.composite
def arrays(draw: st.DrawFn, spec: Array, sizes: dict[str, int]) -> np.ndarray:
    shape = tuple(
        size if isinstance(size, int) else sizes.setdefault(size, draw(st.integers(not spec.may_be_empty, 4)))
        for size in spec.shape
    )
    dtype = np.dtype(spec.dtype)
    elements = floats(spec.infinite, spec.at_least, 8 * dtype.itemsize) if dtype.kind == "f" else None
    if spec.at_most is not None:
        elements = st.integers(int(spec.at_least or 0), int(spec.at_most))
    return draw(hnp.arrays(dtype, shape, elements=elements))


def contents(value: Any) -> Any:
    """A message as plain values that compare bit for bit."""
    if isinstance(value, Message):
        return type(value), [contents(field) for field in value.read_fields()]
    if isinstance(value, tuple):
        return [contents(item) for item in value]
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    return (float, value.hex()) if isinstance(value, float) else (type(value), value)


def arrays_of(value: Any) -> list[np.ndarray]:
    if isinstance(value, Message):
        return [array for field in value.read_fields() for array in arrays_of(field)]
    if isinstance(value, tuple):
        return [array for item in value for array in arrays_of(item)]
    return [value] if isinstance(value, np.ndarray) else []


def split(data: bytes) -> tuple[Any, bytes]:
    """Header and what lies behind it, from the first multiple of 64 on."""
    (length,) = struct.unpack_from("<I", data)
    return msgpack.unpackb(data[4 : 4 + length]), data[4 + length + -(4 + length) % 64 :]


def joined(header: Any, tail: bytes) -> bytes:
    packed = msgpack.packb(header)
    head = struct.pack("<I", len(packed)) + packed
    return head + bytes(-len(head) % 64) + tail


def test_there_are_classes_to_check() -> None:
    assert len(CLASSES) >= 35


@EACH
@QUICK
@given(st.data())
def test_every_message_survives_a_round_trip(cls: type[Message], data: st.DataObject) -> None:
    made, at = data.draw(messages(cls)), data.draw(envelopes())
    back, came = decode(encode(made, at), schema_label(cls))
    assert contents(back) == contents(made) and came == at


@EACH
@QUICK
@given(st.data())
def test_the_same_contents_give_the_same_bytes_and_others_do_not(cls: type[Message], data: st.DataObject) -> None:
    made, other, at = data.draw(messages(cls)), data.draw(messages(cls)), data.draw(envelopes())
    again = cls(*made.read_fields())
    assert encode(again, at) == encode(made, at) == encode(decode(encode(made, at), schema_label(cls))[0], at)
    assert (encode(other, at) == encode(made, at)) == (contents(other) == contents(made))


@EACH
@QUICK
@given(st.data())
def test_arrays_are_read_only_views_of_the_bytes_at_multiples_of_64_or_were_seen_before(
    cls: type[Message], data: st.DataObject
) -> None:
    sent = encode(data.draw(messages(cls)), data.draw(envelopes()))
    memory = np.frombuffer(sent, np.uint8)
    for array in arrays_of(decode(sent, schema_label(cls))[0]):
        assert not array.flags.writeable and array.flags.c_contiguous and array.flags.aligned
        if array.size:
            assert np.shares_memory(array, memory)
            assert (array.ctypes.data - memory.ctypes.data) % 64 == 0


@EACH
@QUICK
@given(st.data())
def test_unknown_fields_are_skipped_and_each_known_one_without_a_default_is_required(
    cls: type[Message], data: st.DataObject
) -> None:
    made, at = data.draw(messages(cls)), data.draw(envelopes())
    header, tail = split(encode(made, at))
    name = data.draw(st.sampled_from(list(cls.kinds)))
    header["fields"]["unknown"] = data.draw(plain)
    assert contents(decode(joined(header, tail), schema_label(cls))[0]) == contents(made)
    del header["fields"][name]
    (declared,) = [field for field in fields(cls) if field.name == name]  # type: ignore[arg-type]
    if declared.default is MISSING:
        with pytest.raises(CodecError, match=f"field '{name}' is missing"):
            decode(joined(header, tail), schema_label(cls))
    else:
        assert getattr(decode(joined(header, tail), schema_label(cls))[0], name) == declared.default


@EACH
@QUICK
@given(st.data())
def test_every_truncation_is_refused(cls: type[Message], data: st.DataObject) -> None:
    sent = encode(data.draw(messages(cls)), data.draw(envelopes()))
    end = data.draw(st.integers(0, len(sent) - 1))
    with pytest.raises(CodecError):
        decode(sent[:end], schema_label(cls))


@EACH
@QUICK
@given(st.data())
def test_flipped_bytes_give_a_message_or_a_codec_error(cls: type[Message], data: st.DataObject) -> None:
    sent = bytearray(encode(data.draw(messages(cls)), data.draw(envelopes())))
    for _ in range(data.draw(st.integers(1, 4))):
        sent[data.draw(st.integers(0, len(sent) - 1))] = data.draw(st.integers(0, 255))
    only_codec_errors(bytes(sent), cls)


plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text(max_size=4)
    | st.binary(max_size=4) | st.sampled_from(["<f8", "|i1", ">f8", "|O"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)  # fmt: skip


@EACH
@QUICK
@given(st.data())
def test_any_value_in_any_place_gives_a_message_or_a_codec_error(cls: type[Message], data: st.DataObject) -> None:
    header, tail = split(encode(data.draw(messages(cls)), data.draw(envelopes())))
    place = data.draw(st.sampled_from([*cls.kinds, "fields", "arrays", "envelope", "entry"]))
    if place in cls.kinds:
        header["fields"][place] = data.draw(plain)
    elif place != "entry":
        header[place] = data.draw(plain)
    elif header["arrays"]:
        entry = data.draw(st.sampled_from(header["arrays"]))
        entry[data.draw(st.integers(0, 2))] = data.draw(
            plain | st.lists(st.integers(-1, 2**64 - 1), max_size=10) | st.integers(-64, 2**40)
        )
    only_codec_errors(joined(header, tail), cls)


@given(st.binary(max_size=200), st.sampled_from(CLASSES))
@settings(max_examples=300, deadline=None)
def test_random_bytes_are_refused(data: bytes, cls: type[Message]) -> None:
    for sent in (data, struct.pack("<I", len(data)) + data, struct.pack("<I", max(0, len(data) - 64)) + data):
        with pytest.raises(CodecError):
            decode(sent, schema_label(cls))


@given(plain, st.sampled_from(CLASSES))
@settings(max_examples=300, deadline=None)
def test_random_headers_are_refused(header: Any, cls: type[Message]) -> None:
    with pytest.raises(CodecError):
        decode(joined(header, b""), schema_label(cls))


def only_codec_errors(data: bytes, cls: type[Message]) -> None:
    """Decode; the result is a CodecError, or a message that can be encoded again."""
    try:
        back, at = decode(data, schema_label(cls))
    except CodecError as error:
        assert len(str(error)) < 2000
    else:
        assert contents(decode(encode(back, at), schema_label(cls))[0]) == contents(back)
