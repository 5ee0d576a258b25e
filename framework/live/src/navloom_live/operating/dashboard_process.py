"""Runs `navloom dashboard` in a separate process beside a robot that this process starts."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from navloom.parts import part

__all__ = ["dashboard_beside"]

END_LIMIT = 5.0
"""Longest end of a dashboard, s."""


@contextmanager
def dashboard_beside(robot: str, keys: str, insecure: bool, say: Callable[[str], None]) -> Iterator[None]:
    """Serve the dashboard of a robot for the duration of a `with` statement, and open its page if there is a display.

    Args:
        robot: REALM/NAME; the dashboard waits for it.
        keys: Certificates, see `join`; empty for those that the robot was started with.
        insecure: Plain TCP to other hosts was requested.
        say: Receives what it prints: the addresses of the page.

    Raises:
        MissingPartError: The dashboard is not installed.
    """
    part("navloom_dashboard", "--dashboard")  # which loads nothing of the server
    command = [sys.executable, "-m", "navloom", "dashboard", robot, "--port", "0"]
    command += ["--keys", keys] if keys else []
    command += ["--insecure"] if insecure else []
    command += ["--open"] if _has_display() else []
    child = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert child.stdout is not None
    listener = threading.Thread(target=_listen, args=(child.stdout, say), daemon=True)
    listener.start()
    try:
        yield
    finally:
        child.terminate()
        try:
            child.wait(END_LIMIT)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        listener.join(1.0)


def _has_display() -> bool:
    return sys.platform == "darwin" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def _listen(lines: Iterator[str], say: Callable[[str], None]) -> None:
    for line in lines:
        say(f"dashboard: {line.removeprefix('navloom: ').rstrip()}")
