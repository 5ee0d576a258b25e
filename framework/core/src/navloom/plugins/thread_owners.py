"""Finds the plugin that started a thread which keeps the process alive."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from weakref import WeakKeyDictionary

from navloom.plugins.code_owners import Owned, Owners

__all__ = ["keeping_alive", "started_by", "watched_threads"]

_WATCHING: list[tuple[Owners, list[threading.Thread]]] = []
_STARTED: WeakKeyDictionary[threading.Thread, Owned] = WeakKeyDictionary()
SETTLE = 0.2
"""Time that a thread may take to end by itself after the run, s."""


@cache
def _look_at_starts() -> None:
    """Patch `Thread.start` to record which plugin starts a thread, while a `watched_threads` block is active."""
    start = threading.Thread.start

    def remembered(self: threading.Thread) -> None:
        for owners, started in _WATCHING:
            owned = owners.of(sys._getframe(1))
            if owned is not None:
                _STARTED[self] = owned
                started.append(self)
        start(self)

    threading.Thread.start = remembered  # type: ignore[method-assign]


@contextmanager
def watched_threads(owners: Owners) -> Iterator[list[threading.Thread]]:
    """Record which of these plugins start threads, within a `with` statement; yields the list of these threads."""
    _look_at_starts()
    watching: tuple[Owners, list[threading.Thread]] = owners, []
    _WATCHING.append(watching)
    try:
        yield watching[1]
    finally:
        _WATCHING.remove(watching)


def started_by(thread: threading.Thread) -> Owned | None:
    """The plugin that started a thread, and the line; None if it is not known."""
    return _STARTED.get(thread)


def keeping_alive(started: Sequence[threading.Thread], settle: float = SETTLE) -> list[threading.Thread]:
    """The threads that the process would wait for at its end, after `settle` seconds in which they may end themselves.

    Threads of an executor are left out: Python ends them when they are idle.
    """
    limit = time.monotonic() + settle
    while found := [thread for thread in started if _keeps(thread)]:
        if time.monotonic() > limit:
            return found
        found[0].join(0.01)
    return []


def _keeps(thread: threading.Thread) -> bool:
    pools = sys.modules.get("concurrent.futures.thread")
    return thread.is_alive() and not thread.daemon and thread not in getattr(pools, "_threads_queues", ())
