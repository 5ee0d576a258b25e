"""Reads recordings, also if the recorder was killed: a torn end is skipped and reported."""

from __future__ import annotations

import io
import mmap
import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

from navloom.inputs.bounds import CHUNK_MB, TEXT_MB, bytes_of, open_file, too_large
from navloom.inputs.texts import json_of, shortened
from navloom.messages import Envelope, Message
from navloom.messages.codec import CodecError
from navloom.plugins.message_opening import OPENER

from navloom_recording.json_schemas import ENCODING
from navloom_recording.recording_header import HEADER, RecordingError, RecordingHeader

__all__ = ["COUNTS", "RawRecorded", "Recorded", "Recording"]

MAGIC = b"\x89MCAP0\r\n"
COUNTS = "recorder/main/counts"
"""Key of the recorder's counters below REALM/ROBOT: JSON, once a second and at the end."""

_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_SCHEMA, _CHANNEL, _MESSAGES, _CHUNK, _ATTACHMENT, _METADATA, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x09, 0x0C, 0x0F
_TIMES = struct.Struct("<QQQI")


class Recorded(NamedTuple):
    """One recorded message.

    Attributes:
        key: REALM/ROBOT/role/instance/port.
        envelope, message: The envelope and message that were sent.
        received_ns: Receive time, ns; see `RecordingHeader.clock`.
    """

    key: str
    envelope: Envelope
    message: Message
    received_ns: int


class RawRecorded(NamedTuple):
    """An undecoded message: the codec's bytes, their schema label, and the low 32 bits of the envelope's sequence."""

    key: str
    label: str
    data: memoryview
    received_ns: int
    sequence: int

    def open(self) -> Recorded:
        """Decode it. Raises CodecError."""
        message, envelope = OPENER.decode(self.data, self.label)
        return Recorded(self.key, envelope, message, self.received_ns)


class _Channel(NamedTuple):
    key: str
    encoding: str
    label: str


@dataclass(frozen=True)
class _Block:
    """A chunk in the file: offset and length of its content, bytes, and receive times of its messages, ns."""

    start: int
    length: int
    first_ns: int
    last_ns: int


