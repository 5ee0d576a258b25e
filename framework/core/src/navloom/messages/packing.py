"""Writes messages as MessagePack with a generated writer for each class; the bytes equal msgpack's for the fields.

A header's `fields` and `arrays` are mostly constant: names, map sizes, type bytes of doubles. A generated writer packs
each run of constants, floats and bools with one `struct`; ints, free text and tuples are packed by `msgspec`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any

import msgpack
from msgspec.msgpack import Encoder
from numpy.typing import NDArray

from navloom.messages.bounds import ALIGNMENT
from navloom.messages.kinds import Kind, Message, holds_array

__all__ = ["PAD", "Arrays", "Pads", "Write", "pack", "writer_of"]

Arrays = Sequence[NDArray[Any]]
Pads = Sequence[bytes | None]
Write = Callable[[Any], tuple[bytes, Arrays, Pads, int]]
"""Message -> header after the envelope; arrays; padding before each, None if empty; size of all blocks, bytes."""
_WRITERS: dict[type[Message], Write] = {}
_Table = tuple[bytes, Pads, int]
_Tables = dict[tuple[Any, ...], _Table]
_MOST_TABLES = 256
"""Most cached tables of arrays for each class; a run has few shapes."""
PAD = [bytes(n) for n in range(ALIGNMENT)]
_NIL, _FALSE, _TRUE, _DOUBLE = 0xC0, 0xC2, 0xC3, b"\xcb"
_Token = tuple[str, Any]
"""("constant", bytes), ("float", expression), ("bool", expression) or ("bytes", expression)."""


pack = Encoder().encode
"""Packs a value as MessagePack, a message as the map of its fields: msgpack's bytes, but faster for messages."""
_KEY = "tuple([(array.dtype, array.shape) for array in arrays])"
_LAY = ["    table, pads, size = tables.get(key) or new_table(tables, key, arrays)"]


def writer_of(cls: type[Message]) -> Write:
    """The generated writer of a class."""
    write = _WRITERS.get(cls)
    if write is None:
        write = _WRITERS[cls] = _Writer(cls).compiled()
    return write


def _new_table(tables: _Tables, key: tuple[Any, ...], arrays: Arrays) -> _Table:
    """Table of (dtype, shape, offset) as MessagePack, padding and size of the blocks; cached for the next message."""
    table, pads, end = [], [], 0
    for array in arrays:
        pad, size = -end % ALIGNMENT, array.nbytes
        table.append((array.dtype.str, array.shape, end + pad if size else 0))
        pads.append(PAD[pad] if size else None)
        end += pad + size if size else 0
    # Point clouds have another shape each time; the cache must not grow with them.
    if len(tables) >= _MOST_TABLES:
        tables.clear()
    made = tables[key] = pack(table), tuple(pads), end
    return made


