"""Heartbeat of a node process in memory shared with its supervisor; it stops while a thread holds the GIL."""

from __future__ import annotations

import mmap
import os
import re
import resource
import sys
import time
from contextlib import suppress
from pathlib import Path

from navloom.kernel_progress import Kernels

from navloom_live.timing import HEART_CHECK_INTERVAL, STOPPED_GAP

__all__ = ["Heart", "HeartMonitor", "StopDetector"]

PAGE = mmap.PAGESIZE
FIGHTING = 5
"""Fewest wake-ups in that time of a thread that waits for the GIL: it tries every 0.5 ms. A stopped one has none."""
UNREAD = -1
"""Marks that no wake-ups were counted yet. They are read only while a heartbeat is missing, because reading them costs
more than the rest of the check."""


class Heart:
    """The process's side of the heartbeat: its main thread beats whenever it gets the GIL.

    Args:
        path: Path of the supervisor's memory.
    """

    def __init__(self, path: str) -> None:
        file = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        try:
            # Memory and no pipe: a beat costs no system call, and a reader that is late loses nothing.
            self._time = memoryview(mmap.mmap(file, PAGE)).cast("q")
        finally:
            os.close(file)

    def beat(self) -> None:
        """Write the time of a heartbeat."""
        self._time[0] = time.monotonic_ns()

    def note_compiled(self, kernels: Kernels) -> None:
        """Write how many kernels this process has compiled, a sign of life before the first beat."""
        self._time[1], self._time[2], self._time[3] = kernels


class HeartMonitor:
    """The supervisor's side of the heartbeat.

    Attributes:
        path: Path of the memory for the process's `Heart`; empty if the system has no such memory.
    """

    def __init__(self) -> None:
        self.path = ""
        if sys.platform == "linux":
            # In memory, so that a full disk stops no robot.
            self._file = os.memfd_create("heart", os.MFD_CLOEXEC)
            os.ftruncate(self._file, PAGE)
            self._time = memoryview(mmap.mmap(self._file, PAGE)).cast("q")
            self.path = f"/proc/{os.getpid()}/fd/{self._file}"
        self._last, self._switches = 0, UNREAD
        self._looked = self._silent = 0.0

    def reset(self) -> None:
        """Prepare the memory for another process, which has not beaten yet."""
        if self.path:
            self._time[0] = self._time[1] = self._time[2] = self._time[3] = 0
        self._silent = 0.0

    @property
    def has_beaten(self) -> bool:
        """Whether the process has been ready since `reset`; True if the system cannot tell."""
        return not self.path or self._time[0] != 0

    @property
    def kernels(self) -> Kernels:
        """The kernels of the process; none until it compiles one, or if the system cannot tell."""
        return Kernels(*self._time[1:4]) if self.path else Kernels()

    def close(self) -> None:
        """Free the memory."""
        if self.path:
            self._time.release()
            os.close(self._file)
            self.path = ""

    def silence(self, pid: int) -> float:
        """How long the process's main thread has waited for the GIL without a beat, s.

        Only time in which the process ran counts, so that a process or host that was stopped does not count as hanging.
        """
        now = time.monotonic()
        if not self.path or now - self._looked < HEART_CHECK_INTERVAL:
            return self._silent
        # The supervisor itself may have been stopped: that time says nothing about the process.
        spent, self._looked = min(now - self._looked, 2 * HEART_CHECK_INTERVAL), now
        beat, before = self._time[0], self._switches
        # No beat yet: the process still loads its plugins.
        if beat != self._last or not beat:
            self._last, self._silent, self._switches = beat, 0.0, UNREAD
            return 0.0
        self._switches = _switches(pid)
        # A main thread that never wakes was stopped, or sleeps in a system call without the GIL.
        if before != UNREAD and self._switches - before >= FIGHTING:
            self._silent += spent
        return self._silent


class StopDetector:
    """Detects that the whole process was stopped for a while, as opposed to a thread that waited for the GIL."""

    def __init__(self) -> None:
        self._before, self._switches = time.monotonic_ns(), _own_switches()
        self._went_on_ns = 0

    def look(self) -> int:
        """When the process continued after its last stop, ns, monotonic clock; 0 for never."""
        now, switches = time.monotonic_ns(), _own_switches()
        # Late without having tried for the GIL: nobody ran.
        if now - self._before > STOPPED_GAP * 1e9 and switches - self._switches < FIGHTING:
            self._went_on_ns = now
        self._before, self._switches = now, switches
        return self._went_on_ns


def _own_switches() -> int:
    who = resource.RUSAGE_THREAD if sys.platform == "linux" else resource.RUSAGE_SELF
    return resource.getrusage(who).ru_nvcsw


def _switches(pid: int) -> int:
    """Voluntary context switches of a process's main thread; 0 if it has just ended."""
    with suppress(OSError, TypeError):
        status = Path(f"/proc/{pid}/status").read_text("utf-8", "replace")
        return int(re.search(r"^voluntary_ctxt_switches:\s*(\d+)", status, re.MULTILINE)[1])  # type: ignore[index]
    return 0
