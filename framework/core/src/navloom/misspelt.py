"""Suggestions for misspelt names."""

from __future__ import annotations

from difflib import get_close_matches

__all__ = ["close_to", "nearest"]


def nearest(name: str, known: list[str]) -> str:
    """`; did you mean 'x'?` with the known name closest to a wrong one, or the list of known names if none is close."""
    return close_to(name, known) or (f"; known are {', '.join(sorted(known))}" if known else "; none is installed")


def close_to(name: str, known: list[str]) -> str:
    """`; did you mean 'x'?` with the known name closest to a wrong one; empty if none is close."""
    close = get_close_matches(name, known, n=1, cutoff=0.6)
    return f"; did you mean {close[0]!r}?" if close else ""
