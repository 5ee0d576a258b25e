"""Decodes messages of any distribution: a class is loaded with its first message, unknown ones decode generically."""

from __future__ import annotations

import re
from collections.abc import Iterable

from navloom.messages import SCHEMAS, Envelope, Message
from navloom.messages.codec import UnknownSchema, decode
from navloom.messages.generic import decode_generic
from navloom.messages.schema import OLDER
from navloom.plugins.discovery import Discovery
from navloom.plugins.registry import PluginError

__all__ = ["OPENER", "Opener"]

MOST_LABELS = 1024
"""Largest number of remembered labels; bounded because any sender on the network can invent labels."""
_LABEL = re.compile(r"([A-Za-z_]\w*)\.([A-Za-z_]\w*)/([1-9]\d{0,8})", re.ASCII)


class Opener:
    """Decodes messages by their labels, for tools and recordings. Nodes do not need it: their classes are loaded.

    For the label `navloom_people.Tracks/1` it looks for the entry point `message.Tracks` whose module is in the
    package navloom_people, and imports no other.
    """

    def __init__(self) -> None:
        self._blocked: frozenset[str] = frozenset()
        self._discovery: Discovery | None = None
        self._why: dict[str, str] = {}

    def block(self, names: Iterable[str]) -> None:
        """Treat further entry points as not installed, as listed in a config's `[plugins] blocked`."""
        self._blocked |= frozenset(names)
        self._discovery = None

    def decode(self, data: bytes | memoryview, label: str) -> tuple[Message, Envelope]:
        """Decode a message with the codec, also of classes from installed distributions.

        Raises:
            CodecError: The codec refuses it, or its class is unknown here; the text gives the cause and the remedy.
        """
        try:
            return decode(data, label)
        except UnknownSchema:
            why = self.why_unknown(label)
            if why is None:
                raise
            if why:
                raise UnknownSchema(why) from None
        return decode(data, label)

    def open(self, data: bytes | memoryview, label: str) -> tuple[Message, Envelope]:
        """Decode a message; one of a distribution whose class is unknown here becomes a `GenericMessage`.

        Raises:
            CodecError: The codec refuses it, or it is a framework message of another version.
        """
        try:
            return self.decode(data, label)
        except UnknownSchema:
            why = self.why_unknown(label)
            if not why:
                raise
            return decode_generic(data, label, why)

    def why_unknown(self, label: str) -> str | None:
        """Why a label has no class here; empty if it has one, which is then loaded; None if no distribution owns it."""
        if label not in self._why:
            parts = _LABEL.fullmatch(label)
            # The framework's own classes are loaded already: another version is no matter of installing.
            if parts is None or parts[1] == "navloom":
                return None
            if len(self._why) >= MOST_LABELS:
                self._why.clear()
            self._why[label] = self._look(*parts.groups())
        return self._why[label]

    def reasons(self, labels: Iterable[str]) -> list[str]:
        """Why labels have no class here; those of one distribution that is not installed share a message."""
        found: dict[str, list[str]] = {}
        for label in dict.fromkeys(labels):
            if why := self.why_unknown(label):
                found.setdefault(why.replace(label, "{}"), []).append(label)
        return [why.replace("{}", " and ".join(sharing)) for why, sharing in found.items()]

    def _look(self, package: str, name: str, version: str) -> str:
        if self._discovery is None:
            self._discovery = Discovery(self._blocked)
        schema, owner = f"{package}.{name}", self._discovery.owner_of(package)
        if schema not in SCHEMAS:
            if not owner:
                install = f"pip install {package.replace('_', '-')}, or --plugin {package}.py"
                return f"messages of {package} are not installed here ({schema}/{version} came): {install}"
            if schema not in self._discovery.names("message"):
                return f"message {schema} is not declared by {owner}, which is installed here: update it, or unblock it"
            try:
                self._discovery.message(schema)
            except PluginError as error:
                return f"message {schema}: {error}"
        here = str(SCHEMAS[schema].schema_version)
        if here != version and f"{schema}/{version}" not in OLDER:
            return (
                f"message {schema}: version {version} was sent, {owner or package} here has version {here}; "
                "update the older side"
            )
        return ""


OPENER = Opener()
"""The opener of this process. Like SCHEMAS, which it fills, it exists once per process."""
