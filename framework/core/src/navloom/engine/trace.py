"""The trace of a run: what every active node published, tick by tick, as bytes, so that two runs can be compared."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
from typing import IO, Any, NamedTuple

from navloom.errors import NavloomError
from navloom.messages import Envelope, Message
from navloom.messages.bounds import ALIGNMENT
from navloom.messages.codec import add_blocks, decode, lead_of, pack_time
from navloom.messages.packing import writer_of

__all__ = ["TraceEntry", "TraceError", "TraceWriter", "read_trace"]

_label = itemgetter(0)
_ENTRY = struct.Struct("<IHI")
Entry = tuple[bytes, Message, tuple[int, ...], str]
MAGIC = b"navloom trace 1\n"
BATCH = 16
"""Number of ticks that are encoded together."""


class TraceError(NavloomError, ValueError):
    """A file that is not a trace, or one that is cut short."""


class TraceEntry(NamedTuple):
    """One message of a trace, with its source."""

    tick: int
    role: str
    instance: str
    port: str
    message: Message
    envelope: Envelope


class _Line:
    """Writes the entries of one label.

    Attributes:
        label, lead: Bytes common to all its entries: the label, and the beginning of the message's header.
        pack: Packs tick, length of the label, length of the bytes, label, length of the header, and lead.
        write: The writer of its messages.
        largest, total: Size of its largest message and of all messages, bytes.
    """

    __slots__ = ("label", "largest", "lead", "pack", "total", "write")

    def __init__(self, label: bytes, kind: type[Message], key: str) -> None:
        self.label, self.lead, self.write = label, lead_of(key), writer_of(kind)
        self.largest = self.total = 0
        self.pack = struct.Struct(f"{_ENTRY.format}{len(label)}sI{len(self.lead)}s").pack


class TraceWriter:
    """Hashes the entries of each tick in order of role, instance and port, and writes them to a file if one is given.

    Entry: `u32 tick | u16 length of the label | u32 length of the bytes | label | bytes`; the label is
    `role instance port schema/version`, the bytes are the codec's with sequence 0. Messages are encoded in batches of
    ticks: they are immutable, so the bytes do not depend on when. A run that is cut short loses at most the last batch.

    Attributes:
        entries: Entries of the current tick: label, message, (tick, run clock, cause, epoch) of its envelope, and key.
    """

    def __init__(self, file: IO[bytes] | None = None) -> None:
        self._file = file
        self._hash = hashlib.sha256(MAGIC)
        self._lines: dict[bytes, _Line] = {}
        self.entries: list[Entry] = []
        self._ticks: list[tuple[int, list[Entry]]] = []
        if file is not None:
            file.write(MAGIC)

    def end_tick(self, tick: int) -> None:
        """Complete the current tick."""
        if not self.entries:
            return
        self._ticks.append((tick, self.entries))
        self.entries = []
        # Larger batches fall out of the cache and keep the garbage collector busy.
        if len(self._ticks) >= BATCH:
            self.flush()

    def flush(self) -> None:
        """Write the complete ticks, each sorted by label; entries of one label stay in the order of publication."""
        parts: list[Any] = []
        last: tuple[int, ...] = ()
        time, lines = b"", self._lines
        for tick, entries in self._ticks:
            # Live, nodes publish in any order within a tick; sorted, a barrier run has the hash of lockstep.
            entries.sort(key=_label)
            for label, message, when, key in entries:
                # All messages of one step share these bytes.
                if when != last:
                    last, time = when, pack_time(when)
                line = lines.get(label)
                if line is None:
                    line = lines[label] = _Line(label, type(message), key)
                rest, arrays, pads, size = line.write(message)
                header = len(line.lead) + len(time) + len(rest)
                length = 4 + header + (-(4 + header) % ALIGNMENT + size if size else 0)
                line.total += length
                if length > line.largest:
                    line.largest = length
                parts += (line.pack(tick, len(label), length, label, header, line.lead), time, rest)
                if size:
                    add_blocks(parts, 4 + header, arrays, pads, size)
        self._ticks.clear()
        block = b"".join(parts)
        self._hash.update(block)
        if self._file is not None:
            self._file.write(block)
            # A run that is killed leaves all complete batches.
            self._file.flush()

    def volumes(self) -> Iterator[tuple[str, int, int]]:
        """Label, size of its largest message so far and of all its messages, bytes."""
        self.flush()
        for label, line in self._lines.items():
            yield label.decode(), line.largest, line.total

    def sha256(self) -> str:
        """Hash of all entries so far; equal to the hash of the file."""
        self.flush()
        return self._hash.hexdigest()


def read_trace(path: Path) -> Iterator[TraceEntry]:
    """Entries of a trace file, in order.

    Raises:
        TraceError: The file is not a trace, or is cut short.
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
