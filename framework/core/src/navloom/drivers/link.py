"""A device behind a port: one thread reads it, sends heartbeats, and reconnects."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from navloom.drivers.ports import Port
from navloom.errors import NavloomError

__all__ = ["DriverError", "Link"]

RETRY_FIRST, RETRY_MOST = 0.05, 1.0
"""First and longest pause between attempts to open, s; the pause doubles from one to the other."""
SLICE = 0.05
"""Longest wait of one read, s, and so the longest delay before the thread ends."""
WRITE = 0.02
"""Longest wait for a device to accept a write, s: a command must not block the platform's loop."""
JOIN = 1.0
"""Longest wait for the thread to end, s."""


class DriverError(NavloomError, RuntimeError):
    """The device cannot be used now; the text says why, and becomes part of the gate's reason."""

    exit_code = 1


class Link:
    """Reads a device in a separate thread. After any failure the port is closed, and reopened after a pause.

    Args:
        name: Name of the device in errors, as "base at /dev/ttyUSB0".
        open_port: Opens the port; raises OSError on failure.
        received: Called in the thread with the bytes read and the monotonic time, ns. An exception is a fault of the
            driver: the port is reopened, and `fault` reports it.
        opened: Called in the thread after the port was opened, to discard partial input.
        beat: Called in the thread every `beat_period` while the port is open, for example to repeat a command.
        beat_period: Interval of `beat`, s; at least 0.001.
        silence: Time without a byte after which the port is reopened, s: some adapters fail without an error.

    Attributes:
        openings: Number of times the port was opened.
    """

    def __init__(
        self,
        name: str,
        open_port: Callable[[], Port],
        received: Callable[[bytes, int], None],
        *,
        opened: Callable[[], None] = lambda: None,
        beat: Callable[[], None] = lambda: None,
        beat_period: float = SLICE,
        silence: float = 1.0,
    ) -> None:
        self.name, self.openings = name, 0
        self._open_port, self._received, self._opened, self._beat = open_port, received, opened, beat
        self._beat_period, self._silence = max(0.001, beat_period), silence
        self._port: Port | None = None
        self._fault = "not opened yet"
        self._lock = threading.Lock()
        self._ends = threading.Event()
        # A daemon: a read that hangs must not keep the process from ending.
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Start to open and read the port. Call it once."""
        self._thread.start()

    @property
    def is_started(self) -> bool:
        """Whether `start` was called."""
        return self._thread.ident is not None

    @property
    def fault(self) -> str:
        """Why the device cannot be reached; empty while its port is open."""
        return f"{self.name}: {self._fault}" if self._fault else ""

    def write(self, data: bytes) -> None:
        """Send all of the data, from any thread. Raises DriverError if the device is gone or does not accept it."""
        with self._lock:
            if self._port is None:
                raise DriverError(self.fault)
            try:
                self._port.write(data, WRITE)
            except OSError as error:
                raise DriverError(f"{self.name}: {_words(error)}") from None

    def close(self) -> None:
        """End the thread and close the port, within a second."""
        self._ends.set()
        if self.is_started:
            # With a limit: a driver in the kernel may hang for good.
            self._thread.join(JOIN)
        self._leave("closed")

    def _run(self) -> None:
        pause = RETRY_FIRST
        while not self._ends.is_set():
            try:
                port = self._open_port()
            except (OSError, ValueError) as error:
                self._fault = f"cannot be opened: {_words(error)}"
            else:
                began = time.monotonic()
                why = self._serve(port)
                self._leave(why)
                # A port that opens and fails at once must not be tried in a tight loop.
                pause = RETRY_FIRST if time.monotonic() - began > self._silence else pause
            self._ends.wait(pause)
            pause = min(2.0 * pause, RETRY_MOST)

    def _serve(self, port: Port) -> str:
        """Read until a failure, and return its reason."""
        with self._lock:
            self._port, self._fault, self.openings = port, "", self.openings + 1
        try:
            self._opened()
            heard = due = time.monotonic()
            while not self._ends.is_set():
                now = time.monotonic()
                if now >= due:
                    # Beats that were missed are not caught up.
                    due = max(due + self._beat_period, now)
                    self._beat()
                data = port.read(min(SLICE, max(0.0, due - time.monotonic())))
                now_ns = time.monotonic_ns()
                if data:
                    heard = now_ns * 1e-9
                    self._received(data, now_ns)
                elif now_ns * 1e-9 - heard > self._silence:
                    return f"nothing came for {self._silence:g} s"
        except OSError as error:
            return f"lost: {_words(error)}"
        except DriverError as error:  # a heartbeat that could not be written
            return str(error).removeprefix(f"{self.name}: ")
        except Exception as error:  # a bug in the driver must not end its only reader
            return f"the driver failed: {type(error).__name__}: {error}"
        return "closed"

    def _leave(self, why: str) -> None:
        with self._lock:
            port, self._port, self._fault = self._port, None, why
        if port is not None:
            port.close()


def _words(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
