"""Processes that a robot's plugins start: found by a mark in their environment, and ended with what started them."""

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

START is the time at which the system started the supervisor, by which it is told from a later one with its number.
"""
PROCESS = "NAVLOOM_PROCESS"
"""Environment variable: name of the robot's process that started another program."""
KILLED = 1.0
"""Longest wait for processes that were sent SIGKILL, s."""
ENDED = 1.0
"""Longest wait for them to become zombies after that, s."""
LOOK = 0.005
"""Time between two looks at processes that are to end, s."""


@dataclass(frozen=True)
class Descendant:
    """A process below `navloom up`: a process of the robot itself, or one that a plugin started.

    Attributes:
        pid: Of the process.
        group, session: It belongs to.
        supervisor: Process ID of its `navloom up`.
        is_left: That has ended.
        folder: Of the robot.
        process: Name of the robot's process that started it, as far as that can be told.
        command: What it runs.
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
    """Environment by which everything below this process is known as this robot's."""
    return {MARK: f"{os.getpid()}.{_start(os.getpid())}:{folder}"}


def descendants() -> Iterator[Descendant]:
    """Every marked process of this user on this host that runs."""
    with contextlib.suppress(OSError):  # without /proc none can be found
        for name in os.listdir("/proc"):
            if name.isdigit():
                with contextlib.suppress(OSError, ValueError):  # it has just ended, or belongs to another user
                    if (found := _read(int(name))) is not None:
                        yield found


def left_of(folder: Path) -> list[Descendant]:
    """What is left of a robot whose supervisor has ended."""
    return [one for one in descendants() if one.folder == folder and one.is_left]


def end_all(find: Callable[[], Sequence[Descendant]], patience: float = 0.0) -> list[Descendant]:
    """End processes until none is found: by SIGTERM for some s, then by SIGKILL. Gives those that it ended."""
    ended: dict[int, Descendant] = {}
    began, told = time.monotonic(), set[tuple[int, int]]()
    while left := find():
        spent = time.monotonic() - began
        if spent > patience + KILLED:
            break
        for one in left:
            ended[one.pid] = one
            for number in (signal.SIGTERM, signal.SIGCONT) if spent < patience else (signal.SIGKILL,):
                if (one.pid, number) not in told:
                    told.add((one.pid, number))
                    with contextlib.suppress(OSError):
                        os.kill(one.pid, number)
        time.sleep(LOOK)
    limit = time.monotonic() + ENDED
    for pid in ended:  # one that is ending cannot be found any more, but has its files and memory for a while
        while _start(pid) and time.monotonic() < limit:
            time.sleep(LOOK)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(pid, os.WNOHANG)
    return list(ended.values())


def reap_orphans(groups: Container[int], own: Container[int]) -> None:
    """Reap orphans that ended: the system gives those below this process to it, as it asked for.

    Args:
        groups: Process groups that the robot's processes have or had.
        own: Children that others here wait for; what else this process has started is in its own group and session.
    """
    me = os.getpid()
    try:
        children = Path(f"/proc/{me}/task/{me}/children").read_text("utf-8").split()
    except OSError:
        return
    session = os.getsid(0)
    for pid in map(int, children):
        if pid in own:
            continue
        with contextlib.suppress(OSError, ValueError):
            state, _, group, its_session = status_of(pid)[1:5]
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
    if not started_by:  # a fork has the environment and the command line of what it was forked off, but its own name
        started_by, line = name, "a fork"
    now = _start(int(number))
    is_left = not now or now != start
    return Descendant(
        pid, int(group), int(session), int(number), is_left, Path(folder), started_by, line or name
    )  # fmt: skip


def _start(pid: int) -> str:
    """When a process was started; empty where there is none any more, even if it was not reaped."""
    try:
        status = status_of(pid)
        return status[20] if status[1] not in "ZX" else ""
    except OSError:
        return ""


def status_of(pid: int) -> list[str]:
    """Of a process: name, state, parent, group, session, and at place 20 its start."""
    before, _, after = Path(f"/proc/{pid}/stat").read_text("utf-8", "replace").rpartition(")")
    return [before.partition("(")[2], *after.split()]


def _variables(environment: bytes, name: str) -> str:
    """A variable of an environment as the system keeps it; empty where it has none."""
    start = f"{name}=".encode()
    found = next((entry for entry in environment.split(b"\0") if entry.startswith(start)), start)
    return os.fsdecode(found.removeprefix(start))
