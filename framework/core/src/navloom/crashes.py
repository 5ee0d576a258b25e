"""Crash dumps that Python prints when a signal ends a process, and the plugin line in them. Keep its imports light."""

from __future__ import annotations

import faulthandler
import os
import re
import signal
from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import NamedTuple

__all__ = ["crashed_at", "dump_on", "dump_when_broken", "ending_of", "is_of_dump"]

HERE = os.path.dirname(os.path.abspath(__file__))
CALLERS = tuple(os.path.join(HERE, house, "") for house in ("engine", "live", "plugins", "study"))
"""Folders of the framework's files that call plugins."""
STANDARD = os.path.join(os.path.dirname(os.path.abspath(os.__file__)), "")
_FRAME = re.compile(r'\s*File "(?P<path>[^"\n]*)", line (?P<line>\d+) in (?P<name>.+)')
_DUMP = re.compile(
    r'\s*File "[^"\n]*", line \d+ in |(Current t|T)hread 0x|Stack \(most recent|Extension modules: |'
    r"\s*<no Python frame>|\s*\.\.\.$|$"
)


class _Frame(NamedTuple):
    path: str
    line: int
    name: str


def dump_when_broken(file: int = 2) -> None:
    """Have Python print the tracebacks of all threads to an open file when C code crashes this process."""
    with suppress(OSError, ValueError, RuntimeError):  # without the file there is no reader either
        faulthandler.enable(file, all_threads=True)


def dump_on(number: int, file: int = 2) -> None:
    """Do the same at a signal, then run its previous handler. It works even while C code holds the GIL."""
    with suppress(OSError, ValueError, RuntimeError):
        faulthandler.register(number, file, all_threads=True, chain=True)


def ending_of(code: int | None) -> str:
    """How a process has ended, in words, by its exit code as `multiprocessing` gives it: a signal is negative."""
    if code is not None and code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return f"ended with exit code {code}"


def is_of_dump(line: str) -> bool:
    """Whether a log line belongs to a dump, its first line excepted."""
    return _DUMP.match(line) is not None


def crashed_at(log: str) -> str:
    """The plugin line at which a process ended, from the dump at the end of its log, as `mine.py:31, in avoid`.

    Empty if the log does not end with a dump, or if no plugin was running.
    """
    lines = log.splitlines()
    first = len(lines)
    while first and is_of_dump(lines[first - 1]):
        first -= 1
    threads = list(_threads(lines[first:]))
    # The running thread first: others only wait.
    threads.sort(key=lambda thread: not thread[0])
    return next(filter(None, (_place(frames) for _, frames in threads)), "")


def _threads(lines: Iterable[str]) -> Iterator[tuple[bool, list[_Frame]]]:
    """Threads of a dump: whether each was the running one, and its frames, innermost first."""
    frames: list[_Frame] = []
    is_current = True
    for line in lines:
        if found := _FRAME.match(line):
            frames.append(_Frame(found["path"], int(found["line"]), found["name"].strip()))
        elif line.startswith(("Current thread", "Thread", "Stack")):
            yield is_current, frames
            is_current, frames = not line.startswith("Thread"), []
    yield is_current, frames


def _place(frames: list[_Frame]) -> str:
    """The innermost line of the plugin that the framework had called, or imported; empty if it had done neither."""
    frames = [frame for frame in frames if not frame.path.startswith("<frozen")]  # of Python's import
    called = next((number for number, frame in enumerate(frames) if frame.path.startswith(CALLERS)), 0)
    verb = frames[called - 1].path if called else ""
    if not verb or _is_standard(verb) or verb.startswith(os.path.join(HERE, "")):
        return ""
    folder = os.path.join(os.path.dirname(verb), "")
    is_package = os.path.exists(os.path.join(folder, "__init__.py"))
    own = next(frame for frame in frames if frame.path == verb or (is_package and frame.path.startswith(folder)))
    return f"{os.path.basename(own.path)}:{own.line}, in {own.name}"


def _is_standard(path: str) -> bool:
    return path.startswith(STANDARD) and "-packages" not in path
