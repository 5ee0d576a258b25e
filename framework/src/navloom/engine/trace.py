"""The trace of a run: what every active node said, tick by tick, as bytes that two runs can be compared by."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
from typing import IO, Any, NamedTuple

from navloom.messages import Envelope, Message
from navloom.messages.codec import add_blocks, decode, lead_of, pack_length, pack_time
from navloom.messages.packing import Write, writer_of

__all__ = ["TraceEntry", "TraceError", "TraceWriter", "read_trace"]

_label = itemgetter(0)
_ENTRY = struct.Struct("<IHI")
MAGIC = b"navloom trace 1\n"
BATCH = 64
"""Ticks that are encoded at once."""


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
    `role instance port schema/version`, the bytes are the codec's with sequence 0. Messages are encoded in batches of
    ticks: they cannot change, so that their bytes are the same later. What is cut short loses the last batch at most.

    Attributes:
        entries: Label, message and envelope of what was said in the tick under way.
    """

    def __init__(self, file: IO[bytes] | None = None) -> None:
        self._file = file
        self._hash = hashlib.sha256(MAGIC)
        self._leads: dict[bytes, tuple[Write, bytes]] = {}
        self.entries: list[tuple[bytes, Message, Envelope]] = []
        self._ticks: list[tuple[int, list[tuple[bytes, Message, Envelope]]]] = []
        if file is not None:
            file.write(MAGIC)

    def end_tick(self, tick: int) -> None:
        """The tick under way is complete."""
        if not self.entries:
            return
        self._ticks.append((tick, self.entries))
        self.entries = []
        if len(self._ticks) >= BATCH:
            self.flush()

    def flush(self) -> None:
        """Write the ticks that are complete; in each the entries by label, several of one in the order they came."""
        parts: list[Any] = []
        when: tuple[int, ...] = ()
        time = b""
        pack_entry, leads = _ENTRY.pack, self._leads
        for tick, entries in self._ticks:
            entries.sort(key=_label)
            for label, message, at in entries:
                if at[2:] != when:
                    when = at[2:]
                    time = pack_time(when)
                write, lead = leads.get(label) or self._begin(label, message, at.key)
                rest, arrays, pads, size = write(message)
                header = len(lead) + len(time) + len(rest)
                place = len(parts)
                parts += (b"", label, pack_length(header), lead, time, rest)
                length = 4 + header
                if size:
                    length += add_blocks(parts, length, arrays, pads, size)
                parts[place] = pack_entry(tick, len(label), length)
        self._ticks.clear()
        block = b"".join(parts)
        self._hash.update(block)
        if self._file is not None:
            self._file.write(block)
            self._file.flush()

    def _begin(self, label: bytes, message: Message, key: str) -> tuple[Write, bytes]:
        """What writes the messages of a label, and what their headers begin with."""
        made = self._leads[label] = writer_of(type(message)), lead_of(key)
        return made

    def sha256(self) -> str:
        """Hash of all that was said so far: that of the file."""
        self.flush()
        return self._hash.hexdigest()


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
