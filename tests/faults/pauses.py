"""Pauses of the machine itself: times in which a processor did not run even a real-time process.

A campaign's robot may be late because of navloom or because the machine stood still, as virtual machines do. A watcher
on each processor tells the two apart. `python pauses.py CPU FILE` is one watcher.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

__all__ = ["Pauses"]

PERIOD = 0.005
"""Interval between two looks of a watcher, s."""
SHORTEST = 0.01
"""Pauses are recorded from this length on, s, interval included."""


def watch(processor: int, path: Path) -> None:
    """Append the begin and the length of each pause of a processor to a file, ns of the monotonic clock.

    It ends with its parent process.
    """
    os.sched_setaffinity(0, {processor})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
    parent = os.getppid()
    with path.open("a", buffering=1) as file:
        before = time.monotonic_ns()
        file.write(f"{before} 0\n")
        while os.getppid() == parent:
            time.sleep(PERIOD)
            now = time.monotonic_ns()
            if now - before > SHORTEST * 1e9:
                file.write(f"{before} {now - before}\n")
            before = now


class Pauses:
    """Watchers of all processors.

    Args:
        folder: Folder of their files.
    """

    def __init__(self, folder: Path) -> None:
        self._paths = {number: folder / f"pauses{number}" for number in sorted(os.sched_getaffinity(0))}
        self._watchers: list[subprocess.Popen[bytes]] = []

    def start(self) -> None:
        """Start the watchers, without the robot's environment; without the right to real-time priority they end."""
        for number, path in self._paths.items():
            command = [sys.executable, __file__, str(number), str(path)]
            self._watchers.append(subprocess.Popen(command, env={}, stderr=subprocess.DEVNULL))

    def longest(self, begin_ns: int, end_ns: int) -> float | None:
        """Longest pause of a processor in an interval of the monotonic clock, s; None without watchers."""
        if not all(path.exists() for path in self._paths.values()):
            return None
        lines = (line.split() for path in self._paths.values() for line in path.read_text("ascii").splitlines())
        known = ((int(begin), int(length)) for begin, length in lines)
        met = (length for begin, length in known if begin_ns < begin + length and begin < end_ns)
        return max(met, default=0) * 1e-9

    def end(self) -> None:
        for watcher in self._watchers:
            watcher.kill()
            watcher.wait()


if __name__ == "__main__":
    watch(int(sys.argv[1]), Path(sys.argv[2]))
