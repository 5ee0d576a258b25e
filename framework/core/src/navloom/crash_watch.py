"""A small process beside a command that runs plugins: it reports in one message where C code crashed or blocks it.

The crashed process cannot report it itself. Keep the imports light: this process is forked before all others.
"""

from __future__ import annotations

import os
import re
import select
import signal
import sys

from navloom.crashes import crashed_at, dump_when_broken

__all__ = ["dump_file", "is_watched", "watch_over"]

DUMP_CHECK_INTERVAL = 0.5
"""Time between two checks of the dump, s."""
MOST = 1 << 20
"""Largest part of a dump that is read, bytes."""
_STANDARD_ERROR = 2
_file = _STANDARD_ERROR


def dump_file() -> int:
    """File descriptor that Python prints dumps to: standard error, or the file that the watchdog process reads."""
    return _file


def is_watched() -> bool:
    """Whether a watchdog process observes this one."""
    return _file != _STANDARD_ERROR


def watch_over(is_whole: bool) -> None:
    """Fork the watchdog process for this one.

    Args:
        is_whole: Whether it prints the whole dump below its message.
    """
    global _file
    if sys.platform == "linux":
        try:
            # A pipe would fill up and block a process that is crashing.
            dump = os.memfd_create("dump", os.MFD_CLOEXEC)
            reading, writing = os.pipe()
            if os.fork() == 0:
                os.close(writing)
                _watch(reading, dump, os.getppid(), is_whole)
            os.close(reading)
            _file = dump
        except OSError:
            pass
    dump_when_broken(_file)


def _watch(reading: int, dump: int, pid: int, is_whole: bool) -> None:
    """Run in the watchdog process: read what Python prints until the command's process has ended."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        # Ctrl-C goes to the whole group; this process must outlive the one that it reports on.
        signal.signal(number, signal.SIG_IGN)
    os.close(0)
    os.close(1)
    seen = 0
    while True:
        # The pipe's other end closes when the command's process ends, whatever ended it.
        is_over = bool(select.select([reading], [], [], DUMP_CHECK_INTERVAL)[0])
        text = os.pread(dump, MOST, seen).decode("utf-8", "replace")
        # A dump is written line by line; half a line is read again with the rest.
        if text and (is_over or text.endswith("\n")):
            seen += len(text.encode())
            os.write(_STANDARD_ERROR, _message(text, pid, is_whole).encode("utf-8", "replace"))
        if is_over:
            os._exit(0)


def _message(dump: str, pid: int, is_whole: bool) -> str:
    """Summary of a dump in one line, followed by the dump itself if no plugin can be named."""
    place = crashed_at(dump)
    at = f" at {place}" if place else ""
    late = re.match(r"Timeout \((\d+):(\d+):(\d+)", dump)
    if late:
        seconds = 3600 * int(late[1]) + 60 * int(late[2]) + int(late[3])
        said = f"no tick for {seconds} s: the run is{at or ' in C code'}, which holds the GIL; `kill {pid}` ends it"
    else:
        what = re.match(r"Fatal Python error: (.*)", dump)
        said = f"the process crashed in C code: {what[1] if what else 'unknown error'}{at}"
        said += "" if is_whole or not place else "; --traceback prints all lines"
    return f"navloom: {said}\n" + (dump if is_whole or not place else "")
