"""Observes the side effects of a plugin from within its process: clocks, files, processes, threads.

Only the process of `navloom_check.worker` installs this, before it imports the plugin.
"""

from __future__ import annotations

import _thread
import faulthandler
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import PurePath
from types import FrameType
from typing import IO, Any, NamedTuple

__all__ = ["GUARD", "TIMEOUT", "Deed", "Guard"]

CLOCKS = ("time", "time_ns", "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "process_time",
          "process_time_ns")  # fmt: skip
KINDS = {
    "os.fork": "process", "os.forkpty": "process", "os.posix_spawn": "process", "os.system": "process",
    "os.exec": "process", "subprocess.Popen": "process",
    "socket.connect": "socket", "socket.bind": "socket", "socket.getaddrinfo": "socket", "socket.__new__": "socket",
    "socket.gethostname": "socket", "open": "file",
    "os.remove": "file", "os.rename": "file", "os.mkdir": "file", "os.truncate": "file",
}  # fmt: skip
"""Audit events of the interpreter that no verb needs, and the kind of side effect that each shows."""
LOADERS = ("importlib", "_frozen_importlib", "_frozen_importlib_external", "numba", "zipimport", "linecache")
"""Importers, compilers and printers of warnings: files that they open are not opened by the plugin."""
DOORS = ("os", "collections.abc", "_collections_abc")
"""Modules that only pass on a lookup in the environment."""
MOST_DEEDS = 100
TIMEOUT = signal.SIGALRM
"""Signal that ends a process whose plugin does not return."""


class Deed(NamedTuple):
    """A side effect of a call into a plugin: its kind, a description, and the plugin's file and line, if known."""

    kind: str
    text: str
    place: str


