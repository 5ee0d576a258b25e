"""Recordings made from the page: each by `navloom record` in a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from navloom import NavloomError

if TYPE_CHECKING:
    from navloom_dashboard.robot_link import Where

__all__ = ["Recordings"]

START_WAIT, END_WAIT = 15.0, 15.0
"""Longest start and end of a recorder, s."""


class RecordError(NavloomError, RuntimeError):
    """A recording cannot be started or ended."""


class Recordings:
    """Recordings of the robots of a dashboard.

    Args:
        folder: Where they are written.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._running: dict[str, tuple[asyncio.subprocess.Process, Path]] = {}

    async def start(self, robot: str, where: Where) -> str:
        """Start to record, and return the name of the file. Raises RecordError."""
        if name := self.running(robot):
            raise RecordError(f"{robot} is being recorded already, to {name}")
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / f"{robot.replace('/', '_')}_{datetime.now(UTC):%Y%m%d_%H%M%S}.mcap"
        options = ["--connect", where.connect] if where.connect else []
        options += ["--keys", where.keys] if where.keys else []
        options += ["--insecure"] if where.insecure else []
        child = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "navloom", "record", "--robot", robot, "--out", str(path), *options,
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.PIPE,
        )  # fmt: skip
        assert child.stderr is not None
        try:
            async with asyncio.timeout(START_WAIT):
                first = (await child.stderr.readline()).decode(errors="replace").removeprefix("navloom: ").strip()
        except TimeoutError:
            first = ""
        if not first.startswith("recording "):
            with contextlib.suppress(ProcessLookupError):
                child.kill()
            await child.wait()
            raise RecordError(first or f"the recorder did not start within {START_WAIT:g} s")
        self._running[robot] = child, path
        return path.name

    async def stop(self, robot: str) -> str:
        """End the recording, and return the name of its file. Raises RecordError."""
        if robot not in self._running:
            raise RecordError(f"{robot} is not being recorded")
        child, path = self._running.pop(robot)
        await _end(child)
        return path.name

    async def close(self) -> None:
        """End every recording."""
        for robot in list(self._running):
            await self.stop(robot)

    def running(self, robot: str) -> str | None:
        """Name of the file to which a robot is being recorded; None if it is not."""
        child, path = self._running.get(robot, (None, Path()))
        return path.name if child is not None and child.returncode is None else None

    def files(self, robot: str) -> list[dict[str, Any]]:
        """Recordings of a robot, the newest first."""
        found = sorted(self._folder.glob(f"{robot.replace('/', '_')}_*.mcap"), reverse=True)
        return [{"name": path.name, "bytes": path.stat().st_size} for path in found]

    def path(self, robot: str, name: str) -> Path | None:
        """The file of a name; None if the robot has no such recording, so that a path leads nowhere else."""
        return next((self._folder / one["name"] for one in self.files(robot) if one["name"] == name), None)


async def _end(child: asyncio.subprocess.Process) -> None:
    with contextlib.suppress(ProcessLookupError):
        child.terminate()
    try:
        async with asyncio.timeout(END_WAIT):
            await child.communicate()
    except TimeoutError:
        child.kill()
        await child.wait()
