"""Times ours and a peer in one run: blocks in turn, medians, and the quartiles of their ratios.

Shared by all entries. `Peer` is the software that ours is compared with; `Child` is a peer in another process.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import statistics
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any

from navloom import NavloomError

__all__ = ["Block", "Child", "Effort", "Peer", "PeerError", "Row", "paired", "peer_module", "timed"]

Block = Callable[[], float]
"""Does a block of work; returns the time of one operation, s."""
END = 8.0
"""Longest wait for a process to end by itself, s."""


class PeerError(NavloomError, RuntimeError):
    """A peer that is not installed or does not work; the text names it and the fix."""

    exit_code = 1


@dataclass(frozen=True)
class Effort:
    """How much is measured.

    Attributes:
        rounds: Number of blocks of each side.
        is_quick: Use small inputs and short blocks, to see that everything works.
    """

    rounds: int
    is_quick: bool

    def size(self, whole: int, quick: int) -> int:
        """`whole` for a full measurement, `quick` for a quick one."""
        return quick if self.is_quick else whole


@dataclass(frozen=True)
class Row:
    """A row of the result: one operation, ours and the peer's.

    Attributes:
        name: What was measured.
        ours: Median of our blocks, in `unit`.
        unit: Unit of the durations, of one operation.
        peer: Name of the peer.
        theirs: Median of the peer's blocks, in `unit`; None if it could not be measured.
        ratio: Theirs / ours, median over the rounds: how many times as fast ours is.
        low, high: Quartiles of the rounds' ratios.
        note: What a reader should know about the figures.
    """

    name: str
    ours: float
    unit: str
    peer: str
    theirs: float | None
    ratio: float | None
    low: float | None
    high: float | None
    note: str


UNITS = {"s": 1.0, "ms": 1e3, "µs": 1e6, "ns": 1e9}
"""Units of durations in one second."""


@dataclass(frozen=True)
class Peer:
    """What ours is compared with.

    Attributes:
        name: Its name in the table.
        block: Its block of work; None if it cannot be measured.
        absence: Why it cannot be measured.
    """

    name: str
    block: Block | None = None
    absence: str = ""


def timed(call: Callable[[], object], count: int) -> Block:
    """A block of `count` calls, timed by the CPU time of this thread, so that other processes do not count."""

    def block() -> float:
        began = time.thread_time()
        for _ in range(count):
            call()
        return (time.thread_time() - began) / count

    return block


def paired(name: str, unit: str, ours: Block, peer: Peer, rounds: int, note: str = "") -> Row:
    """Time blocks of both sides in turn; the order alternates from round to round, and the first block is not counted.

    Args:
        name, unit, note: Of the row.
        ours: Our block.
        peer: The other side; if it is absent, only ours is timed.
        rounds: Number of blocks of each side.
    """
    scale, theirs = UNITS[unit], peer.block
    ours()
    if theirs is None:
        middle = statistics.median(ours() for _ in range(rounds))
        note = "; ".join(text for text in (peer.absence, note) if text)
        return Row(name, middle * scale, unit, peer.name, None, None, None, None, note)
    theirs()
    pairs: list[tuple[float, float]] = []
    for number in range(rounds):
        if number % 2:
            second = theirs()
            pairs.append((ours(), second))
        else:
            pairs.append((ours(), theirs()))
    low, ratio, high = _quartiles([b / a for a, b in pairs])
    first, second = (statistics.median(side) * scale for side in zip(*pairs, strict=True))
    return Row(name, first, unit, peer.name, second, ratio, low, high, note)


def _quartiles(values: Sequence[float]) -> tuple[float, float, float]:
    if len(values) < 2:
        return values[0], values[0], values[0]
    low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
    return low, middle, high


def peer_module(module: str, distribution: str) -> Any:
    """Import a peer's module by name, since peers are not dependencies.

    Raises:
        PeerError: It is not installed.
    """
    try:
        return import_module(module)
    except ImportError:
        raise PeerError(f"{distribution} is not installed: pip install {distribution}") from None


class Child:
    """A process that answers each line with a line of JSON. Use it in a `with` statement.

    Args:
        name: Its name in error messages.
        command: Command line; the first line that it prints, JSON, says that it is ready (`hello`).
        folder: Its working directory, which also gets its log.
        patience: Longest wait for a line, s.

    Raises:
        PeerError: It cannot be started, or ends before it is ready.
    """

    def __init__(self, name: str, command: Sequence[str], folder: Path, patience: float = 60.0) -> None:
        self._name, self._patience = name, patience
        self._log = folder / f"{name.replace(' ', '-')}.log"
        try:
            with self._log.open("w") as log:
                self._process = subprocess.Popen(
                    command, cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True,
                    start_new_session=True,
                )  # fmt: skip
        except OSError as error:
            raise PeerError(f"{name}: {command[0]}: {error.strerror}") from None
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=self._read, daemon=True).start()
        try:
            self.hello = self._line()
        except PeerError:
            self.close()
            raise

    def ask(self, value: Any) -> Any:
        """Send a value and return the answer. Raises PeerError if none comes."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # if it has ended, reading its output tells so
            self._process.stdin.write(json.dumps(value) + "\n")
            self._process.stdin.flush()
        return self._line()

    def __enter__(self) -> Child:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close its input, so that it ends; kill it if it does not."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        try:
            self._process.wait(END)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                self._lines.put(line)
        self._lines.put("")

    def _line(self) -> Any:
        try:
            line = self._lines.get(timeout=self._patience)
        except queue.Empty:
            raise PeerError(f"{self._name}: no answer within {self._patience:g} s") from None
        if not line:
            said = [text for text in self._log.read_text("utf-8").splitlines() if text.strip()]
            raise PeerError(f"{self._name} ended: {said[-1] if said else 'without a message'}")
        return json.loads(line)
