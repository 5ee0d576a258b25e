"""What plugins print in a run, kept within bounds: a flood hides every message, and fills disks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from navloom.plugins.owners import Owned, Owners

__all__ = ["LARGEST_OUTPUT", "bounded_output"]

LARGEST_OUTPUT = 64 * 1024
"""What one plugin may print in a run, characters."""


class _Bounded:
    """A stream that counts what each plugin prints, and leaves out what is too much. All else goes through."""

    def __init__(self, inner: Any, owners: Owners, counts: dict[tuple[str, str], int], say: Callable[[Owned], None]):
        self._inner, self._owners, self._counts, self._say = inner, owners, counts, say
        self.is_open = True

    def write(self, text: str) -> int:
        """Write, unless the plugin that prints has printed too much."""
        owned = self._owners.of(sys._getframe(1)) if self.is_open else None
        if owned is None:
            self._inner.write(text)
            return len(text)
        before = self._counts.get(owned.source, 0)
        self._counts[owned.source] = before + len(text)
        if before < LARGEST_OUTPUT:
            self._inner.write(text[: LARGEST_OUTPUT - before])
            if before + len(text) >= LARGEST_OUTPUT:
                self._inner.write("\n")
                self._say(owned)
        return len(text)

    def writelines(self, lines: Any) -> None:
        """Write each."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


@contextmanager
def bounded_output(owners: Owners, say: Callable[[Owned], None]) -> Iterator[dict[tuple[str, str], int]]:
    """Bound what these plugins print, within a `with` statement.

    Args:
        owners: The plugins.
        say: Told once of each that has printed too much, with the line.

    Yields:
        Characters that each has printed, by role and instance.
    """
    counts: dict[tuple[str, str], int] = {}
    made = {name: _Bounded(getattr(sys, name), owners, counts, say) for name in ("stdout", "stderr")}
    for name, stream in made.items():
        setattr(sys, name, stream)
    try:
        yield counts
    finally:
        for name, stream in made.items():
            stream.is_open = False
            if getattr(sys, name) is stream:  # several runs may be under way in threads
                setattr(sys, name, stream._inner)
