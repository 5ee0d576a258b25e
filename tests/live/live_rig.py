"""A live robot for tests: its own runtime folder, the command line as a user has it, nothing left behind."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

COMMAND = [sys.executable, "-c", "from navloom.cli import main; main()"]
EMPTY = """
[world]
ref = "empty"

[platform]
plugin = "sensors_sim"

[[sensor]]
name = "sonars"
kind = "sonar_ring"

[mapper]
plugin = "known_map"

[navigation]
drive = false
start = { x = 0.0, y = 0.0 }
"""
"""A robot with sonars where nothing is, that waits for goals; more of `[navigation]` and other tables may follow."""
START = 90.0
END = 20.0


class Up:
    """`navloom up` as a process, with what it says."""

    def __init__(self, folder: Path, arguments: list[str]) -> None:
        self.environment = {**os.environ, "NAVLOOM_RUNTIME_DIR": str(folder)}
        self.process = subprocess.Popen(
            [*COMMAND, "up", *arguments],
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.said: list[str] = []
        self._news = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            with self._news:
                self.said.append(line.rstrip())
                self._news.notify_all()
        with self._news:
            self.said.append("(ended)")
            self._news.notify_all()

    def wait_for(self, text: str, timeout: float = START, after: int = 0) -> int:
        """Wait until a line with this text was said; gives the number of lines up to it."""
        with self._news:
            if not self._news.wait_for(
                lambda: any(text in line for line in self.said[after:]) or self._is_over(), timeout
            ):
                raise AssertionError(f"{text!r} not said within {timeout:g} s: {self.said}")
            for number, line in enumerate(self.said):
                if number >= after and text in line:
                    return number + 1
        raise AssertionError(f"ended without saying {text!r}: {self.said}")

    def _is_over(self) -> bool:
        return bool(self.said) and self.said[-1] == "(ended)"

    def run(self, *arguments: str, timeout: float = 60.0) -> subprocess.CompletedProcess[str]:
        """Another command on the same robot."""
        return subprocess.run(
            [*COMMAND, *arguments], env=self.environment, capture_output=True, text=True, timeout=timeout, check=False
        )

    def json(self, *arguments: str, timeout: float = 60.0) -> Any:
        """What another command prints with --json."""
        done = self.run(*arguments, "--json", timeout=timeout)
        assert done.stdout, done.stderr
        return json.loads(done.stdout)

    def end(self) -> int:
        """Ctrl-C; gives the exit code."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        return self.process.wait(END)


@contextmanager
def runtime_folder() -> Iterator[Path]:
    """A short path: a socket's name may have no more than some hundred characters."""
    folder = Path(tempfile.mkdtemp(prefix="nl", dir="/tmp"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def up(*arguments: str) -> Iterator[Up]:
    """A robot that is up, ended whatever happens."""
    with runtime_folder() as folder:
        robot = Up(folder, list(arguments))
        try:
            yield robot
        finally:
            if robot.process.poll() is None:
                robot.process.send_signal(signal.SIGINT)
                try:
                    robot.process.wait(END)
                except subprocess.TimeoutExpired:
                    robot.process.kill()
                    robot.process.wait()


def is_running(pid: int) -> bool:
    """A process is there and not a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
