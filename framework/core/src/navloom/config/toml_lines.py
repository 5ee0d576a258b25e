"""Line numbers of values in a TOML file, for messages."""

from __future__ import annotations

import tomllib
from bisect import bisect_left
from typing import Any

from navloom.inputs.texts import TOML_TOKENS

__all__ = ["line_of"]

LARGEST = 32_000
"""Largest file that is searched for line numbers, in characters: each search parses it about ten times."""


def line_of(text: str, place: str) -> int | None:
    """Line, from 1, where the value of a dotted place begins; for a missing place, the line of the table around it.

    The parser keeps no positions, so this searches the shortest beginning of the file that parses and has the place.
    Tables of an array are numbered from 0, as in `sensor.1.layout`.
    """
    if len(text) > LARGEST:
        return None
    lines, ends = text.split("\n"), _statement_ends(text)
    tree, keys = _parsed(lines), place.split(".")
    while keys and not _holds(tree, keys):
        keys.pop()
    if not keys:
        return None
    first = bisect_left(ends, True, key=lambda end: _holds(_parsed(lines[:end]), keys))
    return ends[first - 1] + 1 if first else 1


def _statement_ends(text: str) -> list[int]:
    """Numbers of lines after which no bracket or string is open: there a beginning of the file can parse."""
    depth = line = 0
    ends = []
    for match in TOML_TOKENS.finditer(text):
        token = match[0]
        depth += 1 if token in ("[", "{") else -1 if token in ("]", "}") else 0
        line += token.count("\n")
        if token == "\n" and depth == 0:
            ends.append(line)
    if not text.endswith("\n"):
        ends.append(line + 1)
    return ends


def _parsed(lines: list[str]) -> Any:
    try:
        return tomllib.loads("\n".join(lines))
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
