"""A child process that draws. The process that runs or observes the robot only puts messages into a queue."""

from __future__ import annotations

import contextlib
import multiprocessing
import queue
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from time import monotonic
from typing import Any

from navloom.messages import Message
from navloom.plugins import Discovery

from navloom_viewer.builtin_panels import BUILT_IN
from navloom_viewer.drawing import Shown
from navloom_viewer.drawing_task import ViewerOrder
from navloom_viewer.panels import Panel, panels_of
from navloom_viewer.viewer_errors import ViewerError, need_rerun

__all__ = ["Bridge", "BridgeCounts", "Wanted"]

CAPACITY = 4096
"""Most messages in the queue between the two processes."""
STARTED = 60.0
"""Longest startup of the child, s: a cold disk has to read half a gigabyte."""


@dataclass(frozen=True)
class BridgeCounts:
    """Numbers of messages drawn and dropped, and the state of the file.

    Attributes:
        drawn: Messages processed by the child.
        dropped: Messages dropped because the child had fallen behind.
        dropped_live: Shapes dropped because the viewer was too slow; the file has them.
        connections: Number of connections to a viewer.
        notes: Problems on the way, one line each.
        file_failure: Why the file is cut short; empty if it is whole.
        is_complete: Whether the child ended properly and the file holds everything that was put in.
    """

    drawn: int = 0
    dropped: int = 0
    dropped_live: int = 0
    connections: int = 0
    notes: tuple[str, ...] = ()
    file_failure: str = ""
    is_complete: bool = False


class Bridge:
    """The parent's side of the child process.

    Args:
        order: The child's task.
        capacity: Most messages that may wait for it.

    Raises:
        ViewerError: The viewer's extra is not installed, or the child does not start.
    """

    def __init__(self, order: ViewerOrder, capacity: int = CAPACITY) -> None:
        need_rerun()
        context = multiprocessing.get_context("spawn")
        self.dropped = self.put_in = 0
        self._new_file = order.file if order.file is not None and not order.file.exists() else None
        self._queue: Any = context.Queue(capacity)
        self._words, theirs = context.Pipe(duplex=False)
        self._wanted = Wanted((*BUILT_IN, *panels_of(Discovery(order.blocked))[0]))
        self.process = context.Process(
            target=_serve, args=(order, self._queue, theirs), name="navloom viewer bridge", daemon=True
        )
        self.process.start()
        theirs.close()

    def await_start(self) -> None:
        """Wait until the child has opened its file and is ready to draw. A child that does not start leaves no file.

        Raises:
            ViewerError: It cannot start; the text says why.
        """
        word: tuple[Any, ...] = ()
        try:
            word = self._hear(STARTED)
        finally:
            if word[:1] not in (("ready",), ("refused",)):
                self._abandon()
        if word == ("ready",):
            return
        if word[:1] == ("refused",):
            self.process.join(1.0)
            raise ViewerError(word[1])
        why = f": {word[1]}" if word else f" within {STARTED:g} s"
        raise ViewerError(f"the viewer's process does not start{why}")

    def put(self, shown: Shown) -> bool:
        """Queue one message without waiting; if the queue is full, the message is dropped and counted."""
        if not self._wanted.take(shown):
            return True
        try:
            self._queue.put_nowait(shown)
        except queue.Full:
            self.dropped += 1
            return False
        self.put_in += 1
        return True

    def put_all(self, shown: Shown) -> None:
        """Queue one message and wait for room: for runs without real-time constraints."""
        if not self._wanted.take(shown):
            return
        while self.process.is_alive():
            with contextlib.suppress(queue.Full):
                self._queue.put(shown, timeout=1.0)
                self.put_in += 1
                return
        self.dropped += 1

    def close(self, patience: float = 120.0) -> BridgeCounts:
        """Let the child finish, and return its counts. A child that does not end in time is killed."""
        if self.process.is_alive():
            with contextlib.suppress(queue.Full):
                self._queue.put(None, timeout=patience)
        word = self._hear(patience)
        if word == ("ready",):
            word = self._hear(patience)
        self.process.join(5.0)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self._queue.close()
        self._queue.cancel_join_thread()
        if word and word[0] == "done":
            drawn, dropped_live, connections, notes, failure = word[1:]
            is_complete = drawn == self.put_in and not failure
            return BridgeCounts(drawn, self.dropped, dropped_live, connections, notes, failure, is_complete)
        why = f"the viewer's process ended early: {word[1]}" if word else "the viewer's process did not end in time"
        return BridgeCounts(0, self.dropped, 0, 0, (why,), why, False)

    def _abandon(self) -> None:
        """Kill the child, and remove the file that it has begun."""
        self.process.kill()
        self.process.join()
        if self._new_file is not None:
            self._new_file.unlink(missing_ok=True)

    def _hear(self, patience: float) -> tuple[Any, ...]:
        limit = monotonic() + patience
        while monotonic() < limit:
            with contextlib.suppress(EOFError, OSError):
                if self._words.poll(0.1):
                    return tuple(self._words.recv())
            if not self.process.is_alive():
                with contextlib.suppress(EOFError, OSError):
                    if self._words.poll(0):
                        return tuple(self._words.recv())
                return ("gone", f"exit code {self.process.exitcode}")
        return ()


class Wanted:
    """Selects the messages to copy to the child: those that a panel draws, at the highest rate of these panels."""

    def __init__(self, panels: Sequence[Panel]) -> None:
        self._panels = panels
        self._rates: dict[type[Message], float] = {}
        self._last: dict[tuple[str, ...], int] = {}

    def take(self, shown: Shown) -> bool:
        """Whether to copy a message; a selected one counts for the rate."""
        kind = type(shown.message)
        if kind not in self._rates:
            rates = [panel.max_hz for panel in self._panels if issubclass(kind, panel.message)]
            self._rates[kind] = max(rates, default=0.0)
        rate = self._rates[kind]
        if rate == 0.0:
            return False
        key = (shown.variant, shown.role, shown.instance, shown.port)
        last = self._last.get(key)
        if last is not None and 0 <= shown.stamp_ns - last < 0.99e9 / rate:
            return False
        self._last[key] = shown.stamp_ns
        return True


def _serve(order: ViewerOrder, inbox: Any, words: Connection) -> None:
    from navloom_viewer.bridge_child import serve

    serve(order, inbox, words)
