"""How `wire` controls the processes of its peers: each joins a socket and exchanges lines of JSON.

It imports only the standard library, because a peer may run under another interpreter. An *end* is one such process.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["PATIENCE", "Driver", "Lost", "PeerError", "Trip", "as_the_runtime_does", "serve_trips", "wait_for_the_end"]

PATIENCE = 2.0
"""Longest wait for an answer, s; then the trip counts as lost."""
NICE = -10
"""Priority of control processes in the live runtime; all peers get the same."""
SWITCH = 0.0005
"""Time between switches of Python threads in the live runtime, s."""

Trip = Callable[[str], int]
"""Makes one round trip of the message with a name; returns the time it took, ns. Raises Lost."""


class Lost(Exception):
    """A message or its answer never came."""


class PeerError(RuntimeError):
    """A peer that cannot be measured; the message says why."""


class Driver:
    """Connection by which the ends report and receive orders. Use it in a `with` statement.

    Args:
        path: Path of the socket to create.
    """

    def __init__(self, path: Path) -> None:
        self._listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listening.bind(str(path))
        self._listening.listen()
        self._lines: dict[str, Any] = {}

    def __enter__(self) -> Driver:
        return self

    def __exit__(self, *_: object) -> None:
        """Stop all ends."""
        for line in self._lines.values():
            with contextlib.suppress(OSError):
                line.close()
        self._listening.close()

    def wait_for(self, end: str, timeout: float, is_alive: Callable[[], bool]) -> None:
        """Wait until an end of this name has reported.

        Raises:
            PeerError: It has not within `timeout` s, or its process has ended.
        """
        limit = time.monotonic() + timeout
        while end not in self._lines:
            self._listening.settimeout(0.2)
            try:
                connection, _ = self._listening.accept()
            except TimeoutError:
                if not is_alive() or time.monotonic() > limit:
                    why = f"did not start within {timeout:g} s" if is_alive() else "ended before it was ready"
                    raise PeerError(f"{end} {why}") from None
                continue
            line = connection.makefile("rw", encoding="utf-8")
            self._lines[line.readline().strip()] = line
            connection.close()

    def trips(self, end: str, name: str, count: int) -> list[int | None]:
        """Have an end make round trips; returns the time of each, ns, None for a lost one.

        Raises:
            PeerError: It failed, or has ended.
        """
        line = self._lines[end]
        try:
            line.write(json.dumps([name, count]) + "\n")
            line.flush()
            found = json.loads(line.readline() or '"it is gone"')
        except OSError as error:
            found = str(error)
        if isinstance(found, str):
            raise PeerError(f"{end}: {found}")
        return list(found)


def as_the_runtime_does() -> None:
    """Set the priority and thread switching of a control process, the same for every peer."""
    sys.setswitchinterval(SWITCH)
    with contextlib.suppress(OSError):  # only root may raise its priority
        os.setpriority(os.PRIO_PROCESS, 0, NICE)


def serve_trips(path: str, end: str, trip: Trip) -> None:
    """Make the requested round trips until the benchmark ends."""
    with _report(path, end) as line:
        for asked in line:
            name, count = json.loads(asked)
            try:
                found: Any = [_one(trip, name) for _ in range(count)]
            except Exception as error:
                found = f"{type(error).__name__}: {error}"
            line.write(json.dumps(found) + "\n")
            line.flush()


def wait_for_the_end(path: str, end: str) -> None:
    """Report, then wait until the benchmark ends."""
    with _report(path, end) as line:
        line.read()


def _one(trip: Trip, name: str) -> int | None:
    try:
        return trip(name)
    except Lost:
        return None


def _report(path: str, end: str) -> Any:
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    connection.connect(path)
    line = connection.makefile("rw", encoding="utf-8")
    connection.close()
    line.write(end + "\n")
    line.flush()
    return line
