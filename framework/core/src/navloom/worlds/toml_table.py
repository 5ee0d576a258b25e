"""Reads a TOML table key by key; every error names the file, the table and the key."""

from __future__ import annotations

import math
from collections.abc import Collection
from pathlib import Path
from typing import Any

from navloom.geometry.angles import wrap
from navloom.inputs.headings import heading_problem
from navloom.inputs.texts import shortened
from navloom.misspelt import did_you_mean
from navloom.worlds.world_errors import WorldError

__all__ = ["FileTable"]

_FARTHEST = 1e6
"""Largest number in a world file, m, s or degrees."""


class FileTable:
    """One table of a file.

    Args:
        path: The file.
        place: Name of the table in errors, as `[[box]] 2`; empty for the file itself.
        content: Its keys and values.
        known: Valid keys.

    Raises:
        WorldError: It is not a table, or has an unknown key.
    """

    def __init__(self, path: Path, place: str, content: Any, known: Collection[str]) -> None:
        self.path, self.place = path, place
        if not isinstance(content, dict):
            raise self.error(f"{shortened(content)}, expected a table")
        for key in content:
            if key not in known:
                raise self.error(f"key {shortened(key)} does not exist; {did_you_mean(key, known)}")
        self._content = content

    def __contains__(self, key: str) -> bool:
        return key in self._content

    def error(self, text: str) -> WorldError:
        """An error about something in this table."""
        return WorldError(f"{self.path}, {self.place}: {text}" if self.place else f"{self.path}: {text}")

    def value(self, key: str) -> Any:
        """The value of a required key."""
        if key not in self._content:
            raise self.error(f"key {key!r} is missing")
        return self._content[key]

    def number(self, key: str, default: float | None = None, least: float = -_FARTHEST) -> float:
        """A finite number, at least `least`."""
        if default is not None and key not in self._content:
            return default
        value = self.value(key)
        if not _is_number(value) or not least <= value <= _FARTHEST:
            raise self.error(f"{key} = {shortened(value)}, expected a number from {least:g} to {_FARTHEST:g}")
        return float(value)

    def heading(self, key: str) -> float:
        """A heading, rad in [-π, π), 0 by default; the file has degrees within a turn to either side."""
        heading_deg = self.number(key, 0.0)
        if problem := heading_problem(heading_deg):
            raise self.error(f"{key}: {problem}")
        return wrap(math.radians(heading_deg))

    def numbers(self, key: str, meaning: str) -> tuple[float, ...]:
        """As many finite numbers as `meaning` names, as in `[lowest, highest]`."""
        value = self.value(key)
        count = meaning.count(",") + 1
        if not isinstance(value, list) or len(value) != count or not all(_is_number(v) for v in value):
            raise self.error(f"{key} = {shortened(value)}, expected {meaning}")
        return tuple(float(v) for v in value)

    def interval(self, key: str, default: tuple[float, float] | None = None) -> tuple[float, float]:
        """A lower and a higher number."""
        if default is not None and key not in self._content:
            return default
        low, high = self.numbers(key, "[lowest, highest]")
        if not low < high:
            raise self.error(f"{key} = [{low:g}, {high:g}], expected [lowest, highest]; swap or part them")
        return low, high

    def text(self, key: str, default: str | None = None) -> str:
        """A non-empty string."""
        if default is not None and key not in self._content:
            return default
        value = self.value(key)
        if not isinstance(value, str) or not value:
            raise self.error(f"{key} = {shortened(value)}, expected a text")
        return value

    def choice(self, key: str, choices: tuple[str, ...]) -> str:
        """One of several words, the first by default."""
        value = self.text(key, choices[0])
        if value not in choices:
            raise self.error(
                f"{key} = {shortened(value)}, expected one of {', '.join(choices)}; {did_you_mean(value, choices)}"
            )
        return value

    def flag(self, key: str, default: bool = False) -> bool:
        """True or false."""
        value = self._content.get(key, default)
        if not isinstance(value, bool):
            raise self.error(f"{key} = {shortened(value)}, expected true or false")
        return value


def _is_number(value: Any) -> bool:
    # To Python a bool is an int.
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    # isfinite() raises for an int that no float can hold, which TOML can write.
    return math.isfinite(value) and abs(value) <= _FARTHEST if isinstance(value, float) else abs(value) <= _FARTHEST
