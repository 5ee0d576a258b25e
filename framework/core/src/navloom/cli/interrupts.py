"""Orderly shutdown of a command that runs until it is interrupted."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["ending", "terminate_as_interrupted"]


def terminate_as_interrupted() -> None:
    """Raise KeyboardInterrupt on SIGTERM too, so that a command ends its workers."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)


@contextmanager
def ending() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C and SIGTERM set; a second Ctrl-C raises KeyboardInterrupt."""
    event = threading.Event()

    def end(number: int, frame: Any) -> None:
        if event.is_set() and number == signal.SIGINT:
            raise KeyboardInterrupt
        event.set()

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield event
    finally:
        for number, handler in before.items():
            # A process that is shutting down must not be interrupted by another Ctrl-C.
            signal.signal(number, signal.SIG_IGN if event.is_set() else handler)
