"""Rewrites damaged files of bags, for `bag_files`: without an index, truncated, or with schemas that cannot be read.

A rewritten file has only the topics of the given types. All damage ends it, so that it has what came before.
"""

from __future__ import annotations

import io
import shutil
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, BinaryIO

from navloom_recording import RecordingError

__all__ = ["LeftOut", "merged_database", "readable_database", "salvaged_bag", "salvaged_mcap", "unchanging"]

LeftOut = dict[str, tuple[str, int]]
"""Type and number of messages of each topic that was left out."""
READ = ("ros2msg", "ros2idl")
"""Encodings of definitions that can be read."""
CDR = "cdr"
CHUNK, CONNECTION, MESSAGE = 5, 7, 2
"""Record types of a ROS 1 bag."""
LARGEST = 1 << 30
"""Largest record, bytes; more is damage."""


def merged_database(path: Path, target: Path) -> Path:
    """The database of a bag; a copy with what is still in its write-ahead log or needs a rollback, if there is any."""
    beside = [path.with_name(path.name + end) for end in ("-wal", "-journal")]
    beside = [file for file in beside if file.exists() and file.stat().st_size]
    if not beside:
        return path
    for file in (path, *beside):
        shutil.copyfile(file, target.with_name(file.name.replace(path.name, target.name, 1)))
    with closing(sqlite3.connect(target)) as database:
        database.execute("PRAGMA trusted_schema = OFF")
        # Only with journal mode DELETE is all of it in the one file, which is read as one that cannot change.
        database.execute("PRAGMA journal_mode = DELETE")
    return target


def unchanging(path: Path) -> sqlite3.Connection:
    """A database opened for reading as a file that does not change."""
    database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
    # Expressions of the schema may call functions of SQLite.
    database.execute("PRAGMA trusted_schema = OFF")
    return database


def readable_database(path: Path, target: Path) -> Path:
    """The database of a bag, or a copy without definitions whose encoding `rosbags` cannot read."""
    unread = f"FROM message_definitions WHERE encoding NOT IN {READ}"
    with closing(unchanging(path)) as database:
        defines = "SELECT 1 FROM pragma_table_info('message_definitions') WHERE name = 'encoding'"
        if not database.execute(defines).fetchone() or not database.execute(f"SELECT 1 {unread}").fetchone():
            return path
    if path != target:
        shutil.copyfile(path, target)
    with closing(sqlite3.connect(target)) as database, database:
        database.execute("PRAGMA trusted_schema = OFF")
        database.execute(f"DELETE {unread}")
    return target


def salvaged_mcap(path: Path, target: Path, types: frozenset[str], most: int) -> LeftOut:
    """Rewrite an MCAP file record by record. Raises RecordingError beyond `most` bytes."""
    from mcap.exceptions import McapError
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import StreamReader
    from mcap.writer import Writer

    left_out: LeftOut = {}
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    ways: dict[int, int] = {}
    written = 0
    with path.open("rb") as source, target.open("wb") as file:
        out = Writer(file)
        out.start(profile="ros2", library="navloom")
        try:
            for record in StreamReader(source).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    schema = schemas.get(channel.schema_id)
                    name = schema.name if schema else ""
                    if (
                        schema is None
                        or name not in types
                        or schema.encoding not in READ
                        or channel.message_encoding != CDR
                    ):
                        left_out[channel.topic] = name, left_out.get(channel.topic, ("", 0))[1] + 1
                        continue
                    if channel.id not in ways:
                        known = out.register_schema(name, schema.encoding, schema.data)
                        ways[channel.id] = out.register_channel(
                            channel.topic, channel.message_encoding, known, channel.metadata
                        )
                    written += len(record.data)
                    _check_size(path, written, most)
                    out.add_message(
                        ways[channel.id], record.log_time, record.data, record.publish_time, record.sequence
                    )
        except (McapError, struct.error, ValueError, KeyError, EOFError, UnicodeError):
            pass
        out.finish()  # type: ignore[no-untyped-call]
    return left_out


def salvaged_bag(path: Path, target: Path, types: frozenset[str], most: int) -> LeftOut:
    """Rewrite a ROS 1 bag without its index. Raises RecordingError beyond `most` bytes."""
    from rosbags.rosbag1 import Writer

    left_out: LeftOut = {}
    names: dict[int, tuple[str, str]] = {}
    ways: dict[int, Any] = {}
    alike: dict[tuple[str, ...], Any] = {}
    written = 0
    with path.open("rb") as file, Writer(target) as out:
        file.readline()
        for fields, data in _records(file, path, most):
            number = int.from_bytes(fields.get(b"conn", b""), "little")
            if fields[b"op"][0] == CONNECTION and number not in names:
                about = {**fields, **_fields(data)}
                topic = fields[b"topic"].decode()
                name = "/msg/".join(about[b"type"].decode().split("/")).replace(
                    "roslib/msg/Header", "std_msgs/msg/Header"
                )
                names[number] = topic, name
                if name in types:
                    text = about[b"message_definition"].decode("utf-8", "replace")
                    told = topic, name, text, about[b"md5sum"].decode()
                    if told not in alike:  # several publishers of one topic
                        alike[told] = out.add_connection(topic, name, msgdef=text, md5sum=told[3])
                    ways[number] = alike[told]
            elif fields[b"op"][0] == MESSAGE and number in ways:
                sec, nanosec = struct.unpack("<II", fields[b"time"])
                written += len(data)
                _check_size(path, written, most)
                out.write(ways[number], sec * 10**9 + nanosec, data)
            elif fields[b"op"][0] == MESSAGE and number in names:
                topic, name = names[number]
                left_out[topic] = name, left_out.get(topic, ("", 0))[1] + 1
    return left_out


def _records(file: BinaryIO, path: Path, most: int) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
    """Header fields and data of each whole record, those in chunks included."""
    from rosbags.rosbag1.reader import decompressors

    try:
        while len(size := file.read(4)) == 4:
            fields = _fields(_exactly(file, int.from_bytes(size, "little")))
            data = _exactly(file, int.from_bytes(_exactly(file, 4), "little"))
            if fields[b"op"][0] == CHUNK:
                _check_size(path, int.from_bytes(fields[b"size"], "little"), most)
                yield from _records(io.BytesIO(decompressors[fields[b"compression"].decode()](data)), path, most)
            else:
                yield fields, data
    except RecordingError:
        raise
    except (EOFError, KeyError, IndexError, OSError, ValueError, RuntimeError):
        return


def _fields(header: bytes) -> dict[bytes, bytes]:
    found, at = {}, 0
    while at + 4 <= len(header):
        size = int.from_bytes(header[at : at + 4], "little")
        name, _, value = header[at + 4 : at + 4 + size].partition(b"=")
        found[name], at = value, at + 4 + size
    return found


def _exactly(file: BinaryIO, size: int) -> bytes:
    data = file.read(size) if size <= LARGEST else b""
    if len(data) != size:
        raise EOFError
    return data


def _check_size(path: Path, size: int, most: int) -> None:
    if size > most:
        raise RecordingError(f"{path}: unpacks to more than {most / 1e6:g} MB; set NAVLOOM_BAG_MB for more")
