"""One line with the progress of a drive: rewritten on a terminal, otherwise printed at intervals."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from typing import IO, Any

from navloom.inputs import printable

__all__ = ["LiveLine", "goal_line"]

LIMITING = ("obstacle", "unseen")
"""Limits of the gate's monitor that slow or stop the robot."""
STANDS = 0.05
"""Share of the commanded velocity below which the monitor lets nothing through that an operator would see."""
SPARSE = 5.0
"""Interval of lines of the same kind if the output is not a terminal, s."""


class LiveLine:
    """A line that is updated repeatedly.

    Args:
        stream: Stream that it is written to.
        clock: Monotonic time, s.
    """

    def __init__(self, stream: IO[str], clock: Callable[[], float] = time.monotonic) -> None:
        self._stream, self._clock = stream, clock
        self._is_terminal = stream.isatty()
        self._is_open = False
        self._last: tuple[str, float] | None = None

    def show(self, text: str, kind: str) -> None:
        """Show the line. Without a terminal, a change of `kind` prints it immediately."""
        text = printable(text)
        if self._is_terminal:
            print(f"\r\x1b[K{text[: shutil.get_terminal_size().columns - 1]}", end="", file=self._stream, flush=True)
            self._is_open = True
        elif self._last is None or kind != self._last[0] or self._clock() - self._last[1] >= SPARSE:
            self._last = kind, self._clock()
            print(text, file=self._stream, flush=True)

    def end(self) -> None:
        """End the line: the next print starts a new one."""
        if self._is_open:
            print(file=self._stream, flush=True)
        self._is_open = False


def goal_line(feedback: Any, gate: Any, speed: float | None) -> tuple[str, str]:
    """The progress of a goal on one line, and its kind: see `LiveLine`.

    Args:
        feedback: The goal's newest feedback.
        gate: The gate's newest status, or None.
        speed: Speed that the platform measures, m/s, or None.
    """
    from navloom.navigation.status_words import progress, what_limits, why_stopped

    way = progress(feedback)
    kind = f"{way.partition(',')[0]} {feedback.recoveries}"
    if gate is None:
        return way, kind
    why, remedy = why_stopped(gate, feedback)
    if remedy:
        return f"{way}; stopped: {why}; {remedy}", f"{kind} {why}"
    if why:
        return f"{way}; {why}", kind
    if way.startswith("planning"):
        return way, kind
    pace = f"by {gate.source}" if speed is None else f"{speed:z.2f} m/s by {gate.source}"
    way, kind = progress(feedback, pace), f"{kind} {gate.source}"
    if gate.limit not in LIMITING:
        return way, kind
    word = "blocked" if gate.share < STANDS else "slowed"
    return f"{way}; {word}: {what_limits(gate)}", f"{kind} {word} {gate.limit}"
