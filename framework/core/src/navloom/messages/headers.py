"""Reads long headers only as far as their class declares: unknown fields are skipped without being built."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import msgpack

from navloom.messages.bounds import LATER_FIELDS
from navloom.messages.kinds import MAX_ARRAYS, Kind, Message, MessageError

__all__ = ["read_header"]

_MAPS, _LISTS, _NIL = frozenset([*range(0x80, 0x90), 0xDE, 0xDF]), frozenset([*range(0x90, 0xA0), 0xDC, 0xDD]), 0xC0
"""First bytes of a map, a list and None in MessagePack."""
_ENVELOPE, _DIMENSIONS = 16, 8
"""Most items of an envelope, and most dimensions of an array."""

Read = Callable[[], Any]


def read_header(packed: bytes | memoryview, cls: type[Message] | None) -> Any:
    """The declared part of a header; only its envelope if `cls` is None.

    Maps and lists may be no longer, and values nested no deeper, than their declaration allows. Skipped values may be
    nested up to msgpack's limit of 1024 levels.

    Raises:
        MessageError: The header is malformed; ValueError: it is no MessagePack.
    """
    header = _Header(packed)
    parts: dict[str, Read] = {"envelope": lambda: header.items("envelope", _ENVELOPE, header.scalar)}
    if cls is not None:
        parts["fields"] = lambda: header.message(cls.kinds)
        parts["arrays"] = lambda: header.items("arrays", MAX_ARRAYS, header.array)
    found = header.fields("the header", parts)
    header.finish()
    return found


class _Header:
    """A cursor in a header."""

    def __init__(self, packed: bytes | memoryview) -> None:
        self._packed = packed
        self._unpacker = msgpack.Unpacker(max_buffer_size=len(packed))
        self._unpacker.feed(packed)

    def fields(self, where: str, known: Mapping[str, Read]) -> Any:
        """A map with these names; any other value is returned as it is, for a later check to refuse."""
        # The first byte is looked at before anything is built.
        if self._next() not in _MAPS:
            return self.scalar()
        count = self._unpacker.read_map_header()
        if count > len(known) + LATER_FIELDS:
            raise MessageError(f"{where} holds {count} entries, expected at most {len(known) + LATER_FIELDS}")
        found = {}
        for _ in range(count):
            name = self.scalar()
            if name in known:
                found[name] = known[name]()
            else:
                self._unpacker.skip()
        return found

    def message(self, kinds: Mapping[str, Kind]) -> Any:
        """The map of a message's fields."""
        return self.fields("a map of fields", {name: self._reader(name, kind) for name, kind in kinds.items()})

    def items(self, where: str, most: int, read: Read) -> Any:
        """A list; any other value is returned as it is."""
        if self._next() not in _LISTS:
            return self.scalar()
        count = self._unpacker.read_array_header()
        if count > most:
            raise MessageError(f"{where}: got {count} items, expected at most {most}")
        return [read() for _ in range(count)]

    def array(self) -> Any:
        """An entry of the table of arrays: element type, shape, offset."""
        return self.items("arrays", 3, lambda: self.items("arrays", _DIMENSIONS, self.scalar))

    def scalar(self) -> Any:
        """A number, a text, None, True or False."""
        begin = self._next()
        if begin in _MAPS or begin in _LISTS:
            raise MessageError(f"got a {'map' if begin in _MAPS else 'list'}, expected a single value")
        return self._unpacker.unpack()

    def finish(self) -> None:
        """Refuse bytes after the end."""
        left = len(self._packed) - self._unpacker.tell()
        if left:
            raise MessageError(f"the header has {left} bytes after its end")

    def _reader(self, name: str, kind: Kind) -> Read:
        if kind.message is not None:
            inner = kind.message.kinds
            return lambda: self.message(inner)
        if kind.item is not None:
            read = self._reader(name, kind.item)
            return lambda: self.items(name, kind.most, read)
        return self.scalar

    def _next(self) -> int:
        place = self._unpacker.tell()
        if place >= len(self._packed):
            raise MessageError(f"the header ends after {place} bytes, within a map or list")
        return int(self._packed[place])
