"""Inputs of a role that has no scenes of its own: each field of its input struct as in a drive through a room."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import MISSING, fields
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
from navloom.messages import Message
from navloom.roles import given_of
from navloom.roles.extra import Extras
from navloom.roles.readings import Readings

from navloom_check.node_player import PERIOD_NS, message_at

__all__ = ["role_inputs"]


def role_inputs(
    role: str, rng: np.random.Generator, more: Callable[[float], dict[str, Any]], *, is_early: bool = False, steps: int
) -> Iterator[Any]:
    """Input structs of a role, one a tick.

    Args:
        role: The role.
        rng: Source of the values.
        more: Gives the readings and extra inputs of a time, s, as `_Maker.more`.
        is_early: Before the first messages: fields that may be None are, and tuples are empty.
        steps: How many.
    """
    cls = given_of(role)
    kinds = get_type_hints(cls)
    for number in range(steps):
        beside = more(number * PERIOD_NS * 1e-9)
        values = {}
        for field in fields(cls):
            value = _value(field.name, kinds[field.name], rng, number, is_early, beside)
            if value is not MISSING:
                values[field.name] = value
        yield cls(**values)


def _value(name: str, kind: Any, rng: np.random.Generator, number: int, is_early: bool, beside: dict[str, Any]) -> Any:
    """The value of one field; MISSING for a type that only the field's default can fill."""
    parts = get_args(kind)
    if kind in (Readings, Extras):
        return beside["readings" if kind is Readings else "extra"]
    if NoneType in parts:
        return None if is_early else _value(name, parts[0], rng, number, is_early, beside)
    if get_origin(kind) is tuple and isinstance(parts[0], type) and issubclass(parts[0], Message):
        return () if is_early else (message_at(parts[0], rng, number),)
    if name == "sensors":
        return ()
    if kind is int:
        return number * PERIOD_NS if name.endswith("_ns") else number
    if kind in (bool, float, str):
        return {bool: bool(rng.integers(2)), float: float(rng.uniform(0.1, 1.0)), str: "sample"}[kind]
    return message_at(kind, rng, number) if isinstance(kind, type) and issubclass(kind, Message) else MISSING
