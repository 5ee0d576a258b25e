"""Keeps the folder of a robot that is up, and the way to its sockets, whatever is deleted there."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from navloom.hosting.directory import DirectoryError, RobotFolder

__all__ = ["FolderKeeper"]


class FolderKeeper:
    """Looks after one robot's folder for who supervises it.

    A process that listens at a socket goes on doing so when the socket's file is deleted, but nobody can call it. So
    this keeps each file open, and puts a link to the open file in the place of one that is gone.

    Args:
        folder: The robot's.
        names: Of its processes.
        say: Told once of each loss, and of what cannot be repaired.
    """

    def __init__(self, folder: RobotFolder, names: Sequence[str], say: Callable[[str], None]) -> None:
        self._folder, self._names, self._say = folder, names, say
        self._sockets: dict[str, int] = {}
        self._told = ""

    def look(self) -> bool:
        """Repair what is gone; whether the folder had to be made anew."""
        is_new = False
        try:
            if self._folder.is_held and not self._folder.is_there():
                self._folder.renew()
                is_new = True
                self._tell(f"runtime folder {self._folder.path} was deleted: it is there again, and the robot goes on")
            for name in self._names:
                self._keep(name)
            if not is_new:
                self._told = ""
        except (OSError, DirectoryError) as error:
            self._tell(f"{error}; the robot goes on, but no command finds it: `kill {os.getpid()}` ends it")
        return is_new

    def forget(self, name: str) -> None:
        """A process is about to listen anew at its socket."""
        if (held := self._sockets.pop(name, None)) is not None:
            os.close(held)
        with suppress(OSError):
            self._path(name).unlink()

    def close(self) -> None:
        """Let go of all of them."""
        for name in [*self._sockets]:
            os.close(self._sockets.pop(name))

    def _keep(self, name: str) -> None:
        """Hold a process's socket, or put a link to it where its file is gone."""
        path, held = self._path(name), self._sockets.get(name)
        try:
            status = path.lstat()
        except FileNotFoundError:
            if held is not None:
                path.symlink_to(f"/proc/{os.getpid()}/fd/{held}")
            return
        if held is None and stat.S_ISSOCK(status.st_mode) and sys.platform == "linux":
            self._sockets[name] = os.open(path, os.O_PATH | os.O_CLOEXEC)

    def _path(self, name: str) -> Path:
        return self._folder.path / f"{name}.sock"

    def _tell(self, text: str) -> None:
        if text != self._told:
            self._told = text
            self._say(text)
