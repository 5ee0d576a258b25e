"""Runs other commands of navloom in processes of their own, beside a robot that this process starts."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from navloom.parts import part

__all__ = ["dashboard_beside", "recorder_beside"]

RECORDER_CLOSE_LIMIT = 15.0
"""Longest time that a recorder may take to close its file, s."""
DASHBOARD_END_LIMIT = 5.0
"""Longest end of a dashboard, s."""


@contextmanager
def recorder_beside(
    prefix: str, path: Path, say: Callable[[str], None], cut: list[str], insecure: bool = False
) -> Iterator[None]:
    """Record a running robot for the duration of a `with` statement, whose body starts when the recorder is connected.

    Args:
        prefix: REALM/ROBOT.
        path: File to write.
        say: Receives the recorder's messages.
        cut: Gets a line if the file is cut short.
        insecure: Plain TCP to other hosts was requested.

    Raises:
        WriteError: The recorder could not start.
    """
    from navloom_recording.writer import WriteError

    command = [sys.executable, "-m", "navloom", "record", "--robot", prefix, "--out", str(path)]
    command += ["--insecure"] if insecure else []
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert child.stdout is not None
    # The first line says that it listens: the robot's first tick must not come before.
    first = child.stdout.readline().removeprefix("navloom: ").strip()
    if not first.startswith("recording "):
        child.wait(RECORDER_CLOSE_LIMIT)
        raise WriteError(first or f"the recorder ended with code {child.returncode}")
    say(first)
    listener = _listener(child.stdout, say)
    try:
        yield
    finally:
        if not _ended(child, RECORDER_CLOSE_LIMIT):
            # A full or hanging disk: the robot has ended already.
            say(f"{path}: its recorder did not end; what it wrote can be read")
        if child.returncode:
            cut.append(f"{path}: its recorder ended with code {child.returncode}")
        listener.join(1.0)


@contextmanager
def dashboard_beside(robot: str, insecure: bool, say: Callable[[str], None]) -> Iterator[None]:
    """Serve the dashboard of a robot for the duration of a `with` statement, and open its page if there is a display.

    Args:
        robot: REALM/NAME; the dashboard waits for it.
        insecure: Plain TCP to other hosts was requested.
        say: Receives what it prints: the addresses of the page.

    Raises:
        MissingPartError: The dashboard is not installed.
    """
    part("navloom_dashboard", "--dashboard")  # which loads nothing of the server
    command = [sys.executable, "-m", "navloom", "dashboard", robot, "--port", "0"]
    command += ["--insecure"] if insecure else []
    command += ["--open"] if _has_display() else []
    child = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert child.stdout is not None
    listener = _listener(child.stdout, lambda line: say(f"dashboard: {line}"))
    try:
        yield
    finally:
        _ended(child, DASHBOARD_END_LIMIT)
        listener.join(1.0)


def _has_display() -> bool:
    return sys.platform == "darwin" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def _listener(lines: Iterator[str], say: Callable[[str], None]) -> threading.Thread:
    """A thread that passes on what a process prints."""

    def listen() -> None:
        for line in lines:
            say(line.removeprefix("navloom: ").rstrip())

    thread = threading.Thread(target=listen, daemon=True)
    thread.start()
    return thread


def _ended(child: subprocess.Popen[str], limit: float) -> bool:
    """End a process: whether it ended by itself within a time, s, after it was asked to; it has ended in any case."""
    child.terminate()
    try:
        child.wait(limit)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
        return False
    return True
