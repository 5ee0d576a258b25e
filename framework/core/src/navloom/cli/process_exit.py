"""Ends the process of a command even if a plugin's thread would keep it alive."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time

from navloom.cli.output import LOG

__all__ = ["end_in_time"]

PATIENCE = 2.0
"""Time that threads may take to end after the command, s."""


def end_in_time(code: int, patience: float = PATIENCE) -> None:
    """Exit with a code after `patience` seconds at most, and log which threads still run and who started them.

    Without it Python would wait for every non-daemon thread. Idle executor threads end by themselves meanwhile.
    """
    if not _others():
        return

    def end() -> None:
        limit = time.monotonic() + patience
        while left := _others():
            if time.monotonic() > limit:
                LOG.warning("; ".join(map(_named, left)) + f": ended after {patience:g} s")
                for stream in (sys.stdout, sys.stderr):
                    with contextlib.suppress(OSError, ValueError):
                        stream.flush()
                os._exit(code)
            time.sleep(0.02)

    threading.Thread(target=end, name="end in time", daemon=True).start()


def _others() -> list[threading.Thread]:
    main = threading.main_thread()
    return [
        thread for thread in threading.enumerate() if thread is not main and thread.is_alive() and not thread.daemon
    ]


def _named(thread: threading.Thread) -> str:
    from navloom.plugins.thread_owners import started_by

    owned = started_by(thread)
    by = "" if owned is None else f", which {' '.join(owned.source)} started ({owned.place}),"
    return f"the thread {thread.name!r}{by} kept the process alive"
