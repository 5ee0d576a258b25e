"""Inspects steps of plugins for what makes a run unrepeatable: the wall clock, and random state of the process.

Inspection costs some ms a tick, so a run inspects few ticks. It does not change what a step publishes.
"""

from __future__ import annotations

import datetime
import os
import random
import sys
import time
from collections.abc import Callable
from pathlib import PurePath
from types import FrameType
from typing import Any

import numpy as np

from navloom.engine.answer_checks import verb_place
from navloom.engine.nodes.node_base import Outputs, Tick
from navloom.engine.run_warnings import RunWarnings
from navloom.engine.stepper import Stepper
from navloom.plugins.code_owners import home_of
from navloom.roles import ROLES, Role

__all__ = ["StepInspector", "every_tick", "some_ticks"]

CLOCKS = frozenset({
    time.time, time.time_ns, time.monotonic, time.monotonic_ns, time.perf_counter, time.perf_counter_ns,
    time.process_time, time.process_time_ns, time.thread_time, time.localtime, time.gmtime, time.ctime,
})  # fmt: skip
DATES = {"now", "utcnow", "today"}
FIRST, APART = 40, 500
"""First tick of a run that is inspected, and the interval to the next, in ticks."""
SHARED: Any = getattr(random, "_inst")  # noqa: B009  (the generator behind the functions of the module)
OWN = "navloom"


def some_ticks(number: int) -> bool:
    """Whether to inspect a tick: so few that the run is not slowed down."""
    return number % APART == FIRST


def every_tick(number: int) -> bool:
    """Inspect every tick."""
    return True


class StepInspector:
    """Runs steps of plugins and inspects them.

    Args:
        found: Receives the warnings.
        looks_at: Whether it inspects a tick.
    """

    def __init__(self, warnings: RunWarnings, looks_at: Callable[[int], bool] = some_ticks) -> None:
        self.looks_at = looks_at
        self._found = warnings

    def step(self, stepper: Stepper, tick: Tick, since: int) -> Outputs:
        """Run `stepper.step` and inspect it."""
        plugin = getattr(stepper.node, "plugin", stepper.node)
        home = home_of(type(plugin))
        # The framework's own nodes are checked by ruff and by tests.
        if not isinstance(plugin, Role) or home == OWN:
            return stepper.step(tick, since)
        source, seen = (stepper.role, stepper.name), _Calls(home)
        # The state is compared as well, since compiled code draws without a call that a profiler sees.
        before = _random_state()
        outputs = seen.watch(lambda: stepper.step(tick, since))
        if seen.clock:
            self._found.add(
                "clock",
                source,
                f"reads the wall clock in its step ({seen.clock}): repeated runs will differ; take the time "
                "from the stamp of its input",
            )
        if seen.random or _random_state() != before:
            place = seen.random or (verb_place(plugin) if plugin.role in ROLES else "")
            where = f" ({place})" if place else ""
            self._found.add(
                "random",
                source,
                f"uses random state of the whole process in its step{where}: repeated runs will differ; take a "
                "generator from self.context.stream(NAME)",
            )
        return outputs


class _Calls:
    """The first calls of a step, in one package's code, that read a clock or random state."""

    def __init__(self, home: str) -> None:
        self.clock = self.random = ""
        self._home = home

    def watch(self, act: Callable[[], Outputs]) -> Outputs:
        """Call `act` with this profiler, unless another one is active."""
        # A debugger or coverage tool is at work: it would lose its hook.
        if sys.getprofile() is not None:
            return act()
        sys.setprofile(self._see)
        try:
            return act()
        finally:
            sys.setprofile(None)

    def _see(self, frame: FrameType, event: str, called: Any) -> None:
        if event == "c_call":
            owner = getattr(called, "__self__", None)
            if called in CLOCKS or (called.__name__ in DATES and owner in (datetime.datetime, datetime.date)):
                self.clock = self.clock or self._line(frame, called.__name__)
            elif called is os.urandom or owner is SHARED:
                self.random = self.random or self._line(frame, called.__name__)
        # Some functions of `random` are written in Python, others in C.
        elif event == "call" and frame.f_locals.get("self") is SHARED:
            self.random = self.random or self._line(frame.f_back, frame.f_code.co_name)

    def _line(self, frame: FrameType | None, name: str) -> str:
        """File, line and the called function; empty for a line of another package."""
        if frame is None or frame.f_globals.get("__name__", "").partition(".")[0] != self._home:
            return ""
        return f"{PurePath(frame.f_code.co_filename).name}:{frame.f_lineno}, {name}"


def _random_state() -> tuple[Any, ...]:
    """State of the generators that the whole process shares."""
    state = np.random.get_state(legacy=False)  # noqa: NPY002  (read, not used)
    return random.getstate(), state["state"]["pos"], state["state"]["key"].tobytes()
