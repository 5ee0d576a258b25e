"""Line numbers of the values of a TOML file, for messages."""

from __future__ import annotations

import tomllib
from typing import Any

__all__ = ["line_of"]


def line_of(text: str, place: str) -> int | None:
    """Line, from 1, on which the value of a dotted place begins; of what is not there, that of the table round it.

    The parser keeps no positions, so the shortest beginnings of the file that parse and hold the place are searched.
    Tables of an array are counted from 0, as in `sensor.1.layout`.
    """
    lines = text.splitlines(keepends=True)
    keys = place.split(".")
    while keys and not _holds(_parsed(lines), keys):
        keys.pop()
    if not keys:
        return None
    low, high = 0, len(lines)
    while high - low > 1:
        middle = (low + high) // 2
        known = _longest(lines, low, middle)
        if _holds(_parsed(lines[:known]), keys):
            high = middle
        else:
            low = middle
    return _longest(lines, 0, high - 1) + 1


def _longest(lines: list[str], low: int, high: int) -> int:
    """Number of lines of the longest beginning that parses, at most `high` and at least `low`."""
    while high > low and _parsed(lines[:high]) is None:
        high -= 1
    return high


def _parsed(lines: list[str]) -> Any:
    try:
        return tomllib.loads("".join(lines))
    except tomllib.TOMLDecodeError:
        return None


def _holds(tree: Any, keys: list[str]) -> bool:
    for key in keys:
        if isinstance(tree, list) and key.isdigit() and int(key) < len(tree):
            tree = tree[int(key)]
        elif isinstance(tree, dict) and key in tree:
            tree = tree[key]
        else:
            return False
    return True
