"""The generated writers give the same bytes as msgpack for a message as a dict."""

from __future__ import annotations

import math
import struct
from typing import Any

import msgpack
import navloom.messages
import numpy as np
import pytest
from navloom.messages import SCHEMAS, Array, Envelope, Message
from navloom.messages.codec import encode
from navloom.messages.kinds import Kind

CLASSES = sorted(
    (cls for cls in SCHEMAS.values() if cls.__module__.startswith(navloom.messages.__name__)), key=lambda c: c.__name__
)
WHOLE = [0, 1, -1, 127, 128, 255, 256, -32, -33, -128, -129, 65535, 65536, 2**32 - 1, 2**32, 2**63 - 1, -(2**63)]
NUMBERS = [0.0, -0.0, 1.0, 0.1, 1e-300, 1e300, 3.0]
TEXTS = ["", "why", "é", "x" * 31, "x" * 32, "ü" * 128, "x" * 70_000]


def value(kind: Kind, rng: np.random.Generator, sizes: dict[str, int]) -> Any:
    """A value of a kind; extremes are as likely as all others."""
    if kind.optional and rng.random() < 0.3:
        return None
    if kind.form == "array":
        assert kind.array is not None
        return array(kind.array, rng, sizes)
    if kind.form == "message":
        assert kind.message is not None
        return message(kind.message, rng)
    if kind.form == "tuple":
        assert kind.item is not None
        return tuple(value(kind.item, rng, {}) for _ in range(rng.choice([0, 1, 3, 20])))
    if kind.form == "float":
        number = NUMBERS[rng.integers(len(NUMBERS))]
        if kind.rule:
            return float(rng.uniform(1e-3, math.pi))
        return math.inf if kind.infinite and rng.random() < 0.5 else number * rng.choice([-1.0, 1.0])
    if kind.form == "str":
        texts = kind.choices or [text for text in TEXTS if len(text.encode()) <= kind.most]
        return texts[rng.integers(len(texts))]
    if kind.form == "bool":
        return bool(rng.random() < 0.5)
    number = WHOLE[rng.integers(len(WHOLE))]
    return abs(number) % 2**63 if kind.rule == "stamp" else number


def array(spec: Array, rng: np.random.Generator, sizes: dict[str, int]) -> np.ndarray[Any, Any]:
    least = 0 if spec.may_be_empty else 1
    shape = [
        size if isinstance(size, int) else sizes.setdefault(size, int(rng.integers(least, 9))) for size in spec.shape
    ]
    if np.dtype(spec.dtype).kind == "f":
        made = rng.random(shape).astype(spec.dtype)
        if spec.infinite and made.size:
            made.flat[0] = math.inf
        return made
    return rng.integers(0, 2, shape).astype(spec.dtype)


def message(cls: type[Message], rng: np.random.Generator) -> Message:
    sizes: dict[str, int] = {}
    return cls(*[value(kind, rng, sizes) for kind in cls.kinds.values()])


def as_plain(held: Any, arrays: list[np.ndarray[Any, Any]]) -> Any:
    """A value as msgpack takes it; an array becomes its index in the list."""
    if isinstance(held, Message):
        return {name: as_plain(getattr(held, name), arrays) for name in type(held).kinds}
    if isinstance(held, tuple):
        return [as_plain(item, arrays) for item in held]
    if isinstance(held, np.ndarray):
        arrays.append(held)
        return len(arrays) - 1
    return held


def plainly_encoded(given: Message, envelope: Envelope) -> bytes:
    """Bytes in the layout of the codec's docstring, written with msgpack alone."""
    arrays: list[np.ndarray[Any, Any]] = []
    fields = as_plain(given, arrays)
    table, blocks = [], b""
    for one in arrays:
        if one.size:
            blocks += bytes(-len(blocks) % 64)
        table.append((one.dtype.str, one.shape, len(blocks) if one.size else 0))
        blocks += one.tobytes()
    header: bytes = msgpack.packb({"envelope": tuple(envelope), "fields": fields, "arrays": table})
    begin = struct.pack("<I", len(header)) + header
    return begin + (bytes(-len(begin) % 64) + blocks if blocks else b"")


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: cls.__name__)
def test_the_generated_writer_gives_the_bytes_of_msgpack(cls: type[Message]) -> None:
    rng = np.random.default_rng(7)
    for tick in (0, 127, 70_000, 2**40):
        for _ in range(25):
            given = message(cls, rng)
            envelope = Envelope("realm/robot/role/instance/" + "p" * int(rng.integers(1, 40)), tick, tick, 5, 2**62, 3)
            assert encode(given, envelope) == plainly_encoded(given, envelope)
