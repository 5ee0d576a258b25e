"""What docstrings say of the fields of a class."""

from __future__ import annotations

import re

__all__ = ["meanings"]


def meanings(text: str) -> dict[str, str]:
    """Text of each field from a docstring, where it is below `Attributes:` as `name, other: Text.`"""
    found: dict[str, str] = {}
    names: list[str] = []
    _, _, below = text.partition("Attributes:\n")
    for line in below.splitlines():
        entry = re.match(r" {4}(\w+(?:, \w+)*): (.*)", line)
        if line and not line.startswith(" "):
            break
        if entry:
            names = entry[1].split(", ")
            found |= dict.fromkeys(names, entry[2])
        elif line.strip():
            found |= {name: f"{found[name]} {line.strip()}" for name in names}
    return found
