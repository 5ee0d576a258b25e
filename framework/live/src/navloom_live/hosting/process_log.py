"""Bounded log of a robot's process: the newest part, and one older file."""

from __future__ import annotations

import os
import stat
import sys
from contextlib import suppress
from pathlib import Path

from navloom.crashes import crashed_at, is_of_dump

__all__ = ["LARGEST_LOG", "ProcessLog", "last_crash", "last_lines", "older_log"]

LARGEST_LOG = 2 * 2**20
"""Size at which a log is rotated, and largest size of the older file, bytes."""
TAIL = 2**16
"""Bytes read for the last lines of a log."""
CATCH_UP = 100
"""Most reads to catch up with a log that grows as fast as it is read."""
CUT = "(navloom cut this log: "


class ProcessLog:
    """The log of one process and of its successors of the same name.

    Args:
        path: Path of the log. If it cannot be written, the output is lost and the process runs.

    Attributes:
        cut: Bytes lost so far.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.cut = path, 0
        self.file = _open(path)
        with suppress(OSError):
            os.ftruncate(self.file, 0)
            older_log(path).unlink(missing_ok=True)

    @property
    def shared(self) -> Path:
        """Path by which another process can open the log even if its own path is gone."""
        return Path(f"/proc/{os.getpid()}/fd/{self.file}") if sys.platform == "linux" else self.path

    def reopen(self) -> None:
        """Open the log again if its folder was deleted, or if it could not be opened before."""
        with suppress(OSError):
            if os.path.samestat(os.fstat(self.file), self.path.stat()):
                return
        os.close(self.file)
        self.file = _open(self.path)

    def link(self) -> None:
        """Replace a deleted log file with a link to the open one, so that earlier output can still be read."""
        with suppress(OSError):
            if sys.platform == "linux" and stat.S_ISREG(os.fstat(self.file).st_mode):
                self.path.symlink_to(self.shared)

    def bound(self) -> None:
        """Rotate the log if it has grown too large; writers append to its end, wherever that is."""
        with suppress(OSError):
            size = os.fstat(self.file).st_size
            if size <= LARGEST_LOG:
                return
            kept = os.pread(self.file, LARGEST_LOG, size - LARGEST_LOG)
            for _ in range(CATCH_UP):  # up to the end, so that no output is lost between copy and truncation
                if not (more := os.pread(self.file, LARGEST_LOG, size)):
                    break
                kept, size = (kept + more)[-LARGEST_LOG:], size + len(more)
            os.ftruncate(self.file, 0)
            older = older_log(self.path)
            lost = size - len(kept) + (older.stat().st_size if older.exists() else 0)
            self.cut += lost
            end = "" if kept.endswith(b"\n") else "\n"
            notice = f"{end}{CUT}the {len(kept)} bytes before this are in {older.name}, {lost} are lost)\n"
            os.write(self.file, notice.encode())
            older.write_bytes(kept)

    def close(self) -> None:
        """Close the log; its file stays for readers."""
        os.close(self.file)
        if self.path.is_symlink():
            self.path.unlink()


def _open(path: Path) -> int:
    try:
        # Appending, so that writers follow after a truncation instead of leaving a hole.
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)
    except OSError:
        return os.open(os.devnull, os.O_RDWR | os.O_CLOEXEC)


def older_log(path: Path) -> Path:
    """Path of the older part of a log."""
    return path.with_name(f"{path.name}.1")


def last_lines(path: Path, lines: int) -> list[str]:
    """The last lines of a log, without those of a crash dump; empty for none."""
    text = (_tail(older_log(path)) + _tail(path)).decode("utf-8", "replace")
    said = [line.strip() for line in text.splitlines() if not line.startswith(CUT) and not is_of_dump(line)]
    return said[-lines:]


def last_crash(path: Path) -> str:
    """The plugin's line at which a process crashed, if its log ends with a crash dump; otherwise empty."""
    return crashed_at((_tail(older_log(path)) + _tail(path)).decode("utf-8", "replace"))


def _tail(path: Path) -> bytes:
    with suppress(OSError), path.open("rb") as file:
        file.seek(max(0, os.fstat(file.fileno()).st_size - TAIL))
        return file.read(TAIL)
    return b""
