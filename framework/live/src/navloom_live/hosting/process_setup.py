"""Set-up of every process of a robot: it shuts down on signals and survives a full disk."""

from __future__ import annotations

import contextlib
import io
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from navloom.crashes import dump_on

from navloom_live.hosting.process_log import LARGEST_LOG
from navloom_live.timing import SHUTDOWN_LIMIT
from navloom_live.transport.links import Link, Mesh

__all__ = [
    "SEIZED",
    "end_on_signal",
    "end_unless_called",
    "link_from_json",
    "link_to_json",
    "tolerate_write_errors",
]

SEIZED = signal.SIGPROF
"""Signal that ends a process in which a thread computes without releasing the GIL."""


def end_on_signal(ending: threading.Event) -> None:
    """Shut down on SIGTERM, SIGINT and SIGHUP; if that takes too long, the system ends the process.

    A system timer does this, because a watchdog thread could not run while another thread holds the GIL.
    """

    def end(number: int, frame: Any) -> None:
        if not ending.is_set():
            ending.set()
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.setitimer(signal.ITIMER_REAL, SHUTDOWN_LIMIT)

    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, end)


def end_unless_called(seconds: float) -> Callable[[], None]:
    """A function that must be called regularly: the process ends if it uses `seconds` of CPU time without a call.

    A system timer does this, because a watchdog thread could not run while another thread holds the GIL. It counts CPU
    time, so a process that was stopped for long continues.
    """

    def alive() -> None:
        signal.setitimer(signal.ITIMER_PROF, seconds)

    signal.signal(SEIZED, signal.SIG_DFL)
    dump_on(SEIZED)
    return alive


class _LossyFile(io.FileIO):
    """A file whose writes never fail, and that keeps of a single write no more than a log keeps."""

    def write(self, data: Any) -> int:
        """Write the end of the data, if possible, and return the length of all data."""
        whole = memoryview(data).cast("B")
        with contextlib.suppress(OSError):  # a full disk must not make a node fail that prints
            super().write(whole[-LARGEST_LOG:])
        return len(whole)


def tolerate_write_errors() -> None:
    """Make `print` in this process never fail, and never fill the log with one call."""
    for name in ("stdout", "stderr"):
        raw = _LossyFile(1 if name == "stdout" else 2, "wb", closefd=False)
        # Any text can be written, whatever the locale of the service manager is.
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
