"""Reads ROS bags with `rosbags`, for `bag_import`.

A bag may be hostile, and `rosbags` has no limits. So this module limits its memory. `bag_files` checks its files.
"""

from __future__ import annotations

import resource
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, cast

from navloom.inputs import BAG_MB, bytes_of, too_large
from navloom_recording import RecordingError

from navloom_ros.bag_files import BagFiles, bag_files

__all__ = ["check_definitions", "deserialized", "messages", "opened"]

ZSTD = b"\x28\xb5\x2f\xfd"
"""Start of a zstd frame."""
STANDARD = "ros2_humble"
"""ROS release whose message types apply to a bag without definitions. Later releases write them into each bag."""


@contextmanager
def opened(bag: Path, types: frozenset[str]) -> Iterator[tuple[Any, BagFiles]]:
    """Open a bag as a `rosbags` reader. Within the context the process may allocate only up to the limit.

    Args:
        bag: A `.bag` file, the folder of a ROS 2 bag, or the data file in it.
        types: Message types to read; the definitions of others are not parsed.

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
        stack.enter_context(_bounded_memory(bag))
        files = bag_files(path, folder, types)
        try:
            reader: Any = AnyReader(files.paths, default_typestore=get_typestore(Stores(STANDARD)))
            # For errors: its own paths may be those of copies.
            reader.bag = bag
            # One definition that cannot be parsed would refuse the whole bag.
            reader.readers = [cast("Any", _Defined(one, types)) for one in reader.readers]
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
        yield reader, files


class _Defined:
    """A reader of `rosbags` whose connections have definitions only of some types.

    Args:
        reader: The reader.
        types: Names of the types.
    """

    def __init__(self, reader: Any, types: frozenset[str]) -> None:
        self._reader, self._types = reader, types

    def __getattr__(self, name: str) -> Any:
        return getattr(self._reader, name)

    def __enter__(self) -> Any:
        self._reader.__enter__()
        return self

    def __exit__(self, *exception: Any) -> Any:
        return self._reader.__exit__(*exception)

    @property
    def connections(self) -> list[Any]:
        return [self._with_definition(connection) for connection in self._reader.connections]

    def _with_definition(self, connection: Any) -> Any:
        from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

        if connection.msgtype not in self._types:
            return connection._replace(msgdef=MessageDefinition(MessageDefinitionFormat.NONE, ""), digest="")
        text = connection.msgdef.data
        if "roslib/Header" in text:  # its name before ROS Electric
            renamed = text.replace("roslib/Header", "std_msgs/Header")
            return connection._replace(msgdef=connection.msgdef._replace(data=renamed), digest="")
        return connection


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
                    f"{reader.bag}: defines {name} without ROS's field {field!r}, or with another type of it; "
                    "copy the bag again"
                )
            element: Any = kind if kind[0] in (Nodetype.BASE, Nodetype.NAME) else kind[1][0]  # of an array, its items'
            if element[0] == Nodetype.NAME and element[1] not in checked:
                left.append(element[1])


def unpacked(raw: bytes) -> bytes:
    """The bytes of a message that rosbag2 may have compressed; one in CDR or of ROS 1 does not begin like zstd."""
    if raw[:4] != ZSTD:
        return raw
    import zstandard

    frame = zstandard.ZstdDecompressor().decompressobj()
    found: bytes = frame.decompress(raw)
    if not frame.eof:
        raise ValueError("a compressed message is cut")
    return found


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
            yield connection, stamp_ns, unpacked(raw)
    except (MemoryError, RecordingError):
        raise
    except Exception as error:
        raise RecordingError(f"{reader.bag}: damaged: {_words(error)}; copy the bag again") from None


def deserialized(reader: Any, raw: bytes, connection: Any) -> Any:
    """A message from its bytes. Raises RecordingError if they are not a message of its type."""
    try:
        return reader.deserialize(raw, connection.msgtype)
    except MemoryError:
        raise
    except Exception as error:
        raise RecordingError(
            f"{reader.bag}: {connection.topic}: not a message of {connection.msgtype}: {_words(error)}; "
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


def _words(error: Exception) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 200 else f"{text[:197]}..."
