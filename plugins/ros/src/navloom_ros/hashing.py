"""Type hashes of ROS 2 (REP 2011): RIHS01 is the SHA-256 of a type's description as JSON.

`rosbags` hashes most messages correctly, but treats `char` as a distinct type, while in a `.msg` it means `uint8`. The
event of every service has a `char`. So this module computes all hashes: of messages, services and actions.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from hashlib import sha256
from typing import Any

from rosbags.interfaces import Nodetype

__all__ = ["NOT_HASHED", "field_description", "rihs01"]

Fields = list[tuple[str, Any]]
"""Names and descriptors of a type's fields, as in `rosbags`: a node type and its operand."""

NOT_HASHED = "TypeHashNotSupported"
"""What Humble writes in place of a hash."""

_NESTED = 1
_BOUNDED_STRING = 21
_NUMBERS = {
    "int8": 2,
    "uint8": 3,
    "char": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "float128": 12,
    "bool": 15,
    "byte": 16,
    "string": 17,
}
"""Number of each primitive type (type_description_interfaces/msg/FieldType)."""
_ARRAY, _BOUNDED_SEQUENCE, _SEQUENCE = 48, 96, 144
"""Added to the number of the element type for an array or a sequence."""


def field_description(name: str, descriptor: Any) -> dict[str, Any]:
    """A field as in the JSON description: name, type number, capacities, name of a nested type."""
    kind, rest = descriptor
    number, capacity = 0, 0
    if kind not in (Nodetype.BASE, Nodetype.NAME):
        number = _ARRAY if kind == Nodetype.ARRAY else _BOUNDED_SEQUENCE if rest[1] else _SEQUENCE
        capacity = rest[1]
        kind, rest = rest[0]
    nested, longest = "", 0
    if kind == Nodetype.NAME:
        number += _NESTED
        nested = rest
    else:
        base, longest = rest
        number += _BOUNDED_STRING if longest else _NUMBERS[base]
    return {
        "name": name,
        "type": {
            "type_id": number,
            "capacity": capacity,
            "string_capacity": longest,
            "nested_type_name": nested,
        },
    }


def rihs01(name: str, fields: Mapping[str, Fields]) -> str:
    """Hash of a type, `RIHS01_` and 64 hexadecimal digits.

    Args:
        name: `package/kind/Name`.
        fields: Fields of this type and of all types that it refers to, directly or indirectly; by type name.
    """
    described: dict[str, dict[str, Any]] = {}
    waiting = [name]
    while waiting:
        current = waiting.pop()
        if current in described:
            continue
        entries = [field_description(*field) for field in fields[current]]
        described[current] = {"type_name": current, "fields": entries}
        waiting.extend(nested for entry in entries if (nested := entry["type"]["nested_type_name"]))
    whole = {
        "type_description": described.pop(name),
        "referenced_type_descriptions": [described[other] for other in sorted(described)],
    }
    return f"RIHS01_{sha256(json.dumps(whole).encode()).hexdigest()}"