class Recording:
    """An open recording. Use it in a `with` statement, or let it close at the end of the process.

    Args:
        path: An MCAP file written by navloom.

    Raises:
        RecordingError: It is not a recording, or cannot be read.

    Attributes:
        header: Its header.
        is_complete: Whether it was closed properly.
        malformed, complaint: Number of messages skipped so far as undecodable, and the first reason.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.malformed, self.complaint = 0, ""
        self.is_complete = False
        self._torn = 0
        self._channels: dict[int, _Channel] = {}
        self._schemas: dict[int, str] = {}
        self._texts: dict[str, str] = {}
        self._blocks: list[_Block] = []
        self._metadata: list[tuple[str, dict[str, str]]] = []
        self._attachments: dict[str, tuple[int, int]] = {}
        self._texts_size = 0
        self._view = _mapped(self.path)
        if bytes(self._view[: len(MAGIC)]) != MAGIC:
            raise RecordingError(f"{self.path}: not a recording (it does not begin as an MCAP file does)")
        with self._damage("its records"):
            self._scan()
        self.header = self._head()

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *exception: object) -> None:
        """Do nothing: only a view of the file is open, and it ends with the last array that refers to it."""

    @property
    def note(self) -> str:
        """What a user should know about the file's end; empty if it was closed properly."""
        if self.is_complete:
            return ""
        torn = f"; its last {self._torn} bytes are torn and were passed over" if self._torn else ""
        return f"{self.path}: the recorder did not close it{torn}"

    def messages(
        self, keys: Iterable[str] | None = None, since_ns: int | None = None, until_ns: int | None = None
    ) -> Iterator[Recorded]:
        """Messages in the order of receipt; undecodable ones are counted and skipped.

        Args:
            keys: Patterns with `*`, of the whole key or the part below REALM/ROBOT/; None for all.
            since_ns, until_ns: Receive times, first and one past the last, ns; None for no bound.
        """
        for raw in self.raw(keys, since_ns, until_ns):
            try:
                yield raw.open()
            except CodecError as error:
                self.malformed += 1
                self.complaint = self.complaint or f"{raw.key}: {error}"

    def raw(
        self, keys: Iterable[str] | None = None, since_ns: int | None = None, until_ns: int | None = None
    ) -> Iterator[RawRecorded]:
        """Messages like `messages`, but not decoded."""
        patterns = None if keys is None else list(keys)
        chosen: dict[int, _Channel | None] = {}
        for block in self._blocks:
            # An unfinished file declares channels only in the chunks before: none may be skipped.
            if self.is_complete and (
                (since_ns is not None and block.last_ns < since_ns)
                or (until_ns is not None and block.first_ns >= until_ns)
            ):
                continue
            for opcode, content in self._records(block):
                if opcode != _MESSAGES:
                    continue
                number, sequence, received_ns, _ = _MESSAGE.unpack_from(content)
                if (since_ns is not None and received_ns < since_ns) or (
                    until_ns is not None and received_ns >= until_ns
                ):
                    continue
                if number not in chosen:
                    chosen[number] = self._choose(number, patterns)
                channel = chosen[number]
                if channel is not None:
                    yield RawRecorded(channel.key, channel.label, content[_MESSAGE.size :], received_ns, sequence)

    def keys(self) -> list[str]:
        """Every key, in alphabetical order. Reads the whole file if it was not closed properly."""
        if not self.is_complete:
            for block in self._blocks:
                for _ in self._records(block):
                    pass
        return sorted({channel.key for channel in self._channels.values() if channel.encoding == ENCODING})

    def unknown(self) -> list[str]:
        """Why messages in it have no class here, one text for each cause; such messages are skipped."""
        self.keys()
        return OPENER.reasons(self._schemas.values())

    def span_ns(self) -> tuple[int, int]:
        """Receive times of the first and the last message, ns; (0, 0) if there is none."""
        blocks = self._blocks
        return (min(b.first_ns for b in blocks), max(b.last_ns for b in blocks)) if blocks else (0, 0)

    def counts(self) -> dict[str, Any]:
        """The recorder's last counters: `messages`, and by key `dropped`, `lost`, `malformed`."""
        for name, values in reversed(self._metadata):
            if name == COUNTS:
                return self._counts(values.get("counts", ""))
        last: dict[str, Any] = {}
        for block in reversed(self._blocks):
            for opcode, content in self._records(block):
                if opcode == _MESSAGES:
                    channel = self._channels.get(_MESSAGE.unpack_from(content)[0])
                    if channel is not None and channel.key.endswith(COUNTS):
                        last = self._counts(bytes(content[_MESSAGE.size :]))
            if last:
                return last
        return {}

    def _counts(self, text: str | bytes) -> dict[str, Any]:
        found = json_of(text, f"{self.path}: the recorder's counters", RecordingError)
        if not isinstance(found, dict):
            raise RecordingError(f"{self.path}: the recorder's counters are {shortened(found)}, expected a table")
        return found

    def attachment(self, name: str) -> bytes | None:
        """Content of an attachment; None if there is none of that name."""
        place = self._attachments.get(name)
        return None if place is None else bytes(self._view[place[0] : place[0] + place[1]])

    def attachments(self) -> list[str]:
        """Names of the attachments."""
        return sorted(self._attachments)

    def schema_text(self, label: str) -> str:
        """The file's own text of a schema; empty if it has none of that label."""
        return self._texts.get(label, "")

    def _choose(self, number: int, patterns: list[str] | None) -> _Channel | None:
        channel = self._channels.get(number)
        if channel is None or channel.encoding != ENCODING:
            return None
        below = channel.key.split("/", 2)[-1]
        fits = patterns is None or any(fnmatchcase(channel.key, p) or fnmatchcase(below, p) for p in patterns)
        return channel if fits else None

    def _head(self) -> RecordingHeader:
        for name, values in reversed(self._metadata):  # the last header has every instance that the robot has gained
            if name == HEADER and "header" in values:
                return RecordingHeader.from_text(values["header"])
        raise RecordingError(
            f"{self.path}: an MCAP file without navloom's head: `navloom record`, `run --record` and `import` write it"
        )

    def _scan(self) -> None:
        """Find every chunk, metadata record and attachment, skipping their contents; stop at a torn record."""
        view, at, good = self._view, len(MAGIC), len(MAGIC)
        while at + _HEAD.size <= len(view):
            opcode, length = _HEAD.unpack_from(view, at)
            start = at + _HEAD.size
            # A recorder that was killed leaves half a record, or zeros, at the end.
            if not 1 <= opcode <= _DATA_END or length > len(view) - start:
                break
            self._note(opcode, start, length)
            at = good = start + length
        self.is_complete = bytes(view[good:]) == MAGIC and len(view) > len(MAGIC)
        self._torn = 0 if self.is_complete else len(view) - good

    def _note(self, opcode: int, start: int, length: int) -> None:
        content = self._view[start : start + length]
        if opcode == _CHUNK:
            first_ns, last_ns, _, _ = _TIMES.unpack_from(content)
            self._blocks.append(_Block(start, length, first_ns, last_ns))
        elif opcode == _METADATA:
            from mcap.data_stream import ReadDataStream
            from mcap.records import Metadata

            # Before it is read: a damaged or hostile file claims any size.
            self._count_text(length)
            found = Metadata.read(ReadDataStream(io.BytesIO(content)))
            self._metadata.append((found.name, found.metadata))
        elif opcode == _ATTACHMENT:
            (size,) = struct.unpack_from("<I", content, 16)
            self._count_text(size)
            name = bytes(content[20 : 20 + size]).decode()
            (media,) = struct.unpack_from("<I", content, 20 + size)
            (data,) = struct.unpack_from("<Q", content, 24 + size + media)
            self._attachments[name] = (start + 32 + size + media, data)
        else:
            self._learn(opcode, content)

    def _learn(self, opcode: int, content: memoryview) -> None:
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel, Schema

        if opcode == _SCHEMA:
            # Every chunk repeats them.
            if struct.unpack_from("<H", content)[0] in self._schemas:
                return
            self._count_text(len(content))
            schema = Schema.read(ReadDataStream(io.BytesIO(content)))
            self._schemas[schema.id] = schema.name
            self._texts[schema.name] = schema.data.decode()
        elif opcode == _CHANNEL:
            number = struct.unpack_from("<H", content)[0]
            if number not in self._channels:
                self._count_text(len(content))
                channel = Channel.read(ReadDataStream(io.BytesIO(content)))
                label = self._schemas.get(channel.schema_id, "")
                self._channels[number] = _Channel(channel.topic, channel.message_encoding, label)

    def _count_text(self, size: int) -> None:
        """Bound the total size of records that stay in memory; called before one is kept. Raises RecordingError."""
        self._texts_size += size + _HEAD.size
        limit = bytes_of(TEXT_MB, RecordingError)
        if self._texts_size > limit:
            what = f"{self.path}: metadata, schemas and channels of {self._texts_size / 1e6:.6g} MB"
            raise RecordingError(too_large(what, limit))

    def _unpacked(self, block: _Block) -> memoryview:
        """Content of a chunk. Raises RecordingError if it is damaged."""
        content = self._view[block.start : block.start + block.length]
        _, _, size, crc = _TIMES.unpack_from(content)
        at = _TIMES.size
        (length,) = struct.unpack_from("<I", content, at)
        how = bytes(content[at + 4 : at + 4 + min(length, 20)]).decode()
        packed = content[at + 4 + length + 8 :]
        if how not in ("", "zstd"):
            raise RecordingError(f"{self.path}: the chunk at byte {block.start} is packed as {how!r}; expected zstd")
        limit = bytes_of(CHUNK_MB, RecordingError)
        if size > limit:
            what = f"{self.path}: the chunk at byte {block.start} unpacks to {size / 1e6:.6g} MB"
            raise RecordingError(too_large(what, limit))
        data: Any = _unzstd(packed, size) if how == "zstd" else packed
        if data is None or len(data) != size:
            raise RecordingError(
                f"{self.path}: the chunk at byte {block.start} is damaged: expected {size} bytes in it"
            )
        # 0 means that the writer made none.
        if crc and zlib.crc32(data) != crc:
            raise RecordingError(f"{self.path}: the chunk at byte {block.start} is damaged: its checksum does not fit")
        return memoryview(data)

    def _records(self, block: _Block) -> Iterator[tuple[int, memoryview]]:
        """Records of a chunk; its schemas and channels are registered. Raises RecordingError if it is damaged."""
        with self._damage(f"the chunk at byte {block.start}"):
            data, at = self._unpacked(block), 0
            while at + _HEAD.size <= len(data):
                opcode, length = _HEAD.unpack_from(data, at)
                at += _HEAD.size
                content = data[at : at + length]
                if len(content) != length or (opcode == _MESSAGES and length < _MESSAGE.size):
                    raise RecordingError(f"{self.path}: the chunk at byte {block.start} is damaged: a record is torn")
                if opcode != _MESSAGES:
                    self._learn(opcode, content)
                yield opcode, content
                at += length

    @contextmanager
    def _damage(self, what: str) -> Iterator[None]:
        """Convert exceptions of the record parsers on damaged records to a RecordingError."""
        from mcap.exceptions import McapError

        try:
            yield
        except (struct.error, UnicodeDecodeError, McapError) as error:
            text = str(error) or type(error).__name__
            raise RecordingError(f"{self.path}: {what}: damaged: {text[:100]}") from None


def _unzstd(packed: memoryview, size: int) -> bytes | None:
    """The one frame of a chunk; None if it is damaged or claims another size, which would be allocated."""
    import zstandard

    try:
        claimed = zstandard.get_frame_parameters(packed).content_size
        if claimed not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            return None
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size) if size else b""
    except zstandard.ZstdError:
        return None


def _mapped(path: Path) -> memoryview:
    """A file's content as a memory map."""
    try:
        with open_file(path, RecordingError) as file:
            # An empty file cannot be mapped.
            if file.seek(0, io.SEEK_END) == 0:
                return memoryview(b"")
            # Arrays of messages refer to the map, so that nothing is copied.
            return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None
