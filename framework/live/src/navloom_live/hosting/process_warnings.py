"""Warnings of a live robot's process in which nothing failed: computed on request."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager

from navloom.engine import run_warnings
from navloom.engine.build import stride_of
from navloom.engine.run_warnings import Heard, RunWarning, RunWarnings, Volume
from navloom.engine.system import System
from navloom.memory import resident_bytes
from navloom.plugins.code_owners import Owned, Owners
from navloom.plugins.output_limit import LARGEST_OUTPUT, bounded_output
from navloom.plugins.thread_owners import keeping_alive, started_by, watched_threads

from navloom_live.live.live_node import Cell, Source
from navloom_live.live.live_runner import LiveRunner

__all__ = ["ProcessWarnings"]

OUTPUT_WINDOW = 10.0
"""Time window of the limit on a plugin's output, s."""
LARGE = 2**30
"""Memory of a process above which its plugins are named, bytes: several times that of one with a large map."""
NEWEST, MANY = 400, 100
"""Number of newest steps that are examined, and fewest steps for a verdict on a node."""
LATE = 0.1
"""Share of late steps above which a node counts as slow: a host that is busy for a moment is not the plugin's fault."""


class ProcessWarnings:
    """The warnings of one process.

    Args:
        system: The robot.
        sources: Nodes of this process.
    """

    def __init__(self, system: System, sources: Sequence[Source]) -> None:
        self._system, self._found = system, RunWarnings.of(system)
        self._sources = [source for source in sources if source in system.parts]
        self._owners = Owners({source: system.parts[source].cls for source in self._sources})
        self._started: Sequence[threading.Thread] = ()
        self._began = time.monotonic()

    @contextmanager
    def watch(self) -> Iterator[None]:
        """Watch what plugins print and which threads they start, within a `with` statement."""
        with ExitStack() as stack:
            stack.enter_context(bounded_output(self._owners, self._flooded, OUTPUT_WINDOW))
            self._started = stack.enter_context(watched_threads(self._owners))
            yield

    def _flooded(self, owned: Owned) -> None:
        most = f"{LARGEST_OUTPUT // 1024} kB within {OUTPUT_WINDOW:g} s"
        text = f"printed more than {most}: the rest is left out ({owned.place})"
        self._found.add("output", owned.source, text)

    def listed(self, cells: Mapping[Source, Cell], live: Mapping[Source, LiveRunner]) -> list[RunWarning]:
        """Examine the nodes, and return all warnings since the process began."""
        run_warnings.far_commands(self._found, [cell.stepper for cell in cells.values()])
        volumes = [
            Volume(source, port, outlet.largest, outlet.sent)
            for source, cell in cells.items()
            for port, outlet in cell.outlets.items()
        ]
        run_warnings.large_messages(self._found, volumes, time.monotonic() - self._began)
        for source, runner in live.items():
            self._look_at_times(source, runner)
            if source[0] == "platform":
                self._look_at_sensors(runner.cell)
        for thread in keeping_alive(self._started, 0.0):
            owned = started_by(thread)
            if owned is not None:
                run_warnings.staying_thread(self._found, owned, thread.name)
        self._look_at_memory(resident_bytes())
        return self._found.listed()

    def _look_at_memory(self, used: int) -> None:
        """Name the plugins of a process that is large, before the system ends it: its shadows, if it has any."""
        if used <= LARGE:
            return
        shadows = {(one.role, one.name) for one in self._system.config.alternative if one.shadow}
        for source in [one for one in self._sources if one in shadows] or self._sources:
            beside = ", ".join(" ".join(other) for other in self._sources if other != source)
            text = (
                f"runs in a process that uses {used / 2**30:.1f} GiB of memory{f', with {beside}' if beside else ''};"
                " if it grows on, the system ends the process: bound what the plugin keeps"
            )
            self._found.add("memory", source, text, {"bytes": used})

    def _look_at_times(self, source: Source, runner: LiveRunner) -> None:
        steps = runner.times.computed(NEWEST)
        part = self._system.parts.get(source)
        if part is None or len(steps) < MANY:
            return
        period = self._system.config.run.period
        limit_ns = stride_of(part.table, period) * period * 1e9
        if sum(took > limit_ns for took, _ in steps) > LATE * len(steps):
            spent, computed = (list(times) for times in zip(*steps, strict=True))
            run_warnings.slow_steps(self._found, self._system, {source: spent}, {source: computed})

    def _look_at_sensors(self, platform: Cell) -> None:
        ticks = platform.stepper.stepped + 1
        scans = {}
        for sensor in self._system.sensors:
            outlet = platform.outlets[sensor.name]
            scans[sensor.name] = (outlet.sequence, -1 if outlet.last is None else outlet.last[1].tick)
        # The process may have restarted, and its sensors are silent only since then.
        began = max(0, ticks - platform.outlets["odometry"].sequence)
        run_warnings.silent_sensors(self._found, self._system, Heard(began, ticks, scans))
