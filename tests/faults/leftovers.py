"""Leftovers of a robot on this host: processes, zombies, sockets, shared memory and temporary files."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

__all__ = ["Census", "below"]

SEGMENTS = "/dev/shm/"
OFTEN = 0.2
"""Time between two observations of a robot's resources, s."""
REAPED = 20.0
"""Longest wait for the host's init to reap orphans, s: on a busy host it took more than 3 s."""


class Census(threading.Thread):
    """Records the resources of a robot while it is up, so that those left over can be counted afterwards.

    Args:
        folder: Folder that only the robot's processes have in their environment; contains the runtime folder.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(daemon=True)
        self.folder, self.ending = folder, threading.Event()
        self._segments: set[str] = set()
        self._pids: set[int] = set()

    def run(self) -> None:
        """Observe until `ending` is set."""
        while not self.ending.is_set():
            self.note()
            self.ending.wait(OFTEN)

    def note(self) -> None:
        """Record the processes and shared memory that exist now."""
        for pid in below(self.folder):
            self._pids.add(pid)
            with suppress(OSError):
                for entry in os.scandir(f"/proc/{pid}/fd"):
                    with suppress(OSError):
                        name = os.readlink(entry.path).removesuffix(" (deleted)")
                        if name.startswith(SEGMENTS):
                            self._segments.add(name)

    @property
    def segments(self) -> int:
        """Number of shared memory segments seen so far."""
        return len(self._segments)

    def left(self) -> dict[str, int]:
        """Number of leftovers of a robot that is down, by kind."""
        self.ending.set()
        limit = time.monotonic() + REAPED
        while any(map(_is_zombie, self._pids)) and time.monotonic() < limit:
            time.sleep(OFTEN)
        files = [path for path in self.folder.glob("rt/*/*") if path.name != "lock" and ".log" not in path.name]
        return {
            "processes": len(list(below(self.folder))),
            "zombies": sum(map(_is_zombie, self._pids)),
            "sockets": sum(path.suffix == ".sock" for path in files),
            "files": sum(path.suffix != ".sock" for path in files),
            "shared memory": sum(map(os.path.exists, self._segments)),
        }


def below(folder: Path) -> Iterator[int]:
    """Processes that run with a folder in their environment."""
    mark = os.fsencode(folder)
    for name in filter(str.isdigit, os.listdir("/proc")):
        with suppress(OSError):
            if int(name) != os.getpid() and mark in Path(f"/proc/{name}/environ").read_bytes():
                yield int(name)


def _is_zombie(pid: int) -> bool:
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()[0] == "Z"
    return False
