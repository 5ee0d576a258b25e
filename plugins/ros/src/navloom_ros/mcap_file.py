"""Writes MCAP files in the format of rosbag2, which Foxglove also opens: `cdr` channels with `ros2msg` schemas."""

from __future__ import annotations

import os
from pathlib import Path
from types import TracebackType
from typing import Any

from mcap.writer import Writer

from navloom_ros.errors import RosError
from navloom_ros.message_types import Types

__all__ = ["McapFile"]


class McapFile:
    """Writes one file, which gets its name only when it is complete. Use it in a `with` statement.

    Args:
        path: File to write; an existing one is refused.
        types: Types of the messages.

    Raises:
        RosError: The file exists, or cannot be created.

    Attributes:
        messages: Number of messages written, by topic.
    """

    def __init__(self, path: Path, types: Types) -> None:
        self.path, self.messages = path, dict[str, int]()
        self._types = types
        # In the same folder, since os.replace() is atomic only within a file system.
        self._part = path.with_name(f".{path.name}.{os.getpid()}.part")
        if path.exists():
            raise RosError(f"{path}: there is such a file already; name another, or remove it")
        try:
            # x refuses a file that is there already.
            self._file = self._part.open("xb")
        except OSError as error:
            raise RosError(f"{path}: cannot be written: {error.strerror}") from None
        self._writer: Any = Writer(self._file)
        self._writer.start(profile="ros2", library="navloom-ros")
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def __enter__(self) -> McapFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            try:
                self._writer.finish()
                self._file.close()
                os.replace(self._part, self.path)
                return
            except OSError as failed:
                self._part.unlink(missing_ok=True)
                raise RosError(f"{self.path}: cannot be written: {failed.strerror}; nothing was kept") from None
        self._file.close()
        self._part.unlink(missing_ok=True)

    def add(self, topic: str, message: Any, stamp_ns: int) -> None:
        """Write a message.

        Args:
            topic: Full name, as `/scan`.
            message: Of a type in `types`.
            stamp_ns: Time of recording and of publication, ns.

        Raises:
            UnfitMessage: It does not fit its type.
            RosError: The file cannot be written, as when the disk is full.
        """
        name = message.__msgtype__
        data = self._types.encode(message)
        count = self.messages.get(topic, 0)
        try:
            if topic not in self._channels:
                self._channels[topic] = self._declare(topic, name)
            # The format has 32 bits for the sequence number.
            self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns, count & 0xFFFFFFFF)
        except OSError as error:
            raise RosError(f"{self.path}: {error.strerror}; nothing was kept") from None
        self.messages[topic] = count + 1

    def _declare(self, topic: str, name: str) -> int:
        if name not in self._schemas:
            text = self._types.schema_of(name)
            self._schemas[name] = self._writer.register_schema(name, "ros2msg", text.encode())
        # The quality of service is left out: its format differs between versions of rosbag2.
        return int(self._writer.register_channel(topic, "cdr", self._schemas[name]))
