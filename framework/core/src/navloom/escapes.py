"""Escapes in texts from outside."""

from __future__ import annotations

__all__ = ["printable"]


def printable(text: str, kept: str = "") -> str:
    """A text from outside with escapes for what moves a terminal's cursor, ends a line or turns its direction.

    Args:
        text: Any text.
        kept: Characters to keep, as "\\n".
    """
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() or letter in kept else letter.encode("unicode_escape").decode()
        for letter in text
    )
