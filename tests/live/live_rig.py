"""A live robot for tests, started by the command line in its own runtime folder; everything ends with the test."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import patch

from navloom.cli import main

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
"""A robot with sonars in an empty world, waiting for goals; keys of `[navigation]` and other tables may follow."""
BROKEN = '''
from navloom import Avoider, hookimpl

class Broken(Avoider):
    """Fails when it is made."""
    name = "broken"

    def __init__(self, params, context):
        raise RuntimeError("no such device")

    def avoid(self, given):
        raise NotImplementedError

@hookimpl
def navloom_register(registry):
    registry.add(Broken)
'''
"""A plugin file whose avoider cannot be made."""
HOSTING = ("up", "node")
"""Commands whose process becomes part of a robot."""
START = 90.0
END = 20.0


class Up:
    """`navloom up` as a process, with the lines that it prints."""

    def __init__(self, folder: Path, arguments: list[str], environment: dict[str, str] | None = None) -> None:
        self.environment = environment or {**os.environ, "NAVLOOM_RUNTIME_DIR": str(folder)}
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
        """Wait until a line with this text is printed; returns the number of lines up to it."""
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
        """Run another command on the same robot.

        It runs in this process, because a new interpreter costs 2 s of a processor; commands that host nodes get one.
        """
        if arguments[0] in HOSTING:
            command = [*COMMAND, *arguments]
            return subprocess.run(
                command, env=self.environment, capture_output=True, text=True, timeout=timeout, check=False
            )
        said, complained = (io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2))
        with (
            patch.object(sys, "argv", ["navloom", *arguments]),
            patch.dict(os.environ, self.environment, clear=True),
            redirect_stdout(said),
            redirect_stderr(complained),
            _bounded(timeout, " ".join(arguments)),
        ):
            try:
                main()
                code = 0
            except SystemExit as ended:
                code = int(ended.code or 0)
        out, err = (stream.buffer.getvalue().decode() for stream in (said, complained))  # type: ignore[attr-defined]
        return subprocess.CompletedProcess([*arguments], code, out, err)

    def json(self, *arguments: str, timeout: float = 60.0) -> Any:
        """Value that another command prints with --json."""
        done = self.run(*arguments, "--json", timeout=timeout)
        assert done.stdout, done.stderr
        return json.loads(done.stdout)

    def end(self) -> int:
        """Send Ctrl-C; returns the exit code."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        return self.process.wait(END)


class Overdue(BaseException):
    """A command took too long; the command line must not catch it."""


@contextmanager
def _bounded(seconds: float, what: str) -> Iterator[None]:
    """Raises Overdue in the main thread after this time."""

    def over(*_: object) -> None:
        raise Overdue(f"navloom {what}: not done within {seconds:g} s")

    before = signal.signal(signal.SIGALRM, over)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def runtime_folder() -> Iterator[Path]:
    """A folder with a short path: that of a socket is limited to about a hundred characters."""
    folder = Path(tempfile.mkdtemp(prefix="nl", dir="/tmp"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def up(*arguments: str) -> Iterator[Up]:
    """A robot that is up; always ended on exit."""
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
    """Whether a process exists and is no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
