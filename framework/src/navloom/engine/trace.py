"""The trace of a run: what every active node said, tick by tick, as bytes that two runs can be compared by."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO, NamedTuple

from navloom.messages import Envelope, Message
from navloom.messages.codec import decode

__all__ = ["TraceEntry", "TraceError", "TraceWriter", "read_trace"]

_ENTRY = struct.Struct("<IHI")
MAGIC = b"navloom trace 1\n"


class TraceError(ValueError):
    """A file that is not a trace, or one that ends in the middle."""


class TraceEntry(NamedTuple):
    """One message of a trace, with the place it came from."""

    tick: int
    role: str
    instance: str
    port: str
    message: Message
    envelope: Envelope


class TraceWriter:
    """Hashes, and keeps where a file is given, the entries of each tick in order of role, instance and port.

    Entry: `u32 tick | u16 length of the label | u32 length of the bytes | label | bytes`; the label is
    `role instance port schema/version`, the bytes are the codec's with sequence 0.
    """

    def __init__(self, file: IO[bytes] | None = None) -> None:
        self._file = file
        self._hash = hashlib.sha256(MAGIC)
        self._entries: list[tuple[bytes, bytes]] = []
        if file is not None:
            file.write(MAGIC)

    def add(self, label: bytes, data: bytes) -> None:
        """Take one message of the tick under way."""
        self._entries.append((label, data))

    def end_tick(self, tick: int) -> None:
        """Write the tick's entries, sorted by label; several of one label stay in the order they came."""
        if not self._entries:
            return
        self._entries.sort(key=_label)
        parts: list[bytes] = []
        for label, data in self._entries:
            parts += (_ENTRY.pack(tick, len(label), len(data)), label, data)
        block = b"".join(parts)
        self._hash.update(block)
        if self._file is not None:
            self._file.write(block)
        self._entries.clear()

    def sha256(self) -> str:
        """Hash of all that was written so far: that of the file."""
        return self._hash.hexdigest()


def _label(entry: tuple[bytes, bytes]) -> bytes:
    return entry[0]


def read_trace(path: Path) -> Iterator[TraceEntry]:
    """Entries of a trace file in order.

    Raises:
        TraceError: Not a trace, or cut short.
    """
    data = memoryview(path.read_bytes())
    if bytes(data[: len(MAGIC)]) != MAGIC:
        raise TraceError(f"{path}: not a navloom trace (it does not begin with {MAGIC!r})")
    at = len(MAGIC)
    while at < len(data):
        if at + _ENTRY.size > len(data):
            raise TraceError(f"{path}: cut short at byte {at}")
        tick, label_length, length = _ENTRY.unpack_from(data, at)
        start = at + _ENTRY.size
        at = start + label_length + length
        if at > len(data):
            raise TraceError(f"{path}: cut short in tick {tick}")
        role, instance, port, schema = bytes(data[start : start + label_length]).decode().split(" ")
        message, envelope = decode(data[start + label_length : at], schema)
        yield TraceEntry(tick, role, instance, port, message, envelope)
