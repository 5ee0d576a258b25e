"""Bounds what plugins print in a run: a flood would hide every message and fill the disk."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from navloom.plugins.code_owners import Owned, Owners

__all__ = ["LARGEST_OUTPUT", "bounded_output"]

LARGEST_OUTPUT = 64 * 1024
"""Most characters that one plugin may print in a run, or in each time window of a live robot."""


class _Counts:
    """Counts the characters that each plugin has printed, in time windows of `window` seconds."""

    def __init__(self, window: float) -> None:
        self._window, self._began = window, time.monotonic()
        self._counts: dict[tuple[str, str], int] = {}

    def add(self, source: tuple[str, str], size: int) -> int:
        """Count what a plugin prints, and return what it had printed before in this window, characters."""
        now = time.monotonic()
        if now - self._began > self._window:
            self._began = now
            self._counts.clear()
        before = self._counts.get(source, 0)
        self._counts[source] = before + size
        return before


class _Bounded:
    """A text stream that counts what each plugin prints and drops the excess. Other output passes through."""

    def __init__(self, inner: Any, owners: Owners, counts: _Counts, say: Callable[[Owned], None]) -> None:
        self._inner, self._owners, self._counts, self._say = inner, owners, counts, say
        self.is_open = True

    def write(self, text: str) -> int:
        """Write the text, unless the plugin that prints it has printed too much."""
        # The stack is the only thing that tells who prints.
        owned = self._owners.of(sys._getframe(1)) if self.is_open else None
        if owned is None:
            self._inner.write(text)
            return len(text)
        before = self._counts.add(owned.source, len(text))
        if before < LARGEST_OUTPUT:
            self._inner.write(text[: LARGEST_OUTPUT - before])
            if before + len(text) >= LARGEST_OUTPUT:
                self._inner.write("\n")
                self._say(owned)
        return len(text)

    def writelines(self, lines: Any) -> None:
        """Write each line."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


@contextmanager
def bounded_output(owners: Owners, say: Callable[[Owned], None], window: float = math.inf) -> Iterator[None]:
    """Bound what these plugins print, within a `with` statement.

    Args:
        owners: The plugins.
        say: Called with each plugin that has printed too much and its line, once a window.
        window: Length of the window in which characters are counted, s.
    """
    counts = _Counts(window)
    made = {name: _Bounded(getattr(sys, name), owners, counts, say) for name in ("stdout", "stderr")}
    for name, stream in made.items():
        setattr(sys, name, stream)
    try:
        yield
    finally:
        for name, stream in made.items():
            # Whoever kept the stream may write to it after the run.
            stream.is_open = False
            if getattr(sys, name) is stream:  # other threads may have runs of their own
                setattr(sys, name, stream._inner)
