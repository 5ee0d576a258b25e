"""Detects that files were replaced while a process runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

__all__ = ["FileWatch"]

Stamp = tuple[tuple[int, int, int] | None, ...]


class FileWatch:
    """Checks files for changes.

    Args:
        paths: Paths of the files; a missing file may appear later.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = paths
        self._taken: Stamp
        self._last: Stamp
        self.take()

    def has_changed(self) -> bool:
        """Whether the files differ from the known ones, and stayed the same since the last call: copying has ended."""
        last, self._last = self._last, self._look()
        if self._last == self._taken or self._last != last:
            return False
        self._taken = self._last
        return True

    def take(self) -> None:
        """Take the current files as known."""
        self._taken = self._last = self._look()

    def _look(self) -> Stamp:
        return tuple(_stamp(path) for path in self._paths)


def _stamp(path: Path) -> tuple[int, int, int] | None:
    try:
        status = path.stat()
    except OSError:
        return None
    # The inode too: a file that is replaced within the clock's resolution may keep time and size.
    return status.st_ino, status.st_mtime_ns, status.st_size
