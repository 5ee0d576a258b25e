"""Collects the warnings of a live robot's processes, each once."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable
from types import TracebackType

from navloom.engine.run_warnings import RunWarning
from navloom.entry_kinds import TRACEBACK

from navloom_live.transport.keyspace import KeySpace
from navloom_live.transport.zenoh_bus import Bus

__all__ = ["LiveWarnings"]

WARNING_QUERY_INTERVAL = 5.0
"""Interval of queries, s."""
ANSWER_WAIT = 1.0
"""Longest wait for the answers, s; a hanging process gives none."""


class LiveWarnings:
    """Queries the processes at intervals, on a separate thread, within a `with` statement.

    Args:
        bus, keys: Session and key space of the robot.
        say: Receives each new warning.
    """

    def __init__(self, bus: Bus, keys: KeySpace, say: Callable[[str], None] = lambda text: None) -> None:
        self._bus, self._keys, self._say = bus, keys, say
        self._found: dict[tuple[str, ...], RunWarning] = {}
        self._ended, self._asking = threading.Event(), threading.Lock()
        self._thread = threading.Thread(target=self._run, name="warnings", daemon=True)

    def __enter__(self) -> LiveWarnings:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join(2 * ANSWER_WAIT)

    def look(self) -> list[RunWarning]:
        """Query once, report new warnings, and return all so far."""
        with self._asking:
            for answer in self._bus.ask(self._keys.process("*", "warnings"), timeout=ANSWER_WAIT):
                for given in [] if answer.refusal else json.loads(answer.data or b"[]"):
                    one = RunWarning.from_json(given)
                    key = (one.kind, one.role, one.instance, one.about)
                    if key not in self._found:
                        self._found[key] = one
                        self._say(f"warning: {one}")
            return list(self._found.values())

    def traceback_of(self, fault: str) -> str:
        """The traceback of a fault, from the process of the node; empty if none was kept."""
        if os.environ.get(TRACEBACK):
            for answer in self._bus.ask(self._keys.process("*", "tracebacks"), timeout=ANSWER_WAIT):
                kept: dict[str, str] = {} if answer.refusal else json.loads(answer.data or b"{}")
                if fault in kept:
                    return kept[fault]
        return ""

    def _run(self) -> None:
        while not self._ended.wait(WARNING_QUERY_INTERVAL):
            self.look()
