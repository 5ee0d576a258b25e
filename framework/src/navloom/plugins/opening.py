"""Opens messages of every distribution: a class is loaded when its first message comes; others are shown as sent."""

from __future__ import annotations

import re
from collections.abc import Iterable

from navloom.messages import SCHEMAS, Envelope, Message
from navloom.messages.codec import UnknownSchema, decode
from navloom.messages.generic import decode_generic
from navloom.plugins.discovery import Discovery
from navloom.plugins.registry import PluginError

__all__ = ["OPENER", "Opener"]

MOST_LABELS = 1024
"""Most labels that are remembered: whoever may send on the network can make them up."""
_LABEL = re.compile(r"([A-Za-z_]\w*)\.([A-Za-z_]\w*)/([1-9]\d{0,8})", re.ASCII)


class Opener:
    """Messages by their labels, for tools and recordings; nodes are wired to classes that are loaded already.

    A label `navloom_people.Tracks/1` is looked for at the entry point `message.Tracks` of a distribution whose module
    is in the package navloom_people; no other one is imported.
    """

    def __init__(self) -> None:
        self._blocked: frozenset[str] = frozenset()
        self._discovery: Discovery | None = None
        self._why: dict[str, str] = {}

    def block(self, names: Iterable[str]) -> None:
        """Treat these entry points as not installed too, as a config's `[plugins] blocked` says."""
        self._blocked |= frozenset(names)
        self._discovery = None

    def decode(self, data: bytes | memoryview, label: str) -> tuple[Message, Envelope]:
        """As the codec decodes it, with classes of installed distributions.

        Raises:
            CodecError: What the codec refuses, or a class that is not known here: the text says why, and what helps.
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
        """The same; a message of a distribution whose class is not known here comes as a `GenericMessage`.

        Raises:
            CodecError: What the codec refuses, and a message of the framework in another version.
        """
        try:
            return self.decode(data, label)
        except UnknownSchema:
            why = self.why_unknown(label)
            if not why:
                raise
            return decode_generic(data, label, why)

    def why_unknown(self, label: str) -> str | None:
        """Why a label has no class here; empty where it has one, which is loaded. None: it is of no distribution."""
        if label not in self._why:
            parts = _LABEL.fullmatch(label)
            if parts is None or parts[1] == "navloom":
                return None
            if len(self._why) >= MOST_LABELS:
                self._why.clear()
            self._why[label] = self._look(*parts.groups())
        return self._why[label]

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
        if here != version:
            return (
                f"message {schema}: version {version} was sent, {owner or package} here has version {here}; "
                "update the older side"
            )
        return ""


OPENER = Opener()
"""Of this process, as SCHEMAS, which it fills."""
