"""Observes the side effects of a plugin from within its process: clocks, files, processes, threads.

Only the process of `navloom_check.worker` installs this, before it imports the plugin.
"""

from __future__ import annotations

import _thread
import datetime
import faulthandler
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import PurePath
from types import FrameType
from typing import IO, Any, NamedTuple

__all__ = ["GUARD", "Deed", "Guard"]

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

DOORS = ("os", "pathlib", "posixpath", "genericpath", "collections.abc")
"""Modules that only pass on a lookup in the environment or of a path."""
MOST_DEEDS = 100


class Deed(NamedTuple):
    """A side effect of a call into a plugin: its kind, a description, and the plugin's file and line."""

    kind: str
    text: str
    place: str


class Guard:
    """Watches the calls into a plugin.

    Attributes:
        deeds: Side effects so far; a check clears the list before it observes.
        opened: Paths that a call tried to open, whether they exist or not; a check clears the list, too.
        imported: Lookups in the environment while plugins were imported, each with the name of the module that did it.
    """

    def __init__(self) -> None:
        self.deeds: list[Deed] = []
        self.opened: list[str] = []
        self.imported: list[tuple[str, Deed]] = []
        self._is_importing = False
        self.is_own: Callable[[str], bool] = lambda module: False
        self.mark: Callable[[str], None] = lambda text: None
        self.crash_file: IO[str] | None = None
        self.limit = 0.0
        self._depth = 0
        self._shift: tuple[float, float] | None = None
        self._readings = 0

    def install(self, crash_file: IO[str]) -> None:
        """Put the hooks in place, for the rest of the process."""
        self.crash_file = crash_file
        faulthandler.enable(crash_file)
        sys.addaudithook(self._on_event)
        os.register_at_fork(after_in_child=lambda: os._exit(0))  # a fork would run the checks a second time
        self._wrap_clocks()
        self._wrap_exit()
        self._wrap_threads()
        self._wrap_environment()

    @contextmanager
    def within(self, what: str, limit: float = 0.0) -> Iterator[None]:
        """A call into the plugin. After `limit`, s (0: the usual limit), the process writes where it hangs and ends."""
        limit = limit or self.limit
        self.mark(what)
        self._depth += 1
        if limit and self.crash_file is not None:
            faulthandler.dump_traceback_later(limit, exit=True, file=self.crash_file)
        try:
            yield
        finally:
            if limit and self.crash_file is not None:
                faulthandler.cancel_dump_traceback_later()
            self._depth -= 1
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

    def _keep(self, deed: Deed) -> None:
        """Keep the first side effects, each once: a growing list would disturb the memory check."""
        if len(self.deeds) < MOST_DEEDS and deed not in self.deeds:
            self.deeds.append(deed)

    def _own_place(self, frame: FrameType | None) -> str:
        """The plugin's line that a call comes from; empty if it comes from an import or a compiler."""
        while frame is not None:
            module = str(frame.f_globals.get("__name__", ""))
            if module.partition(".")[0] in LOADERS:
                return ""
            if self.is_own(module):
                return f"{PurePath(frame.f_code.co_filename).name}:{frame.f_lineno}"
            frame = frame.f_back
        return ""

    def _read_clock(self, name: str, real: Callable[[], Any]) -> Any:
        if not self._depth:
            return real()
        caller = sys._getframe(2)
        if not self.is_own(str(caller.f_globals.get("__name__", ""))):
            return real()
        self._keep(Deed("clock", name, f"{PurePath(caller.f_code.co_filename).name}:{caller.f_lineno}"))
        if self._shift is None:
            return real()
        self._readings += 1
        start, pace = self._shift
        seconds = start + self._readings * pace
        return round(seconds * 1e9) if name.endswith("_ns") else seconds

    def _wrap_clocks(self) -> None:
        for name in CLOCKS:
            setattr(time, name, _wrapped(self, name, getattr(time, name)))
        setattr(datetime, "datetime", _shifted_datetime(self))  # noqa: B010  (a plain assignment is a type error)

    def _wrap_threads(self) -> None:
        start = threading.Thread.start

        def started(thread: threading.Thread) -> None:
            if self._depth and (place := self._own_place(sys._getframe(1))):
                self._keep(Deed("thread", f"Thread {thread.name!r}", place))
            start(thread)

        setattr(threading.Thread, "start", started)  # noqa: B010  (a plain assignment is a type error)
        start_new = _thread.start_new_thread

        def started_new(*given: Any, **named: Any) -> int:
            if self._depth and (place := self._own_place(sys._getframe(1))):
                self._keep(Deed("thread", "_thread.start_new_thread", place))
            return start_new(*given, **named)

        _thread.start_new_thread = started_new

    def _wrap_environment(self) -> None:
        """Observe a plugin's use of the environment and the working folder; that of libraries does not count."""
        variables: Any = type(os.environ)
        read, look, where = variables.__getitem__, os.stat, os.getcwd

        def read_variable(all_of: Any, name: str) -> str:
            self._ask(f"the environment variable {name}")
            value: str = read(all_of, name)
            return value

        def look_at(path: Any, *given: Any, **named: Any) -> os.stat_result:
            if self._depth and _is_relative(path):
                self._ask(f"the file {os.fspath(path)!r} of the working folder")
            return look(path, *given, **named)

        def ask_where() -> str:
            self._ask("the working folder")
            return where()

        for those in (os.supports_dir_fd, os.supports_fd, os.supports_follow_symlinks):
            those.add(look_at)
        variables.__getitem__, os.stat, os.getcwd = read_variable, look_at, ask_where

    def _ask(self, what: str) -> None:
        """Keep a lookup if the plugin's own code makes it."""
        if not (self._depth or self._is_importing):
            return
        frame: FrameType | None = sys._getframe(2)
        while frame is not None and frame.f_globals.get("__name__") in DOORS:
            frame = frame.f_back
        if frame is None:
            return
        module = str(frame.f_globals.get("__name__", ""))
        deed = Deed("environment", what, f"{PurePath(frame.f_code.co_filename).name}:{frame.f_lineno}")
        if self._is_importing:
            self.imported.append((module, deed))
        elif self.is_own(module):
            self._keep(deed)

    def _wrap_exit(self) -> None:
        leave = os._exit

        def exit_at_once(status: int) -> None:
            if self._depth and self.crash_file is not None:
                faulthandler.dump_traceback(self.crash_file, all_threads=False)
                self.crash_file.flush()
            leave(status)

        os._exit = exit_at_once  # type: ignore[assignment]


def _wrapped(guard: Guard, name: str, real: Callable[[], Any]) -> Callable[[], Any]:
    def read() -> Any:
        return guard._read_clock(f"time.{name}", real)

    return read


def _shifted_datetime(guard: Guard) -> type:
    """A datetime class whose `now`, `utcnow` and `today` read the guard's clock."""
    real: Any = datetime.datetime

    class _Kind(type(real)):  # type: ignore[misc]
        def __instancecheck__(cls, one: object) -> bool:
            return isinstance(one, real)

    class Shifted(real, metaclass=_Kind):  # type: ignore[misc]
        @classmethod
        def now(cls, tz: Any = None) -> Any:
            return real.fromtimestamp(guard._read_clock("datetime.now", real.now().timestamp), tz)

        @classmethod
        def utcnow(cls) -> Any:
            stamp = guard._read_clock("datetime.utcnow", real.now().timestamp)
            return real.fromtimestamp(stamp, datetime.UTC).replace(tzinfo=None)

        @classmethod
        def today(cls) -> Any:
            return real.fromtimestamp(guard._read_clock("datetime.today", real.now().timestamp))

    Shifted.__name__ = Shifted.__qualname__ = "datetime"
    return Shifted


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
