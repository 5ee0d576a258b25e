"""What every process of a robot does first: it ends with its parent, and in order when it is told to."""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from navloom.crashes import dump_on
from navloom.hosting.process_log import LARGEST_LOG
from navloom.transport.links import Link, Mesh

__all__ = [
    "SEIZED",
    "die_with_parent",
    "end_on_signal",
    "end_unless_called",
    "link_from_json",
    "link_to_json",
    "write_heedlessly",
]

PR_SET_PDEATHSIG = 1
GRACE = 4.0
"""s a process that was told to end may take; then it ends at once."""
SEIZED = signal.SIGPROF
"""What ends a process in which some thread computes and never lets go of Python."""


def die_with_parent(parent: int) -> None:
    """Have the system tell this process to end when its parent dies, however that dies."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it died before that
        os._exit(1)


def end_on_signal(ending: threading.Event) -> None:
    """End in order on SIGTERM, SIGINT and SIGHUP, and at once where that takes too long.

    The system's own alarm sees to that: a thread would wait with all others where one of them never lets go of Python.
    """

    def end(number: int, frame: Any) -> None:
        if not ending.is_set():
            ending.set()
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.setitimer(signal.ITIMER_REAL, GRACE)

    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, end)


def end_unless_called(seconds: float) -> Callable[[], None]:
    """Gives a function that is called again and again; where it is not, while this process computes for s, it ends.

    The system sees to that, since no watchdog within Python could. Time of the processor is counted, so that a process
    which was stopped for long goes on.
    """

    def alive() -> None:
        signal.setitimer(signal.ITIMER_PROF, seconds)

    signal.signal(SEIZED, signal.SIG_DFL)
    dump_on(SEIZED)
    return alive


class _Heedless(io.FileIO):
    """A file that takes what cannot be written, and of a single write no more than a log keeps."""

    def write(self, data: Any) -> int:
        """Write the end of it, as far as that works. Gives its length."""
        whole = memoryview(data).cast("B")
        with contextlib.suppress(OSError):  # a full disk must not make the node fail that prints
            super().write(whole[-LARGEST_LOG:])
        return len(whole)


def write_heedlessly() -> None:
    """Have `print` never fail in this process, nor fill its log at once."""
    for name in ("stdout", "stderr"):
        raw = _Heedless(1 if name == "stdout" else 2, "wb", closefd=False)
        stream = io.TextIOWrapper(io.BufferedWriter(raw), "utf-8", "backslashreplace", line_buffering=True)
        setattr(sys, name, stream)


def link_to_json(link: Link) -> dict[str, Any]:
    """A link as JSON."""
    mesh = link.mesh and {**vars(link.mesh), "link": link_to_json(link.mesh.link)}
    return {**vars(link), "credentials": str(link.credentials) if link.credentials else None, "mesh": mesh}


def link_from_json(given: dict[str, Any]) -> Link:
    """A link from its JSON."""
    mesh, folder = given["mesh"], given["credentials"]
    if mesh is not None:
        mesh = Mesh(link_from_json(mesh["link"]), tuple(mesh["here"]), mesh["is_whole"])
    lists = {name: tuple(given[name]) for name in ("listen", "connect", "streams")}
    return Link(**{**given, **lists, "credentials": Path(folder) if folder else None, "mesh": mesh})
