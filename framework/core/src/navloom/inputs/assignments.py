"""Assignments `key = value` with values in TOML, as options of a command and requests to a robot carry them."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

from navloom.inputs.bounds import DEEPEST, Refusal
from navloom.inputs.texts import refuse_deep_toml, refuse_deep_tree

__all__ = ["assignments", "brief", "read_assignment"]

LONGEST_KEY = 1000
"""Longest key of an assignment, in characters."""


def read_assignment(text: str, where: str, refusal: Refusal) -> tuple[str, Any]:
    """Key and value of `key=value`.

    Args:
        text: The assignment. A value that is not TOML is text.
        where: Option that it belongs to, for errors.
        refusal: Makes the error for a malformed one.
    """
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise refusal(f"{where} {brief(text)}: expected PATH=VALUE, as in {where} controller.k3=1.0")
    if key.count(".") >= DEEPEST:
        raise refusal(f"{where} {key[:57]}...: a key of {key.count('.') + 1} parts, expected at most {DEEPEST}")
    if len(key) > LONGEST_KEY:
        raise refusal(f"{where} {brief(key)}: a key of {len(key)} characters, expected at most {LONGEST_KEY}")
    return key.strip(), _value(value, f"{where} {key.strip()}", refusal)


def _value(text: str, where: str, refusal: Refusal) -> Any:
    """A TOML value, or the text itself if it is none."""
    refuse_deep_toml(text, where, refusal)
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        # A bare word is a text, so that nobody has to quote within a shell's quotes.
        return text.strip()
    except ValueError:
        raise refusal(f"{where}: a whole number of more than 4300 digits, expected fewer") from None
    refuse_deep_tree(value, where, refusal)
    return value


def brief(text: str, most: int = 200) -> str:
    """A text, cut to a length, for error messages."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


def assignments(values: Mapping[str, Any]) -> tuple[str, ...]:
    """Parameters as `name = value`, sorted by name, as a request carries them."""
    return tuple(f"{name} = {_toml(value)}" for name, value in sorted(values.items()))


def _toml(value: Any) -> str:
    # Before numbers: `repr(True)` is no TOML.
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return repr(value)