class _Writer:
    """Generates one writer's source from the class's declaration alone, without any received or configured text."""

    def __init__(self, cls: type[Message]) -> None:
        self.cls = cls
        self.names: dict[str, Any] = {
            "pack": pack,
            "join": b"".join,
            "nil": bytes([_NIL]),
            "double": struct.Struct(">Bd").pack,
            "tables": {},
            "new_table": _new_table,
            # Generated code can reach nothing else.
            "__builtins__": {"len": len, "tuple": tuple},
        }
        self.arrays: list[str] = []
        # The index of an array is constant unless an array may be missing, or a tuple holds arrays.
        self.is_fixed = all(_always_holds_its_arrays(kind) for kind in cls.kinds.values())

    def compiled(self) -> Write:
        tokens = [
            ("constant", pack("fields")),
            *self.fields(self.cls, "message"),
            ("constant", pack("arrays")),
        ]
        # Generated, because constant bytes (names, sizes) can then be packed together: half the time of `msgspec` alone
        # for a command.
        lines = ["def write(message):"]
        if not self.is_fixed:
            fields = self.joined(tokens)
            lines += ["    arrays = []", f"    fields = {fields}", f"    key = {_KEY}", *_LAY]
            lines += ["    return fields + table, arrays, pads, size"]
        elif self.arrays:
            rest = self.joined([*tokens, ("bytes", "table")])
            lines += [f"    arrays = ({', '.join(self.arrays)},)"]
            lines += [f"    key = ({', '.join(f'{array}.shape' for array in self.arrays)},)", *_LAY]
            lines += [f"    return {rest}, arrays, pads, size"]
        else:
            lines += [f"    return {self.joined([*tokens, ('constant', pack([]))])}, (), (), 0"]
        exec(compile("\n".join(lines), f"<writer of {self.cls.__name__}>", "exec"), self.names)
        write: Write = self.names["write"]
        return write

    def fields(self, cls: type[Message], value: str) -> list[_Token]:
        tokens: list[_Token] = [("constant", bytes(msgpack.Packer().pack_map_header(len(cls.kinds))))]
        for name, kind in cls.kinds.items():
            tokens += [("constant", pack(name)), *self.value(kind, f"{value}.{name}")]
        return tokens

    def value(self, kind: Kind, value: str) -> list[_Token]:
        if kind.optional:
            if kind.form == "float":
                written = f"double({_DOUBLE[0]}, {value})"
            else:
                written = self.joined(self.required(kind, value))
            return [("bytes", f"(nil if {value} is None else {written})")]
        return self.required(kind, value)

    def required(self, kind: Kind, value: str) -> list[_Token]:
        if kind.form in ("float", "bool"):
            return [(kind.form, value)]
        if kind.form == "message":
            assert kind.message is not None
            return self.fields(kind.message, value)
        if kind.form == "array" and self.is_fixed:
            self.arrays.append(value)
            return [("constant", pack(len(self.arrays) - 1))]
        if kind.choices:
            return [("bytes", f"{self.named({choice: pack(choice) for choice in kind.choices})}[{value}]")]
        return [("bytes", f"pack({plain_source(kind, value, 0)})")]

    def joined(self, tokens: list[_Token]) -> str:
        """Expression for the joined bytes of all tokens."""
        pieces: list[str] = []
        run: list[_Token] = []
        for token in [*tokens, ("bytes", "")]:
            if token[0] != "bytes":
                run.append(token)
                continue
            pieces += [self.packed(run)] * bool(run) + [token[1]] * bool(token[1])
            run = []
        return pieces[0] if len(pieces) == 1 else f"join(({', '.join(pieces)}))"

    def packed(self, run: list[_Token]) -> str:
        """Expression for a run of constants, floats and bools: one call of a `struct`, or a constant."""
        form, values, constant = ">", [], b""
        for what, value in [*run, ("constant", None)]:
            if what == "constant" and value is not None:
                constant += value
                continue
            constant += _DOUBLE if what == "float" else b""
            if constant:
                form += f"{len(constant)}s"
                values.append(self.named(constant))
                constant = b""
            if value is not None:
                form += "d" if what == "float" else "B"
                values.append(value if what == "float" else f"{_TRUE} if {value} else {_FALSE}")
        if len(values) == 1:
            return values[0]
        return f"{self.named(struct.Struct(form).pack)}({', '.join(values)})"

    def named(self, value: Any) -> str:
        name = f"_{len(self.names)}"
        self.names[name] = value
        return name


def _always_holds_its_arrays(kind: Kind) -> bool:
    """Whether every message has the same number of arrays in a field of this kind."""
    if kind.form == "array":
        return not kind.optional
    if kind.message is not None:
        inner = kind.message.kinds.values()
        if kind.optional:
            return not any(holds_array(one) for one in inner)
        return all(_always_holds_its_arrays(one) for one in inner)
    return kind.item is None or not holds_array(kind.item)


def plain_source(kind: Kind, value: str, depth: int) -> str:
    """Expression that turns a value of this kind into a value for `pack`; arrays are appended to the list `arrays`."""
    if not holds_array(kind):
        return value
    if kind.form == "array":
        source = f"(arrays.append({value}) or len(arrays) - 1)"
    elif kind.message is not None:
        written = [f"{name!r}: {plain_source(one, f'{value}.{name}', 0)}" for name, one in kind.message.kinds.items()]
        source = f"{{{', '.join(written)}}}"
    else:
        assert kind.item is not None
        item = f"item{depth}"
        source = f"[{plain_source(kind.item, item, depth + 1)} for {item} in {value}]"
    return f"(None if {value} is None else {source})" if kind.optional else source
