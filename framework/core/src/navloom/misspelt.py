"""Suggestions for misspelt names."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

__all__ = ["close_to", "did_you_mean", "nearest"]

_SHOWN = 30
"""Most names that an error lists."""


def did_you_mean(name: str, known: Iterable[str], nothing: str = "none is known") -> str:
    """`did you mean 'x'?` with the known name closest to a wrong one, or the list of known names if none is close."""
    names = sorted(set(known))
    if close := close_to(name, names):
        return close.removeprefix("; ")
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"known are {', '.join(names[:_SHOWN])}{more}" if names else nothing


def nearest(name: str, known: list[str]) -> str:
    """The same with a semicolon before it, for names of what is installed."""
    return f"; {did_you_mean(name, known, 'none is installed')}"


def close_to(name: str, known: list[str]) -> str:
    """`; did you mean 'x'?` with the known name closest to a wrong one; empty if none is close."""
    close = get_close_matches(name, known, n=1, cutoff=0.6)
    return f"; did you mean {close[0]!r}?" if close else ""
