"""What a process of a robot writes, kept within bounds: the newest part, and one older file."""

from __future__ import annotations

import os
import stat
import sys
from contextlib import suppress
from pathlib import Path

from navloom.crashes import crashed_at, is_of_dump

__all__ = ["LARGEST_LOG", "ProcessLog", "last_crash", "last_lines", "older_log"]

LARGEST_LOG = 2 * 2**20
"""Size of a log at which it begins again, and of what is kept of it beside, bytes."""
TAIL = 2**16
"""What is read for the last lines of a log, bytes."""
CATCH_UP = 100
"""Most reads after a log that grows as fast as it is read."""
CUT = "(navloom cut this log: "


class ProcessLog:
    """The log of one process, for every process of that name in turn.

    Args:
        path: Of the log. Where it cannot be written, the words are lost and the process runs.

    Attributes:
        cut: Bytes that were not kept so far.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.cut = path, 0
        self.file = _open(path)
        with suppress(OSError):
            os.ftruncate(self.file, 0)
            older_log(path).unlink(missing_ok=True)

    @property
    def shared(self) -> Path:
        """Path by which another process opens it, where the log's own path may be gone."""
        return Path(f"/proc/{os.getpid()}/fd/{self.file}") if sys.platform == "linux" else self.path

    def reopen(self) -> None:
        """Open it again where its folder was deleted meanwhile, or where it could not be opened."""
        with suppress(OSError):
            if os.path.samestat(os.fstat(self.file), self.path.stat()):
                return
        os.close(self.file)
        self.file = _open(self.path)

    def link(self) -> None:
        """Put a way to it where its file was deleted, so that what was said before can still be read."""
        with suppress(OSError):
            if sys.platform == "linux" and stat.S_ISREG(os.fstat(self.file).st_mode):
                self.path.symlink_to(self.shared)

    def bound(self) -> None:
        """Begin it again where it has grown too large; those that write add to its end, wherever that is."""
        with suppress(OSError):
            size = os.fstat(self.file).st_size
            if size <= LARGEST_LOG:
                return
            kept = os.pread(self.file, LARGEST_LOG, size - LARGEST_LOG)
            for _ in range(CATCH_UP):  # up to its end, so that no last word falls between the copy and the cut
                if not (more := os.pread(self.file, LARGEST_LOG, size)):
                    break
                kept, size = (kept + more)[-LARGEST_LOG:], size + len(more)
            os.ftruncate(self.file, 0)
            older = older_log(self.path)
            lost = size - len(kept) + (older.stat().st_size if older.exists() else 0)
            self.cut += lost
            os.write(
                self.file, f"{CUT}the {len(kept)} bytes before this are in {older.name}, {lost} are lost)\n".encode()
            )
            older.write_bytes(kept)

    def close(self) -> None:
        """Leave it to those that read it."""
        os.close(self.file)
        if self.path.is_symlink():
            self.path.unlink()


def _open(path: Path) -> int:
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)
    except OSError:
        return os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)


def older_log(path: Path) -> Path:
    """Where the part before the newest is kept."""
    return path.with_name(f"{path.name}.1")


def last_lines(path: Path, lines: int) -> list[str]:
    """The last lines of a log but for those of a dump; empty where there is none."""
    text = (_tail(older_log(path)) + _tail(path)).decode("utf-8", "replace")
    said = [line.strip() for line in text.splitlines() if not line.startswith(CUT) and not is_of_dump(line)]
    return said[-lines:]


def last_crash(path: Path) -> str:
    """The plugin's line at which the process of a log ended, where its log ends with a dump; else empty."""
    return crashed_at((_tail(older_log(path)) + _tail(path)).decode("utf-8", "replace"))


def _tail(path: Path) -> bytes:
    with suppress(OSError), path.open("rb") as file:
        file.seek(max(0, os.fstat(file.fileno()).st_size - TAIL))
        return file.read(TAIL)
    return b""
