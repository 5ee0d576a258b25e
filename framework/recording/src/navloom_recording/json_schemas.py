"""Message schemas as JSON schemas, so that a recording can be decoded without navloom."""

from __future__ import annotations

import inspect
import json
import math
from dataclasses import MISSING, fields
from typing import Any

import numpy as np
from navloom.messages import Message
from navloom.messages.codec import schema_label
from navloom.messages.kinds import DTYPES, Kind, typed

__all__ = ["ENCODING", "SCHEMA_ENCODING", "schema_text"]

ENCODING = "navloom"
"""Name of the message encoding."""

SCHEMA_ENCODING = "jsonschema"
"""Name of the encoding of schemas."""
DIALECT = "https://json-schema.org/draft/2020-12/schema"
_LAYOUT = """\
The header of a message with encoding "navloom". The message is, little endian:
  u32 length of the header | header | zeros to a multiple of 64 bytes | array | zeros to a multiple of 64 | array ...
The header is MessagePack. In its fields an array is its place in `arrays`, which has element type (numpy), shape, and
offset in bytes from the first array. A number may be infinite where its description says so.
All values are in SI units and radians unless their name says otherwise; x forward, y left, angles counter-clockwise.
"""
_COUNT: dict[str, Any] = {"type": "integer", "minimum": 0}
_ENVELOPE = {
    "description": "key, sequence, tick, stamp_ns and cause_ns on the run clock, selection epoch",
    "type": "array",
    "prefixItems": [{"title": "key", "type": "string"}]
    + [{"title": name, **_COUNT} for name in ("sequence", "tick", "stamp_ns", "cause_ns", "epoch")],
    "minItems": 6,
}
_ARRAYS = {
    "type": "array",
    "items": {
        "type": "array",
        "prefixItems": [
            {"title": "dtype", "enum": list(DTYPES)},
            {"title": "shape", "type": "array", "items": _COUNT},
            {"title": "offset", **_COUNT},
        ],
        "minItems": 3,
    },
}
_TYPES = {"float": "number", "int": "integer", "bool": "boolean", "str": "string"}
_RULES: dict[str, dict[str, Any]] = {
    "positive": {"exclusiveMinimum": 0},
    "not_negative": {"minimum": 0},
    "stamp": {"minimum": 0},
    "heading": {"minimum": -math.pi, "maximum": math.pi},
}


def schema_text(cls: type[Message]) -> str:
    """JSON schema of a message's header: fields with docstrings and units, and the shapes of arrays.

    In the header an array is a number, its index in `arrays`; its schema gives element type and shape under `array`.
    """
    nested: list[type[Message]] = [cls]
    # The list grows while it is read, until no class brings another one.
    for one in nested:
        nested += [inner for kind in one.kinds.values() for inner in _nested(kind) if inner not in nested]
    schema = {
        "$schema": DIALECT,
        "title": schema_label(cls),
        "description": _LAYOUT,
        "type": "object",
        "required": ["envelope", "fields", "arrays"],
        "properties": {"envelope": _ENVELOPE, "fields": _reference(cls), "arrays": _ARRAYS},
        "$defs": {one.schema_name: _class_schema(one) for one in nested},
    }
    return json.dumps(schema, ensure_ascii=False)


def _class_schema(cls: type[Message]) -> dict[str, Any]:
    optional = {field.name for field in fields(cls) if field.default is not MISSING}  # type: ignore[arg-type]
    return {
        "description": inspect.getdoc(cls) or "",
        "type": "object",
        "required": [name for name in cls.kinds if name not in optional],
        "properties": {name: _field_schema(kind) for name, kind in cls.kinds.items()},
    }


def _field_schema(kind: Kind) -> dict[str, Any]:
    required = {"description": typed(kind), **_value_schema(kind)}
    return {"anyOf": [required, {"type": "null"}]} if kind.optional else required


def _value_schema(kind: Kind) -> dict[str, Any]:
    if kind.array is not None:
        array: dict[str, Any] = {"dtype": np.dtype(kind.array.dtype).str, "shape": list(kind.array.shape)}
        bounds = {"minimum": kind.array.at_least, "maximum": kind.array.at_most}
        array |= {name: bound for name, bound in bounds.items() if bound is not None}
        return {"type": "integer", "minimum": 0, "array": array | {"infinite": kind.array.infinite}}
    if kind.message is not None:
        return _reference(kind.message)
    if kind.item is not None:
        return {"type": "array", "items": _field_schema(kind.item), "maxItems": kind.most}
    if kind.choices:
        return {"enum": list(kind.choices)}
    return {"type": _TYPES[kind.form], **_RULES.get(kind.rule, {})}


def _reference(cls: type[Message]) -> dict[str, Any]:
    return {"$ref": f"#/$defs/{cls.schema_name}"}


def _nested(kind: Kind) -> list[type[Message]]:
    if kind.message is not None:
        return [kind.message]
    return [] if kind.item is None else _nested(kind.item)
