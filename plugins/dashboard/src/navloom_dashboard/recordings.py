"""Recordings made from the page: each by `navloom record` in a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from dataclasses import dataclass
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


@dataclass
class _Recorder:
    """A recorder that was started, the file that it writes, and what it has said last."""

    child: asyncio.subprocess.Process
    path: Path
    said: str = ""
    listening: asyncio.Task[None] | None = None

    async def listen(self) -> None:
        """Read what it says until it ends: a full pipe would hold it."""
        assert self.child.stderr is not None
        async for line in self.child.stderr:
            self.said = line.decode(errors="replace").removeprefix("navloom: ").strip() or self.said
        await self.child.wait()

    @property
    def is_running(self) -> bool:
        return self.child.returncode is None


class Recordings:
    """Recordings of the robots of a dashboard.

    Args:
        folder: Where they are written.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._recorders: dict[str, _Recorder] = {}

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
        recorder = self._recorders[robot] = _Recorder(child, path)
        recorder.listening = asyncio.create_task(recorder.listen())
        return path.name

    async def stop(self, robot: str) -> str:
        """End the recording, and return the name of its file. Raises RecordError."""
        recorder = self._recorders.pop(robot, None)
        if recorder is None:
            raise RecordError(f"{robot} is not being recorded")
        if not recorder.is_running:
            raise RecordError(f"the recording has ended by itself: {recorder.said}")
        await _end(recorder)
        return recorder.path.name

    async def close(self) -> None:
        """End every recording."""
        for robot in list(self._recorders):
            with contextlib.suppress(RecordError):
                await self.stop(robot)

    def running(self, robot: str) -> str | None:
        """Name of the file to which a robot is being recorded; None if it is not."""
        recorder = self._recorders.get(robot)
        return recorder.path.name if recorder is not None and recorder.is_running else None

    def failure(self, robot: str) -> str:
        """Why the newest recording of a robot has ended by itself; empty if it has not."""
        recorder = self._recorders.get(robot)
        return "" if recorder is None or recorder.is_running else recorder.said or "its recorder was killed"

    def files(self, robot: str) -> list[dict[str, Any]]:
        """Recordings of a robot, the newest first."""
        found = sorted(self._folder.glob(f"{robot.replace('/', '_')}_*.mcap"), reverse=True)
        return [{"name": path.name, "bytes": path.stat().st_size} for path in found]

    def path(self, robot: str, name: str) -> Path | None:
        """The file of a name; None if the robot has no such recording, so that a path leads nowhere else."""
        return next((self._folder / one["name"] for one in self.files(robot) if one["name"] == name), None)


async def _end(recorder: _Recorder) -> None:
    with contextlib.suppress(ProcessLookupError):
        recorder.child.terminate()
    assert recorder.listening is not None
    try:
        async with asyncio.timeout(END_WAIT):
            await asyncio.shield(recorder.listening)
    except TimeoutError:
        recorder.child.kill()
        await recorder.listening
