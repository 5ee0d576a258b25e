"""Reads ROS bags with `rosbags`, for `bag_import`.

A bag may be hostile, and `rosbags` has no limits. So this module limits its memory and the size of what it unpacks, and
refuses databases that compute their rows.
"""

from __future__ import annotations

import json
import resource
import sqlite3
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path, PurePath
from typing import Any

from navloom.inputs import BAG_MB, YAML_MB, bytes_of, open_file, read_file, too_large
from navloom_maps import yaml_of
from navloom_recording import RecordingError

__all__ = ["check_definitions", "deserialized", "messages", "opened"]

STANDARD = "ros2_humble"
"""ROS release whose message types apply to a bag without definitions. Later releases write them into each bag."""
INFORMATION = "rosbag2_bagfile_information"
"""Top-level key of a ROS 2 bag's metadata.yaml."""
PIECE = 1 << 20
"""Bytes to unpack at once."""


@contextmanager
def opened(bag: Path) -> Iterator[Any]:
    """Open a bag as a `rosbags` reader. Within the context the process may allocate only up to the limit.

    Args:
        bag: A `.bag` file, the folder of a ROS 2 bag, or the data file in it.

    Raises:
        RecordingError: Not a readable bag, or one that exceeds the limit on memory or on unpacked files.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    if not bag.exists():
        raise RecordingError(f"{bag}: no such bag")
    path = bag.parent if bag.suffix in (".db3", ".mcap") and (bag.parent / "metadata.yaml").exists() else bag
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="navloom-bag-")))
        path = _checked(path, folder)
        # After unpacking, whose size is bounded by itself.
        stack.enter_context(_bounded_memory(bag))
        try:
            reader = AnyReader([path], default_typestore=get_typestore(Stores(STANDARD)))
            stack.enter_context(reader)
            if not all(
                isinstance(text, str)
                for connection in reader.connections
                for text in (connection.topic, connection.msgtype)
            ):
                raise ValueError("the name or type of a topic is not text")
        except MemoryError:
            raise
        except Exception as error:  # rosbags raises its own, those of its parsers, and assertions
            raise RecordingError(
                f"{bag}: not a bag that can be read ({_words(error)}); expected F.bag or a ROS 2 bag's folder"
            ) from None
        yield reader


def check_definitions(reader: Any, types: Iterable[str]) -> None:
    """Check that the bag defines message types with ROS's own fields, or more.

    Raises:
        RecordingError: A type, or one that it contains, is not defined, lacks a field, or has one of another type.
    """
    from rosbags.interfaces import Nodetype
    from rosbags.typesys import Stores, get_typestore

    standard, defined = get_typestore(Stores(STANDARD)).fielddefs, reader.typestore.fielddefs
    left = sorted(types)
    checked: set[str] = set()
    while left:
        name = left.pop()
        checked.add(name)
        _, given = defined.get(name, ((), ()))
        _, expected = standard["tf2_msgs/msg/TFMessage" if name == "tf/msg/tfMessage" else name]
        for field, kind in expected:
            if dict(given).get(field) != kind:
                raise RecordingError(
                    f"{reader.paths[0]}: defines {name} without ROS's field {field!r}, or with another type of it; "
                    "copy the bag again"
                )
            element: Any = kind if kind[0] in (Nodetype.BASE, Nodetype.NAME) else kind[1][0]  # of an array, its items'
            if element[0] == Nodetype.NAME and element[1] not in checked:
                left.append(element[1])


def messages(reader: Any, connections: Sequence[Any]) -> Iterator[tuple[Any, int, bytes]]:
    """Connection, time of receipt, ns, and bytes of each message. Raises RecordingError if the bag is damaged."""
    if not connections:  # the reader would read all of them
        return
    types = {connection.msgtype for connection in connections}
    try:
        for connection, stamp_ns, raw in reader.messages(connections=connections):
            if connection.msgtype not in types:  # two connections of the bag have one number
                raise ValueError(f"a message of {connection.topic} is of {connection.msgtype}")
            if not isinstance(stamp_ns, int) or not 0 <= stamp_ns < 2**63:
                raise ValueError(f"a message of {connection.topic} has the time {str(stamp_ns)[:40]}")
            yield connection, stamp_ns, raw
    except (MemoryError, RecordingError):
        raise
    except Exception as error:
        raise RecordingError(f"{reader.paths[0]}: damaged: {_words(error)}; copy the bag again") from None


def deserialized(reader: Any, raw: bytes, connection: Any) -> Any:
    """A message from its bytes. Raises RecordingError if they are not a message of its type."""
    try:
        return reader.deserialize(raw, connection.msgtype)
    except MemoryError:
        raise
    except Exception as error:
        raise RecordingError(
            f"{reader.paths[0]}: {connection.topic}: not a message of {connection.msgtype}: {_words(error)}; "
            "copy the bag again"
        ) from None


@contextmanager
def _bounded_memory(bag: Path) -> Iterator[None]:
    """Let the system refuse memory beyond the limit, as third-party code allocates what a bag claims to contain."""
    limit = bytes_of(BAG_MB, RecordingError)
    before = resource.getrlimit(resource.RLIMIT_AS)
    with suppress(OSError):  # /proc exists only on Linux; elsewhere there is no limit
        used = int(Path("/proc/self/statm").read_text("ascii").split()[0]) * resource.getpagesize()
        least = min((one for one in before if one != resource.RLIM_INFINITY), default=used + limit)
        # On top of what is used now: address space cannot be given back below that.
        resource.setrlimit(resource.RLIMIT_AS, (min(used + limit, least), before[1]))
    try:
        yield
    except MemoryError:
        raise RecordingError(
            too_large(f"{bag}: not a bag that can be read, or a large one: it takes more memory", limit)
        ) from None
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def _checked(path: Path, folder: Path) -> Path:
    """Check the files of a bag. Returns the bag, or a copy in `folder` with unpacked files if they are compressed."""
    if not path.is_dir():
        with _readable(path), open_file(path, RecordingError):
            pass
        if path.suffix == ".db3":
            _refuse_queries(path)
        return path
    described = path / "metadata.yaml"
    with _readable(described):
        tree = yaml_of(read_file(described, YAML_MB, RecordingError), str(described), RecordingError)
    try:
        about = tree[INFORMATION]
        # Only names: a hostile description must not lead to files elsewhere.
        files = [path / PurePath(name).name for name in about["relative_file_paths"]]
        is_packed = str(about.get("compression_mode", "")).lower() == "file"
        is_sqlite = about["storage_identifier"] == "sqlite3"
    except (KeyError, TypeError, AttributeError):
        raise RecordingError(f"{described}: not the description of a ROS 2 bag; copy the bag again") from None
    if is_packed:
        files = _unpacked(files, folder)
        about = {**about, "compression_mode": "", "compression_format": "",
                 "relative_file_paths": [one.name for one in files]}  # fmt: skip
        (folder / "metadata.yaml").write_text(json.dumps({INFORMATION: about}, default=str), "utf-8")
        path = folder
    for file in files:
        with _readable(file), open_file(file, RecordingError):
            pass
        if is_sqlite:
            _refuse_queries(file)
    return path


def _unpacked(files: Sequence[Path], folder: Path) -> list[Path]:
    """Unpack the files of a bag that are compressed as a whole; together they must not exceed the limit."""
    import zstandard

    left = limit = bytes_of(BAG_MB, RecordingError)
    out = []
    for path in files:
        target = folder / path.stem
        with _readable(path), open_file(path, RecordingError) as packed, target.open("wb") as file:
            source = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
            try:
                # In pieces, so that a bomb is noticed before it fills memory or disk.
                while piece := source.read(PIECE):
                    left -= len(piece)
                    if left < 0:
                        raise RecordingError(too_large(f"{path}: unpacks to more than {limit / 1e6:g} MB", limit))
                    file.write(piece)
            except zstandard.ZstdError as error:
                raise RecordingError(f"{path}: damaged: {error}; copy the bag again") from None
        out.append(target)
    return out


def _refuse_queries(path: Path) -> None:
    """Refuse a database with views or computed columns: reading one row of them may never end."""
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
            # Expressions of the schema may call functions of SQLite.
            database.execute("PRAGMA trusted_schema = OFF")
            for kind, name, text in database.execute("SELECT type, name, sql FROM sqlite_master LIMIT 1000"):
                is_plain = kind == "index" or (kind == "table" and str(text).upper().startswith("CREATE TABLE"))
                columns = database.execute("SELECT hidden FROM pragma_table_xinfo(?)", (name,)) if is_plain else ()
                if not is_plain or any(hidden for (hidden,) in columns):
                    raise RecordingError(f"{path}: {kind} {str(name)[:40]!r} is computed, expected plain tables")
    except (sqlite3.Error, UnicodeError) as error:
        raise RecordingError(f"{path}: not the database of a bag: {error}; copy the bag again") from None


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None


def _words(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 200 else f"{text[:197]}..."
