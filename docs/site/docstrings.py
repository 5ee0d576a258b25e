"""Docstrings as griffe reads them: an entry for each name of `x, y: Text.`, class attributes among the attributes."""

from __future__ import annotations

import re
from typing import Any

import griffe

SECTION = re.compile(r"^(?:Args|Attributes|Class attributes[^:\n]*):$")
ENTRY = re.compile(r"^ {4}(\w+(?:, \w+)+): ")


def split_entries(text: str) -> str:
    """One entry for each name of a section, and the heading that griffe knows for class attributes."""
    found: list[str] = []
    shared: list[str] = []
    names: list[str] = []
    is_inside = False

    def close() -> None:
        for name in names:
            found.append(f"    {name}: {shared[0]}")
            found.extend(shared[1:])
        names.clear()
        shared.clear()

    for line in text.splitlines():
        if names and line.startswith(" " * 8):
            shared.append(line)
            continue
        close()
        if line and not line.startswith(" "):
            is_inside = SECTION.match(line) is not None
            found.append("Attributes:" if line.startswith("Class attributes") else line)
        elif is_inside and (entry := ENTRY.match(line)):
            names += entry[1].split(", ")
            shared.append(line[entry.end() :])
        else:
            found.append(line)
    close()
    return "\n".join(found)


class SharedEntries(griffe.Extension):
    """Rewrites the docstring of everything that has one."""

    def on_object(self, *, obj: griffe.Object, **given: Any) -> None:
        """Called once for each module, class, function and attribute."""
        if obj.docstring is not None:
            obj.docstring.value = split_entries(obj.docstring.value)
