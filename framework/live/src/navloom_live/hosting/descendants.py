"""Processes that a robot's plugins start: found by a mark in their environment, and ended with their parent."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

__all__ = ["MARK", "PROCESS", "Descendant", "descendants", "end_all", "left_of", "mark", "reap_orphans", "status_of"]

MARK = "NAVLOOM_SUPERVISED"
"""Environment variable of every process below `navloom up`: PID.START:FOLDER of its supervisor and of the robot.

START is the start time of the supervisor, which distinguishes it from a later process with the same PID.
"""
PROCESS = "NAVLOOM_PROCESS"
"""Environment variable with the name of the robot's process that started a program."""
KILL_WAIT = 1.0
"""Longest wait for processes that were sent SIGKILL, s."""
ZOMBIE_WAIT = 1.0
"""Longest wait for them to become zombies after that, s."""
END_CHECK_INTERVAL = 0.005
"""Interval of checking processes that are to end, s."""


@dataclass(frozen=True)
class Descendant:
    """A process below `navloom up`: a process of the robot itself, or one that a plugin started.

    Attributes:
        pid: Process ID.
        group, session: Its process group and session.
        supervisor: Process ID of its `navloom up`.
        is_left: Its supervisor has ended.
        folder: The robot's folder.
        process: Name of the robot's process that started it, if known.
        command: Its command line.
    """

    pid: int
    group: int
    session: int
    supervisor: int
    is_left: bool
    folder: Path
    process: str
    command: str

    def __str__(self) -> str:
        return f"process {self.pid} ({self.command}) of {self.process}"


def mark(folder: Path) -> dict[str, str]:
    """Environment that marks everything below this process as this robot's."""
    return {MARK: f"{os.getpid()}.{_start(os.getpid())}:{folder}"}


def descendants() -> Iterator[Descendant]:
    """Every marked process of this user that runs on this host."""
    with contextlib.suppress(OSError):  # no /proc
        for name in os.listdir("/proc"):
            if name.isdigit():
                with contextlib.suppress(OSError, ValueError):  # it has just ended, or belongs to another user
                    if (found := _read(int(name))) is not None:
                        yield found


def left_of(folder: Path) -> list[Descendant]:
    """Processes of a robot whose supervisor has ended."""
    return [descendant for descendant in descendants() if descendant.folder == folder and descendant.is_left]


def end_all(find: Callable[[], Sequence[Descendant]], patience: float = 0.0) -> list[Descendant]:
    """End processes until none is found: by SIGTERM for `patience`, s, then by SIGKILL. Returns those that it ended."""
    ended: dict[int, Descendant] = {}
    began, told = time.monotonic(), set[tuple[int, int]]()
    # Searched again each time, since a process that is ending may still start others.
    while left := find():
        spent = time.monotonic() - began
        if spent > patience + KILL_WAIT:
            break
        for one in left:
            ended[one.pid] = one
            # A stopped process handles SIGTERM only after it is continued.
            for number in (signal.SIGTERM, signal.SIGCONT) if spent < patience else (signal.SIGKILL,):
                # Each signal once: a handler that runs must not be interrupted by the same signal again.
                if (one.pid, number) not in told:
                    told.add((one.pid, number))
                    with contextlib.suppress(OSError):
                        os.kill(one.pid, number)
        time.sleep(END_CHECK_INTERVAL)
    limit = time.monotonic() + ZOMBIE_WAIT
    for pid in ended:  # `find` no longer finds a process that is ending, but it still holds its files and memory
        while _start(pid) and time.monotonic() < limit:
            time.sleep(END_CHECK_INTERVAL)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(pid, os.WNOHANG)
    return list(ended.values())


def reap_orphans(groups: Container[int], own: Container[int]) -> None:
    """Reap orphans that ended. This process is the subreaper, so orphans below it become its children.

    Args:
        groups: Process groups that the robot's processes have or had.
        own: Children that are reaped elsewhere. All others that this process started are in its own group and session.
    """
    me = os.getpid()
    try:
        children = Path(f"/proc/{me}/task/{me}/children").read_text("utf-8").split()
    except OSError:
        return
    session = os.getsid(0)
    for pid in map(int, children):
        # Reaped here, their exit codes would be lost to those who wait for them.
        if pid in own:
            continue
        with contextlib.suppress(OSError, ValueError):
            state, _, group, its_session = status_of(pid)[1:5]
            # Other children belong to code that waits for them itself, as `subprocess`.
            if state == "Z" and (int(group) in groups or int(its_session) != session):
                os.waitpid(pid, os.WNOHANG)


def _read(pid: int) -> Descendant | None:
    environment = Path(f"/proc/{pid}/environ").read_bytes()
    marks = _variables(environment, MARK)
    if not marks:
        return None
    supervisor, _, folder = marks.partition(":")
    number, _, start = supervisor.partition(".")
    name, _, _, group, session = status_of(pid)[:5]
    line = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode("utf-8", "replace").strip()
    started_by = _variables(environment, PROCESS)
    if not started_by:  # a fork has the environment and command line of its parent, but its own name
        started_by, line = name, "a fork"
    now = _start(int(number))
    # Another start time: the process ID belongs to a later process.
    is_left = not now or now != start
    return Descendant(
        pid, int(group), int(session), int(number), is_left, Path(folder), started_by, line or name
    )  # fmt: skip


def _start(pid: int) -> str:
    """Start time of a process; empty if it has ended, even if it was not reaped."""
    try:
        status = status_of(pid)
        return status[20] if status[1] not in "ZX" else ""
    except OSError:
        return ""


def status_of(pid: int) -> list[str]:
    """Fields of /proc/PID/stat: name, state, parent, group, session, and at index 20 the start time."""
    before, _, after = Path(f"/proc/{pid}/stat").read_text("utf-8", "replace").rpartition(")")
    return [before.partition("(")[2], *after.split()]


def _variables(environment: bytes, name: str) -> str:
    """A variable of an environment in the format of /proc; empty if it is not set."""
    start = f"{name}=".encode()
    found = next((entry for entry in environment.split(b"\0") if entry.startswith(start)), start)
    return os.fsdecode(found.removeprefix(start))
