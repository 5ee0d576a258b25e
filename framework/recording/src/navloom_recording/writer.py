"""Writes recordings: MCAP in zstd chunks that are closed often, so that a killed recorder loses little."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from navloom.errors import NavloomError
from navloom.messages.codec import schema_label
from navloom.messages.schema import OLDER, SCHEMAS
from navloom.plugins.message_opening import OPENER

from navloom_recording.json_schemas import ENCODING, SCHEMA_ENCODING, schema_text
from navloom_recording.reader import COUNTS
from navloom_recording.recording_header import HEADER, RecordingError, RecordingHeader

__all__ = ["RecordingWriter", "WriteError"]

CHUNK = 1 << 20
"""Largest size of a chunk before it is closed, bytes."""


class WriteError(NavloomError, OSError):
    """Writing failed; the file is valid up to that point. The text says why, and how much there is.

    Attributes:
        why: The cause alone.
    """

    exit_code = 1

    def __init__(self, text: str, why: str = "") -> None:
        super().__init__(text)
        self.why = why


class RecordingWriter:
    """Writes one recording, in one thread. Use it in a `with` statement.

    Args:
        path: File to write; an existing one is refused.
        header: Header of the recording.
        attachments: Files to store in it, by name.

    Raises:
        RecordingError: The file exists, or cannot be created.
        WriteError: Writing fails, as on a full disk; any call may raise it. Nothing is written after that.

    Attributes:
        messages: Number of messages in it; after a failure, the number that can be read.
    """

    def __init__(self, path: Path, header: RecordingHeader, attachments: Mapping[str, bytes] | None = None) -> None:
        from mcap.writer import Writer

        self.path, self.header, self.messages = path, header, 0
        self._file = _Sound(path)
        self._writer: Any = Writer(self._file, chunk_size=CHUNK)  # type: ignore[arg-type]
        self._channels: dict[tuple[str, str], int] = {}
        self._schemas: dict[str, int] = {}
        self._is_open, self._whole = True, 0
        try:
            with self._sound():
                self._writer.start(profile="navloom", library=f"navloom {header.versions.get('navloom', '')}")
                self._writer.add_metadata(HEADER, {"header": header.to_text()})
                for name, data in sorted((attachments or {}).items()):
                    self._writer.add_attachment(0, 0, name, "application/octet-stream", data)
                self._file.mark()
        except WriteError as error:
            path.unlink(missing_ok=True)
            raise WriteError(f"{path}: {error.why}; nothing was recorded", error.why) from None

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._is_open:
            self.close({})

    def add(self, key: str, label: str, data: bytes, received_ns: int, stamp_ns: int, sequence: int) -> None:
        """Write a message: the codec's bytes with their schema label."""
        channel = self._channels.get((key, label)) or self._declare(key, label)
        with self._sound():
            self._writer.add_message(channel, received_ns, data, stamp_ns, sequence & 0xFFFFFFFF)
        self.messages += 1

    def add_counts(self, counts: Mapping[str, Any], received_ns: int) -> None:
        """Write the recorder's current counters."""
        key = f"{self.header.prefix}/{COUNTS}"
        channel = self._channels.get((key, "json"))
        with self._sound():
            if channel is None:
                channel = self._channels[key, "json"] = self._writer.register_channel(key, "json", 0)
            self._writer.add_message(channel, received_ns, json.dumps(counts).encode(), received_ns)

    def extend(self, header: RecordingHeader) -> None:
        """Write a further header, which replaces the first: the robot has gained an instance."""
        with self._sound():
            self._writer.flush()
            self._writer.add_metadata(HEADER, {"header": header.to_text()})
            self._file.mark()
        self.header, self._whole = header, self.messages

    def flush(self) -> None:
        """Close the current chunk and hand it to the operating system, so that a kill no longer loses it."""
        with self._sound():
            self._writer.flush()
            self._file.mark()
        self._whole = self.messages

    def close(self, counts: Mapping[str, Any]) -> None:
        """Finish the file with the last counters and an index."""
        with self._sound():
            if counts:
                self._writer.flush()
                self._writer.add_metadata(COUNTS, {"counts": json.dumps(counts)})
            self._writer.finish()
            self._file.mark()
        self._is_open = False
        self._file.close()

    def discard(self) -> None:
        """Remove the file, because the run did not take place or a partial file is of no use."""
        if self._is_open:
            self._is_open = False
            self._file.close()
        self.path.unlink(missing_ok=True)

    @property
    def size(self) -> int:
        """Size of the file, bytes."""
        return self._file.tell()

    def _declare(self, key: str, label: str) -> int:
        with self._sound():
            if label not in self._schemas:
                OPENER.why_unknown(label)  # load a distribution's class, so that the recording contains its schema
                cls = OLDER.get(label) or SCHEMAS.get(label.partition("/")[0])
                text = schema_text(cls) if cls is not None and schema_label(cls) == label else ""
                self._schemas[label] = self._writer.register_schema(label, SCHEMA_ENCODING, text.encode())
            number: int = self._writer.register_channel(key, ENCODING, self._schemas[label])
        self._channels[key, label] = number
        return number

    @contextlib.contextmanager
    def _sound(self) -> Any:
        """Cut the file back to its last valid state if writing fails. Raises WriteError."""
        if not self._is_open:
            raise WriteError(f"{self.path}: it was closed")
        try:
            yield
        except OSError as error:
            self._is_open, self.messages = False, self._whole
            self._file.cut()
            why = error.strerror or str(error)
            size = self._file.tell()
            raise WriteError(
                f"{self.path}: {why}; the recording ends here, with {size} bytes that can be read", why
            ) from None


class _Sound:
    """A file that is cut back to its last mark if writing fails: a full disk leaves no torn record."""

    def __init__(self, path: Path) -> None:
        try:
            # Never over an existing file: recordings cannot be repeated.
            self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        except FileExistsError:
            raise RecordingError(f"{path}: there is such a file already; name another, or remove it") from None
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written: {error.strerror}") from None
        self._at = self._good = 0

    def write(self, data: bytes) -> int:
        """Write all of the data, without a buffer."""
        view = memoryview(data)
        # `os.write` may write a part, as when the disk is almost full.
        while view:
            written = os.write(self._descriptor, view)
            self._at += written
            view = view[written:]
        return len(data)

    def tell(self) -> int:
        """Number of bytes written so far."""
        return self._at

    def flush(self) -> None:
        """Do nothing: there is no buffer."""

    def mark(self) -> None:
        """Declare everything written so far as valid."""
        self._good = self._at

    def cut(self) -> None:
        """Truncate to the last mark, and close."""
        with contextlib.suppress(OSError):
            os.ftruncate(self._descriptor, self._good)
        self._at = self._good
        self.close()

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)
