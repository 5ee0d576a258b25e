"""Global state of a process: settings that all its plugins and the framework share."""

from __future__ import annotations

import builtins
import decimal
import gc
import locale
import logging
import math
import os
import random
import signal
import socket
import sys
import threading
import time
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

__all__ = ["PROCESS_STATE", "ProcessState"]

ENVIRONMENT, SEARCH_PATH = "the environment", "sys.path"
VIEWER = "rerun"
_SHARED = tuple(
    (module, tuple(name for name, value in vars(module).items() if callable(value)))
    for module in (builtins, math, random, np, np.linalg)
)
"""Modules that everything uses, and the names of their functions and classes."""


def _signal_handlers() -> tuple[str, ...]:
    return tuple(f"{valid_signal} {signal.getsignal(valid_signal)}" for valid_signal in sorted(signal.valid_signals()))


def _functions() -> tuple[int, ...]:
    """Which functions the shared modules have: a plugin that replaces one changes it for everything else."""
    return tuple(id(vars(module).get(name)) for module, names in _SHARED for name in names)


def _context() -> tuple[Any, ...]:
    """The decimal context without its flags, which every inexact result sets."""
    own = decimal.getcontext()
    return own.prec, own.rounding, own.Emin, own.Emax, own.clamp, tuple(flag for flag, on in own.traps.items() if on)


def _root_logger() -> tuple[Any, ...]:
    root = logging.getLogger()
    return root.level, tuple(type(handler).__name__ for handler in root.handlers), root.manager.disable


def _blanket_filters() -> tuple[str, ...]:
    """Filters for every warning; libraries add filters of their own classes when they are imported."""
    return tuple(action for action, text, kind, module, _ in warnings.filters if (text, kind, module) == (None, Warning,
                 None))  # fmt: skip


LOOKS: Mapping[str, Callable[[], Any]] = MappingProxyType({
    "numpy.errstate": lambda: tuple(sorted(np.geterr().items())),
    "numpy's print options": lambda: repr(np.get_printoptions()),
    "the working directory": os.getcwd,
    ENVIRONMENT: lambda: tuple(sorted(os.environ.items())),
    SEARCH_PATH: lambda: tuple(sys.path),
    "the recursion limit": sys.getrecursionlimit,
    "the garbage collector": lambda: (gc.isenabled(), gc.get_threshold(), gc.get_debug()),
    "the switch interval of threads": sys.getswitchinterval,
    "the decimal context": _context,
    "functions of Python or numpy": _functions,
    # As the kernel tells it: `os.umask` reads the mask only by setting it.
    "the umask": lambda: Path("/proc/self/status").read_text("ascii").partition("Umask:")[2].split()[0],
    "the stack size of threads": threading.stack_size,
    "the time zone": lambda: (time.tzname, time.timezone),
    "the tracing of calls": lambda: (sys.gettrace() is None, sys.getprofile() is None),
    "the processors of the process": lambda: tuple(sorted(os.sched_getaffinity(0))),
    "the default timeout of sockets": socket.getdefaulttimeout,
    "the locale": lambda: locale.setlocale(locale.LC_ALL),
    "the root logger": _root_logger,
    "the filters of warnings": _blanket_filters,
    "the hooks for uncaught exceptions": lambda: (id(sys.excepthook), id(threading.excepthook)),
    "sys.stdout or sys.stderr": lambda: (id(sys.stdout), id(sys.stderr)),
    "the priority of the process": lambda: os.getpriority(os.PRIO_PROCESS, 0),
    "signal handlers": _signal_handlers,
    "timers of signals": lambda: signal.getitimer(signal.ITIMER_REAL)[1],
})  # fmt: skip
"""How each setting is read. Random seeds are missing, since every play sets them: the check reads them itself."""


class ProcessState:
    """The state before the plugin was imported, and what changed since."""

    def __init__(self) -> None:
        self._before: dict[str, Any] = {}
        self._imported: dict[str, Any] = {}
        self._has_viewer = self.imported_viewer = False

    def note_before_import(self) -> None:
        """Note the state before the plugin's import."""
        self._before = self._imported = _look()
        self._has_viewer = VIEWER in sys.modules

    def note_import(self) -> None:
        """Note the state after the import, before the first object.

        Libraries may set the environment on import, and the framework adds the folder of a plugin's file to the path.
        """
        self._imported = _look()
        self.imported_viewer = VIEWER in sys.modules and not self._has_viewer
        for name in (ENVIRONMENT, SEARCH_PATH):
            self._before[name] = self._imported[name]

    def changed(self) -> tuple[list[str], list[str]]:
        """Settings that the import changed, and settings that calls changed."""
        now = _look()
        by_import = [name for name, value in self._imported.items() if value != self._before[name]]
        by_calls = [name for name, value in self._imported.items() if value != now[name]]
        return by_import, by_calls


def _look() -> dict[str, Any]:
    return {name: look() for name, look in LOOKS.items()}


PROCESS_STATE = ProcessState()
"""State of this process."""
