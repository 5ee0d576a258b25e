"""Whether files have been replaced while a process runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

__all__ = ["FileWatch"]

Stamp = tuple[tuple[int, int, int] | None, ...]


class FileWatch:
    """Looks at files now and then.

    Args:
        paths: Of the files. One that is not there is a file that may come.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = paths
        self._taken: Stamp
        self._last: Stamp
        self.take()

    def has_changed(self) -> bool:
        """They are others than before, and as they were at the last look: a copy that is under way is waited for."""
        last, self._last = self._last, self._look()
        if self._last == self._taken or self._last != last:
            return False
        self._taken = self._last
        return True

    def take(self) -> None:
        """Whatever they are now, it is known."""
        self._taken = self._last = self._look()

    def _look(self) -> Stamp:
        return tuple(_stamp(path) for path in self._paths)


def _stamp(path: Path) -> tuple[int, int, int] | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns, status.st_size
