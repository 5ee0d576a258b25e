"""Keeps the runtime folder of a running robot, and access to its sockets, even if files there are deleted."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from navloom_live.hosting.runtime_folders import DirectoryError, RobotFolder

__all__ = ["FolderKeeper"]


class FolderKeeper:
    """Looks after one robot's folder for its supervisor.

    A process keeps listening on a socket whose file is deleted, but no other process can connect. So this class keeps
    each socket's file open, and replaces a deleted one with a symbolic link to the open file.

    Args:
        folder: The robot's folder.
        names: Names of its processes.
        say: Receives one message for each loss, and for what cannot be repaired.
    """

    def __init__(self, folder: RobotFolder, names: Sequence[str], say: Callable[[str], None]) -> None:
        self._folder, self._names, self._say = folder, [*names], say
        self._sockets: dict[str, int] = {}
        self._told = ""

    def watch(self, name: str) -> None:
        """Look after the socket of one more process."""
        self._names.append(name)

    def look(self) -> bool:
        """Repair what was deleted. Returns whether the folder itself had to be made again."""
        is_new = False
        try:
            if self._folder.is_held and not self._folder.is_there():
                self._folder.renew()
                is_new = True
                self._tell(f"runtime folder {self._folder.path} was deleted and is made again; the robot continues")
            for name in self._names:
                self._keep(name)
            if not is_new:
                self._told = ""
        except (OSError, DirectoryError) as error:
            self._tell(f"{error}; the robot continues, but no command finds it: `kill {os.getpid()}` ends it")
        return is_new

    def forget(self, name: str) -> None:
        """Release a process's socket, before the process listens on it again."""
        if (held := self._sockets.pop(name, None)) is not None:
            os.close(held)
        with suppress(OSError):
            self._path(name).unlink()

    def close(self) -> None:
        """Release all sockets."""
        for name in [*self._sockets]:
            os.close(self._sockets.pop(name))

    def _keep(self, name: str) -> None:
        """Keep a process's socket open, or link to it if its file is gone."""
        path, held = self._path(name), self._sockets.get(name)
        try:
            status = path.lstat()
        except FileNotFoundError:
            if held is not None:
                # A deleted socket can still be reached through an open file of it.
                path.symlink_to(f"/proc/{os.getpid()}/fd/{held}")
            return
        if held is None and stat.S_ISSOCK(status.st_mode) and sys.platform == "linux":
            # `O_PATH` holds the file without being a connection. Zenoh cannot listen a second time in a session, so
            # that the alternative was to restart the process.
            self._sockets[name] = os.open(path, os.O_PATH | os.O_CLOEXEC)

    def _path(self, name: str) -> Path:
        return self._folder.path / f"{name}.sock"

    def _tell(self, text: str) -> None:
        # Looked at twice a second: each text once.
        if text != self._told:
            self._told = text
            self._say(text)
