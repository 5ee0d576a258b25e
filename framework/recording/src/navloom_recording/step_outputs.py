"""Finds the messages that a recorded step published, by the sequence numbers in its record."""

from __future__ import annotations

from collections import defaultdict

from navloom_recording.message_cache import Entry, Shelf
from navloom_recording.step_inputs import Step
from navloom_recording.step_replay import Replayer, Stepped

__all__ = ["Outcomes"]


class Outcomes:
    """Finds the messages of each step. Call it for every step of a node in order, also those without messages.

    Args:
        replayer: Replayer of the recording.
    """

    def __init__(self, replayer: Replayer) -> None:
        self._prefix = replayer.header.prefix
        self._marks: dict[tuple[str, str], dict[str, int]] = {}
        self._published: defaultdict[tuple[str, str, str], int] = defaultdict(int)
        recorded = replayer.header.loaded().config
        self._delayed = {(role, table.instance) for _, role, table in recorded.role_tables() if table.latency > 0.0}

    def numbers(self, stepped: Stepped, counts: dict[str, int]) -> dict[str, range]:
        """Sequence numbers of the messages that a step published, by port.

        Args:
            stepped: The step.
            counts: Assumed number of messages by port, for steps whose records do not tell: the first record of a node
                that started before the recording, a record after a gap, and all records of a node with latency, whose
                messages are sent later.
        """
        step = stepped.step
        source = (step.role, step.instance)
        marks = {mark.port: mark.sequence for mark in step.report.published}
        before = self._marks.get(source, {}) if stepped.follows else None
        self._marks[source] = marks
        found = {}
        for port, count in counts.items():
            last = marks.get(port, 0)
            # Their marks are of messages that were sent later than the step that made them.
            if source in self._delayed:
                first = self._published[*source, port]
                last = self._published[*source, port] = first + (count if step.report.trigger else 0)
            else:
                first = max(0, last - count) if before is None else before.get(port, 0)
            found[port] = range(first + 1, last + 1)
        return found

    def entry(self, step: Step, port: str, number: int, shelf: Shelf) -> Entry | None:
        """One of these messages; None if the recording lacks it."""
        return shelf.get(f"{self._prefix}/{step.role}/{step.instance}/{port}", number, step.place)
