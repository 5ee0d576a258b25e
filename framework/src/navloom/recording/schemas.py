"""Message schemas as text, so that a recording explains itself to whoever has no navloom."""

from __future__ import annotations

import inspect

from navloom.messages import Message
from navloom.messages.codec import schema_label
from navloom.messages.kinds import Kind

__all__ = ["ENCODING", "schema_text", "typed"]

ENCODING = "navloom"
"""Name of the message encoding and of the encoding of schemas."""

_LAYOUT = """\
Message encoding "navloom", little endian:
  u32 length of the header | header | zeros to a multiple of 64 bytes | array | zeros to a multiple of 64 | array ...
The header is a MessagePack map:
  envelope  [key, sequence, tick, stamp_ns, cause_ns, epoch]
  fields    map of the fields below; an array is its place in `arrays`; a nested message is a map of its fields
  arrays    list of [element type (numpy), shape, offset in bytes from the first array]
All values are in SI units and radians unless their name says otherwise; x forward, y left, angles counter-clockwise.
"""


def schema_text(cls: type[Message]) -> str:
    """What a message holds: name, version, fields with types and shapes, docstrings with units, layout of the bytes."""
    parts = []
    seen: list[type[Message]] = [cls]
    for one in seen:
        parts.append(_described(one))
        seen += [inner for kind in one.kinds.values() for inner in _nested(kind) if inner not in seen]
    return "\n".join([*parts, _LAYOUT])


def _described(cls: type[Message]) -> str:
    lines = [schema_label(cls), *(f"  {name}: {typed(kind)}" for name, kind in cls.kinds.items())]
    text = inspect.getdoc(cls) or ""
    return "\n".join([*lines, *(f"  | {line}".rstrip() for line in text.splitlines()), ""])


def typed(kind: Kind) -> str:
    """What a field holds, in words."""
    if kind.array is not None:
        shape = ", ".join(map(str, kind.array.shape))
        text = f"array of {kind.array.dtype}, shape ({shape})"
        text += ", +inf allowed" if kind.array.infinite else ""
    elif kind.message is not None:
        text = kind.message.schema_name
    elif kind.item is not None:
        text = f"list of {typed(kind.item)}"
    elif kind.choices:
        text = "one of " + ", ".join(map(repr, kind.choices))
    else:
        text = f"{kind.form}, +inf allowed" if kind.infinite else kind.form
    return f"{text} or null" if kind.optional else text


def _nested(kind: Kind) -> list[type[Message]]:
    if kind.message is not None:
        return [kind.message]
    return [] if kind.item is None else _nested(kind.item)
