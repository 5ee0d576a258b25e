"""The message, service and action types of one ROS 2 distribution, and their bytes.

Messages are plain dataclasses that `rosbags` makes, with `__msgtype__`. Their arrays of numbers are numpy arrays.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_typestore

from navloom_ros.errors import BadDefinition, MalformedMessage, UnfitMessage, UnknownType
from navloom_ros.hashing import NOT_HASHED, rihs01
from navloom_ros.texts import Definitions, check_references, definitions_in, types_of
from navloom_ros.values import filled, misfit, plain, spare_bytes, with_unsigned_bytes

__all__ = ["DISTRIBUTIONS", "LARGEST", "Types"]

DISTRIBUTIONS = {
    "humble": (Stores.ROS2_HUMBLE, ("common", "humble")),
    "jazzy": (Stores.ROS2_JAZZY, ("common", "since_jazzy", "jazzy")),
    "kilted": (Stores.ROS2_KILTED, ("common", "since_jazzy", "since_kilted", "kilted")),
    "lyrical": (Stores.ROS2_LYRICAL, ("common", "since_jazzy", "since_kilted", "lyrical")),
}
"""By distribution, the messages of `rosbags` and the folders of `interfaces` with what those lack."""
LARGEST = 32 << 20
"""Bytes of the largest message that is decoded."""
MOST_PARTS = 500_000
"""Messages within one message: each takes some 200 bytes and 2 µs, far more than it may take on the wire."""
SMALL = 1 << 16
"""Bytes of a message that cannot have as many parts as to be worth counting."""
PADDING = 3
"""Bytes that DDS adds to fill the last four."""
_ENCAPSULATIONS = (b"\x00\x00", b"\x00\x01")
"""First bytes of XCDR1, big and little endian."""


class Types:
    """What one distribution knows, and what a user adds.

    Args:
        distribution: Which ROS 2: humble, jazzy, kilted or lyrical.
        folders: Folders with definitions of one's own, as `package/msg/Name.msg`.
        largest: Bytes of the largest message that is decoded.

    Raises:
        UnknownType: No such distribution.
        BadDefinition: A definition that cannot be used.
    """

    def __init__(self, distribution: str = "jazzy", folders: Iterable[Path] = (), largest: int = LARGEST) -> None:
        if distribution not in DISTRIBUTIONS:
            raise UnknownType(f"ROS 2 distribution {distribution!r}: expected one of {', '.join(DISTRIBUTIONS)}")
        self.distribution = distribution
        self.largest = largest
        store, own = DISTRIBUTIONS[distribution]
        self._store = get_typestore(store)
        self._hashes: dict[str, str] = {}
        self._make_bytes_unsigned(self._store.fielddefs)
        shipped = Path(str(files("navloom_ros"))) / "interfaces"
        self.add(dict(entry for name in own for entry in definitions_in(shipped / name)))
        for folder in folders:
            self.add(dict(definitions_in(folder)))

    def add(self, texts: dict[str, str]) -> None:
        """Add definitions: by name as `package/msg/Name`, their text.

        Raises:
            BadDefinition: A text that cannot be used, or another one than is known for that type; nothing is added.
        """
        defined: Definitions = {}
        for name, text in texts.items():
            defined |= types_of(name, text)
        check_references(defined, self._store.fielddefs)
        try:
            self._store.register(defined)
        except TypesysError as error:
            raise BadDefinition(str(error)) from None
        self._make_bytes_unsigned(defined)

    @property
    def names(self) -> list[str]:
        """Every type, sorted; of services and actions, their parts too."""
        return sorted(self._store.fielddefs)

    def has(self, name: str) -> bool:
        """Whether a type is known."""
        return name in self._store.fielddefs

    def fields(self, name: str) -> list[tuple[str, Any]]:
        """Names and descriptors of a type's fields, as `rosbags` has them."""
        self._require(name)
        return list(self._store.fielddefs[name][1])

    def hash_of(self, name: str) -> str:
        """Type hash of a message, service or action, as the wire has it; Humble has none."""
        if self.distribution == "humble":
            return NOT_HASHED
        self._require(name)
        if name not in self._hashes:
            self._hashes[name] = rihs01(name, {one: entry[1] for one, entry in self._store.fielddefs.items()})
        return self._hashes[name]

    def schema_of(self, name: str) -> str:
        """The type's `.msg` text with those of all it refers to, as recordings keep it (`ros2msg`)."""
        self._require(name)
        return self._store.generate_msgdef(name, ros_version=2)[0]

    def new(self, name: str, /, **values: Any) -> Any:
        """A message; fields that are not given are zero, empty or, for orientations, none.

        Args:
            name: `package/msg/Name`.
            values: By field; of a nested message a mapping will do, of an array anything that numpy takes.

        Raises:
            UnknownType: No such type.
            UnfitMessage: No such field, or a value that does not fit it.
        """
        self._require(name)
        return filled(self._store, name, values)

    def encode(self, message: Any) -> bytes:
        """Bytes of a message, XCDR1, little endian.

        Raises:
            UnfitMessage: A value does not fit its field.
            UnknownType: No message of this distribution.
        """
        name = getattr(message, "__msgtype__", "")
        self._require(name)
        if reason := misfit(self._store, message, name):
            raise UnfitMessage(reason)
        try:
            return bytes(self._store.serialize_cdr(message, name, little_endian=True))
        except (SerdeError, struct.error, UnicodeEncodeError, AttributeError, TypeError, ValueError) as error:
            raise UnfitMessage(f"{name}: {error}") from None

    def encode_as(self, name: str, message: Any) -> bytes:
        """Bytes of a message of this very type. Raises UnfitMessage where it is of another one."""
        given = getattr(message, "__msgtype__", type(message).__name__)
        if given != name:
            raise UnfitMessage(f"message is {given}; expected {name}")
        return self.encode(message)

    def decode(self, name: str, data: bytes) -> Any:
        """The message that bytes hold. Its arrays are views of them, read-only.

        Raises:
            UnknownType: No such type.
            MalformedMessage: The bytes are no message of this type, or too many.
        """
        self._require(name)
        if len(data) > self.largest:
            raise MalformedMessage(f"{name}: {len(data)} bytes; at most {self.largest} are decoded")
        if data[:2] not in _ENCAPSULATIONS:
            raise MalformedMessage(f"{name}: begins with {data[:4].hex()!r}; expected 0001, XCDR1 little endian")
        definition = self._store.get_msgdef(name)
        read = definition.deserialize_cdr_le if data[1] else definition.deserialize_cdr_be
        body = data[4:]
        store: Any = self._store if len(body) <= SMALL else _Counting(self._store)
        try:
            message, end = read(body, 0, definition.cls, store)
        except (SerdeError, struct.error, ValueError, IndexError) as error:
            raise MalformedMessage(f"{name}: {str(error)[:200]}") from None
        if len(body) - end > PADDING and len(body) - end > PADDING + spare_bytes(self._store, message):
            raise MalformedMessage(f"{name}: {len(body) - end} bytes after its end")
        return message

    def plain(self, message: Any, most: int | None = None) -> Any:
        """A message as dicts, lists and numbers; of lists longer than `most`, the first and how many there are."""
        return plain(self._store, message, most)

    def _make_bytes_unsigned(self, names: Iterable[str]) -> None:
        """A `byte` is 0 to 255 in ROS; `rosbags` reads it as signed. Have it make these types' readers of `uint8`."""
        for name in names:
            constants, fields = self._store.fielddefs[name]
            unsigned = [(field, with_unsigned_bytes(descriptor)) for field, descriptor in fields]
            if unsigned != fields:
                self._store.fielddefs[name] = (constants, unsigned)
                self._store.get_msgdef(name)  # which keeps what it has made
                self._store.fielddefs[name] = (constants, fields)

    def _require(self, name: str) -> None:
        if name not in self._store.fielddefs:
            raise UnknownType(f"type {name!r} is not known in {self.distribution}: give the folder with its definition")


class _Counting:
    """Stands for the store of `rosbags` while one message is read, and refuses to make more than MOST_PARTS parts."""

    def __init__(self, store: Any) -> None:
        self.max_sequence_length = store.max_sequence_length
        self._store = store
        self._definitions: dict[str, Any] = {}
        self._left = MOST_PARTS

    def get_msgdef(self, name: str) -> Any:
        """The definition of a type, whose class counts."""
        if name not in self._definitions:
            definition = self._store.get_msgdef(name)
            self._definitions[name] = replace(definition, cls=partial(self._made, definition.cls))
        return self._definitions[name]

    def _made(self, cls: type[Any], *values: Any) -> Any:
        self._left -= 1
        if self._left < 0:
            raise SerdeError(f"more than {MOST_PARTS} messages within it")
        return cls(*values)
