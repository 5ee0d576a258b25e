"""Fast reader: turns headers written by this version into messages without calling the field checks.

`msgspec` reads a header into structs generated from the class's declaration, including value ranges. They accept only
the declared fields, so their values fit, and a generated function sets them in the message. Each distinct table of
arrays is checked once, the arrays' values each time. Anything else raises an exception: the general reader in `codec`
then reads the header, which another version may have written, or reports the error.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, Literal

import msgpack
import numpy as np
from msgspec import Meta, Raw, defstruct
from msgspec.msgpack import Decoder

from navloom.messages.arrays import Memory, recalling, views
from navloom.messages.checks import Check, checker, contents_check
from navloom.messages.envelope import Envelope
from navloom.messages.kinds import Kind, Message, holds_array

__all__ = ["SHORT", "SHORT_LIST", "Typed", "typed_reader"]

SHORT, SHORT_LIST = 4096, 256
"""Largest header, bytes, and longest list in it that are unpacked at once, which is fastest and takes at most 3 MB."""

Typed = Callable[[bytes | memoryview, Memory, int], tuple[Message, Envelope]]
"""(header, all bytes, offset of the arrays) -> message and envelope; raises for anything that it does not accept."""

_Places = list[tuple[tuple[int, ...], int]]
"""Shape and offset of each array."""
_MOST_TABLES = 256
"""Most cached tables of arrays for each class; a run has few shapes."""
_MOST, _MOST_INT = sys.float_info.max, 2**63 - 1
_RANGES = {
    "heading": Meta(ge=-math.pi, le=math.pi),
    "positive": Meta(gt=0.0, le=_MOST),
    "not_negative": Meta(ge=0.0, le=_MOST),
    "stamp": Meta(ge=0, le=_MOST_INT),
    "float": Meta(ge=-_MOST, le=_MOST),
    "infinite": Meta(ge=-_MOST),
    "int": Meta(ge=-_MOST_INT - 1, le=_MOST_INT),
}
_UTF8 = 4
"""Most bytes of a character."""
_READ = """
def read(packed, memory, start):
    header = decode(packed)
    envelope = header.envelope
    if (envelope[1] | envelope[2] | envelope[3] | envelope[4] | envelope[5]) >> 63:
        raise ValueError
    fields = header.fields{places}
    {message}
    return message, envelope
"""
_PLACES = """
    if memory.__class__ is not bytes and memory.ctypes.data % 8:
        raise ValueError
    table = bytes(header.arrays)
    places = tables.get(table) or learn(table, memory, start)"""

_TYPED: dict[type[Message], Typed] = {}


def typed_reader(cls: type[Message]) -> Typed:
    """The fast reader of a class, made on first use."""
    found = _TYPED.get(cls)
    if found is None:
        found = _TYPED[cls] = _Reader(cls).compiled()
    return found


class _Reader:
    """Generates the source of one reader from the class's declaration alone, without any received text.

    Attributes:
        arrays: For each array, the variable of the message that holds it, its field, and its check.
        tables: Places of the arrays, by the bytes of a table that passed the checks.
        names: Names that the source uses.
    """

    def __init__(self, cls: type[Message]) -> None:
        self.cls = cls
        self.arrays: list[tuple[str, str, Check]] = []
        self.tables: dict[bytes, _Places] = {}
        self.names: dict[str, Any] = {
            "new": object.__new__,
            "tables": self.tables,
            "learn": self.learn,
        }

    def compiled(self) -> Typed:
        lines: list[str] = []
        fields = self.struct(self.cls, "fields", "message", lines)
        parts = [("envelope", Envelope), ("fields", fields), ("arrays", Raw if self.arrays else tuple[()])]
        # `gc=False`: these structs live for microseconds and hold no cycles.
        self.names["decode"] = Decoder(defstruct("Header", parts, forbid_unknown_fields=True, gc=False)).decode
        places = _PLACES if self.arrays else ""
        read: Typed = self.function("read", _READ.format(places=places, message="\n    ".join(lines)))
        return read

    def function(self, name: str, source: str) -> Any:
        exec(compile(source, f"<reader of {self.cls.__name__}>", "exec"), self.names)
        return self.names.pop(name)

    def named(self, value: Any) -> str:
        name = f"_{len(self.names)}"
        self.names[name] = value
        return name

    def struct(self, cls: type[Message], value: str, made: str, lines: list[str]) -> Any:
        """The type of a map with exactly these fields; appends lines that build a message from a value of this type."""
        lines.append(f"{made} = new({self.named(cls)})")
        parts: list[tuple[str, Any]] = []
        for name, kind in cls.kinds.items():
            place, held = f"{value}.{name}", f"{made}_{name}"
            if kind.array is not None and not kind.optional:
                number = len(self.arrays)
                self.arrays.append((made, name, checker(cls.__name__, kind)))
                refuse = contents_check(kind.array)
                bound = None if refuse is None else partial(refuse, cls.__name__, name, kind.array)
                view = recalling(np.dtype(kind.array.dtype), bound)
                lines += [f"shape, offset = places[{number}]"]
                lines += [f"{held} = {self.named(view)}(shape, memory, start + offset)"]
                found: Any = Literal[number]
            elif kind.message is not None and not kind.optional:
                found = self.struct(kind.message, place, held, lines)
            else:
                found, held = self.plain(kind, place)
            lines.append(f"{self.named(cls.__dict__[name].__set__)}({made}, {held})")
            parts.append((name, found))
        return defstruct(cls.__name__, parts, forbid_unknown_fields=True, gc=False)

    def plain(self, kind: Kind, value: str) -> tuple[Any, str]:
        """The type of a value, and the expression for it in a message. What may hold arrays must be None or empty."""
        if kind.optional:
            if holds_array(kind):
                return None, "None"
            found, held = self.plain(replace(kind, optional=False), value)
            return found | None, held if held == value else f"(None if {value} is None else {held})"
        if kind.message is not None:
            lines: list[str] = []
            found = self.struct(kind.message, "value", "made", lines)
            make = self.function("make", "\n    ".join(["def make(value):", *lines, "return made"]))
            return found, f"{self.named(make)}({value})"
        if kind.item is not None:
            if holds_array(kind):
                return tuple[()], "()"
            item, held = self.plain(kind.item, "item")
            most = Meta(max_length=min(kind.most, SHORT_LIST))
            found = Annotated[tuple[item, ...], most]  # type: ignore[valid-type]
            return found, value if held == "item" else f"tuple([{held} for item in {value}])"
        return _scalar(kind), value

    def learn(self, table: bytes, memory: Memory, start: int) -> _Places:
        """Places of the arrays of a table, after a check of type and shape. Raises ValueError."""
        entries = msgpack.unpackb(table)
        sizes: dict[str, dict[str, int]] = {}
        for (made, name, check), array in zip(self.arrays, views(entries, memory, start), strict=True):
            check(name, array, sizes.setdefault(made, {}))
        # Or a publisher with changing shapes would fill the memory.
        if len(self.tables) >= _MOST_TABLES:
            self.tables.clear()
        places = self.tables[table] = [(tuple(shape), offset) for _, shape, offset in entries]
        return places


def _scalar(kind: Kind) -> Any:
    if kind.choices:
        return Literal[kind.choices]
    if kind.form == "str":
        # msgspec counts characters and the bound is in bytes: what may be too long goes to the general reader.
        return Annotated[str, Meta(max_length=kind.most // _UTF8)]
    if kind.form == "bool":
        return bool
    held = _RANGES["infinite" if kind.infinite else kind.rule or kind.form]
    return Annotated[float, held] if kind.form == "float" else Annotated[int, held]
