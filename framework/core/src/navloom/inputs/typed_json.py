"""Reads JSON into typed structs: frozen dataclasses, whose fields the type checker knows."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

__all__ = ["from_builtins", "from_json"]

Struct = TypeVar("Struct", bound="DataclassInstance")


def from_json(cls: type[Struct], data: bytes | str) -> Struct:
    """The struct of a JSON object, see `from_builtins`. Raises ValueError."""
    return from_builtins(cls, json.loads(data))


def from_builtins(cls: type[Struct], given: Any, from_texts: bool = False) -> Struct:
    """The struct of an object that was read from JSON. Entries that the class does not have are ignored.

    Args:
        cls: Class of the struct.
        given: The object.
        from_texts: Numbers are given as texts, as in a CSV file.

    Raises:
        ValueError: An entry is missing or has another type; the text says which one and what was expected.
    """
    if isinstance(given, dict) and not fields(cls):
        return cls()
    from msgspec import ValidationError, convert  # here, so that `navloom stop`, whose answer is empty, starts without

    try:
        return convert(given, cls, strict=not from_texts)
    except ValidationError as error:
        what, _, place = str(error).replace("`", "").partition(" - at $.")
        raise ValueError(f"{place}: {what[0].lower()}{what[1:]}" if place else f"{what[0].lower()}{what[1:]}") from None