class Guard:
    """Watches the calls into a plugin.

    Attributes:
        deeds: Side effects so far; a check clears the list before it observes.
        opened: Paths that a call tried to open, whether they exist or not; a check clears the list, too.
        imported: Lookups in the environment while plugins were imported, each with the name of the module that did it.
        limit: Longest call, s; 0 for none.
    """

    def __init__(self) -> None:
        self.deeds: list[Deed] = []
        self.opened: list[str] = []
        self.imported: list[tuple[str, Deed]] = []
        self._is_importing = False
        self.is_own: Callable[[str], bool] = lambda module: False
        self.mark: Callable[[str], None] = lambda text: None
        self.limit = 0.0
        self._depth = 0
        self._shift: tuple[float, float] | None = None
        self._readings = 0

    def install(self, crash_file: IO[str]) -> None:
        """Put the hooks in place, for the rest of the process."""
        faulthandler.enable(crash_file)
        # A system timer, since a watchdog thread could not run while a plugin holds the GIL.
        faulthandler.register(TIMEOUT, crash_file, all_threads=False, chain=True)
        sys.addaudithook(self._on_event)
        # Before Python 3.12, a new thread raises no audit event: each thread of `threading` begins with this function.
        threading.setprofile(self._on_thread)
        os.register_at_fork(after_in_child=lambda: os._exit(0))  # a fork would run the checks a second time
        for name in CLOCKS:
            # A clock raises no audit event, and whether it leads the answers shows only if it shows another time.
            setattr(time, name, _wrapped(self, name, getattr(time, name)))
        variables: Any = type(os.environ)
        read = variables.__getitem__

        def read_variable(mapping: Any, name: str) -> str:
            self._note_variable(name)
            return str(read(mapping, name))

        # Reading a variable raises no audit event either: only the mapping itself can tell.
        variables.__getitem__ = read_variable

    @contextmanager
    def within(self, what: str, limit: float = 0.0) -> Iterator[None]:
        """A call into the plugin. After `limit`, s (0: the usual limit), the process writes where it hangs and ends."""
        limit = limit or self.limit
        self.mark(what)
        threads = _thread._count()
        self._depth += 1
        if limit:
            signal.setitimer(signal.ITIMER_REAL, limit)
        try:
            yield
        finally:
            if limit:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
            self._depth -= 1
            if _thread._count() > threads:
                self._keep(Deed("thread", what, ""))  # one that `threading` does not know
            self.mark("")

    @contextmanager
    def importing(self) -> Iterator[None]:
        """The import of a plugin, whose modules are not known yet."""
        self._is_importing = True
        try:
            yield
        finally:
            self._is_importing = False

    @contextmanager
    def clock(self, start: float, pace: float) -> Iterator[None]:
        """Show the plugin a clock that begins at `start`, s, and advances by `pace`, s, with each reading."""
        self._shift, self._readings = (start, pace), 0
        try:
            yield
        finally:
            self._shift = None

    def _on_event(self, event: str, given: tuple[Any, ...]) -> None:
        if not self._depth or event not in KINDS:
            return
        kind = KINDS[event]
        if event == "open" and isinstance(given[0], (str, bytes, os.PathLike)) and len(self.opened) < MOST_DEEDS:
            self.opened.append(os.fsdecode(given[0]))
        if event == "open" and not _writes(given):
            kind = "environment" if _is_relative(given[0]) else "read"
        place = self._own_place(sys._getframe(1))
        if place:
            self._keep(Deed(kind, f"{event} {_short(given)}".strip(), place))

    def _on_thread(self, frame: FrameType, event: str, given: Any) -> None:
        sys.setprofile(None)
        if self._depth:
            self._keep(Deed("thread", threading.current_thread().name, ""))

    def _keep(self, deed: Deed) -> None:
        """Keep the first side effects, each once: a growing list would disturb the memory check."""
        if len(self.deeds) < MOST_DEEDS and deed not in self.deeds:
            self.deeds.append(deed)

    def _own_place(self, frame: FrameType | None) -> str:
        """The plugin's line that a call comes from; empty if it comes from an import or a compiler."""
        while frame is not None:
            module = _module_of(frame)
            if module.partition(".")[0] in LOADERS:
                return ""
            if self.is_own(module):
                return _line_of(frame)
            frame = frame.f_back
        return ""

    def _read_clock(self, name: str, real: Callable[[], Any]) -> Any:
        if not self._depth:
            return real()
        caller = sys._getframe(2)
        if not self.is_own(_module_of(caller)):
            return real()
        self._keep(Deed("clock", name, _line_of(caller)))
        if self._shift is None:
            return real()
        self._readings += 1
        start, pace = self._shift
        seconds = start + self._readings * pace
        return round(seconds * 1e9) if name.endswith("_ns") else seconds

    def _note_variable(self, name: str) -> None:
        """Keep a lookup in the environment if the plugin's own code makes it, not a library."""
        if not (self._depth or self._is_importing):
            return
        frame: FrameType | None = sys._getframe(2)
        while frame is not None and _module_of(frame) in DOORS:
            frame = frame.f_back
        if frame is None:
            return
        deed = Deed("environment", f"the environment variable {name}", _line_of(frame))
        if self._is_importing:
            self.imported.append((_module_of(frame), deed))
        elif self.is_own(_module_of(frame)):
            self._keep(deed)


def _module_of(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__", ""))


def _line_of(frame: FrameType) -> str:
    return f"{PurePath(frame.f_code.co_filename).name}:{frame.f_lineno}"


def _wrapped(guard: Guard, name: str, real: Callable[[], Any]) -> Callable[[], Any]:
    return lambda: guard._read_clock(f"time.{name}", real)


def _writes(given: tuple[Any, ...]) -> bool:
    """Whether an `open` event is for writing; its mode is None where `os.open` was called, with flags."""
    _, mode, flags = given
    if isinstance(mode, str):
        return any(letter in mode for letter in "wax+")
    return bool(isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))


def _is_relative(path: Any) -> bool:
    """Whether a path is relative to the working folder."""
    if not isinstance(path, (str, bytes, os.PathLike)):
        return False
    return not os.fsdecode(path).startswith("/")


def _short(given: tuple[Any, ...]) -> str:
    return str(given[0])[:80] if given and isinstance(given[0], (str, bytes)) else ""


GUARD = Guard()
"""The guard of this process; without `install` it only counts calls."""
