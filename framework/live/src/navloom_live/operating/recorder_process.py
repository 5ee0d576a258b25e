"""Runs a recorder in a separate process beside a robot that this process started."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from navloom_recording.writer import WriteError

__all__ = ["recorder_beside"]

RECORDER_CLOSE_LIMIT = 15.0
"""Longest time that a recorder may take to close its file, s."""


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
    listener = threading.Thread(target=_listen, args=(child.stdout, say), daemon=True)
    listener.start()
    try:
        yield
    finally:
        child.terminate()
        try:
            child.wait(RECORDER_CLOSE_LIMIT)
        except subprocess.TimeoutExpired:
            # A full or hanging disk: the robot has ended already.
            child.kill()
            child.wait()
            say(f"{path}: its recorder did not end; what it wrote can be read")
        if child.returncode:
            cut.append(f"{path}: its recorder ended with code {child.returncode}")
        listener.join(1.0)


def _listen(lines: Iterator[str], say: Callable[[str], None]) -> None:
    for line in lines:
        say(line.removeprefix("navloom: ").rstrip())
