"""Warnings of a run in which nothing failed: each one once, with the plugin that it concerns.

Warnings are not in the trace: a run is the same with and without them.
"""

from __future__ import annotations

import os
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np

from navloom.engine.answer_checks import notes_of
from navloom.engine.build import stride_of
from navloom.engine.stepper import Stepper
from navloom.engine.system import System
from navloom.engine.trace import TraceWriter
from navloom.messages import Message, RangeScan, Sweep
from navloom.messages.packing import writer_of
from navloom.plugins.code_owners import Owned
from navloom.roles import Platform

__all__ = ["LARGEST_MESSAGE", "MOST_PER_SECOND", "Heard", "Kind", "RunWarning", "RunWarnings", "Volume",
           "far_commands", "large_messages", "silent_sensors", "slow_steps", "staying_thread", "volumes_of",
           "waiting_nodes", "who"]  # fmt: skip

Kind = Literal[
    "slow", "late", "large", "limits", "silent", "waiting", "random", "clock", "thread", "output", "memory", "repeat"
]
Source = tuple[str, str]
Times: TypeAlias = "Sequence[int] | array[int]"

LARGEST_MESSAGE = 16 * 2**20
"""Largest message that a live robot can carry, bytes: the size of a process's shared memory."""
MOST_PER_SECOND = 100e6
"""Largest rate that one stream can carry on one host, bytes/s."""
FEW = 20
"""Fewest steps for a verdict on a node: one that only loads something in its first steps is not slow."""
SENSOR_SILENCE = 1.0
"""Longest silence of a range sensor without a warning, s; or three of its own intervals if these are longer."""


@dataclass(frozen=True)
class RunWarning:
    """Something about a plugin that its author or its users should know.

    Attributes:
        kind: Kind of warning.
        role, instance, plugin: The node; plugin is empty for a node of the framework.
        text: The finding and a fix, worded to follow the plugin's name.
        figures: Measured numbers, by name.
        about: Distinguishes warnings of one kind about one plugin: a port, a sensor.
    """

    kind: Kind
    role: str
    instance: str
    plugin: str
    text: str
    figures: Mapping[str, float] = field(default_factory=dict)
    about: str = ""

    def __str__(self) -> str:
        return f"{who(self.role, self.instance, self.plugin)} {self.text}"

    @classmethod
    def from_json(cls, given: Mapping[str, Any]) -> RunWarning:
        """From `to_json`."""
        plugin, figures, about = given["plugin"] or "", given["figures"], given["about"] or ""
        text = given["text"].removeprefix(f"{who(given['role'], given['instance'], plugin)} ")
        return cls(given["kind"], given["role"], given["instance"], plugin, text, figures, about)

    def to_json(self) -> dict[str, Any]:
        """For `--json`."""
        told = {"kind": self.kind, "role": self.role, "instance": self.instance, "plugin": self.plugin or None}
        return {**told, "about": self.about or None, "text": str(self), "figures": dict(self.figures)}


def who(role: str, instance: str, plugin: str) -> str:
    """A node as text: role and instance, and the plugin if its name differs from the instance's."""
    return f"{role} {instance}" if plugin in ("", instance) else f"{role} {instance} (plugin {plugin})"


class RunWarnings:
    """The warnings of one run, each once. Any thread may add one.

    Args:
        plugins: Name of each instance's plugin.
    """

    def __init__(self, plugins: Mapping[Source, str]) -> None:
        self._plugins = dict(plugins)
        self._found: dict[tuple[Kind, Source, str], RunWarning] = {}

    @classmethod
    def of(cls, system: System) -> RunWarnings:
        """No warnings yet, for the plugins of a system."""
        return cls({source: part.cls.name for source, part in system.parts.items()})

    def add(
        self, kind: Kind, source: Source, text: str, figures: Mapping[str, float] | None = None, about: str = ""
    ) -> None:
        """Add a warning, unless there already is one of this kind about the same thing."""
        made = RunWarning(kind, *source, self._plugins.get(source, ""), text, figures or {}, about)
        # One operation of a dict, so that threads need no lock.
        self._found.setdefault((kind, source, about), made)

    def listed(self) -> list[RunWarning]:
        """All warnings, sorted by node."""
        return sorted(
            self._found.values(), key=lambda warning: (warning.role, warning.instance, warning.kind, warning.about)
        )


def slow_steps(
    warnings: RunWarnings, system: System, spent_ns: Mapping[Source, Times], computed_ns: Mapping[Source, Times]
) -> None:
    """Warn of plugins whose steps, at the 99th percentile, compute for longer than the time until the next step.

    Of steps that are late by the clock alone the reason is not known: the plugin waits, or the machine is busy.
    Planners are left out: they answer requests, and nothing waits for them within a tick.

    Args:
        warnings, system: Receives the warnings; the system that ran.
        spent_ns, computed_ns: By node, wall time and CPU time of each step, ns.
    """
    for source, steps in spent_ns.items():
        part = system.parts.get(source)
        if part is None or source[0] == "planner" or len(steps) < FEW:
            continue
        limit = stride_of(part.table, system.config.run.period) * system.config.run.period
        spent, computed = np.array(steps) * 1e-9, np.array(computed_ns[source]) * 1e-9
        # Never the slowest step, also of few steps: a collection or another process may delay any one.
        p99, cpu_p99 = (float(np.percentile(times, 99, method="lower")) for times in (spent, computed))
        if p99 <= limit and cpu_p99 <= limit:
            continue
        load, cores = os.getloadavg()[0], len(os.sched_getaffinity(0))
        busy = f"load {load:.1f} on {cores} core{'s' if cores > 1 else ''}"
        is_slow = cpu_p99 > limit
        late = int(((computed if is_slow else spent) > limit).sum())
        if is_slow:
            text = (
                f"is slow: {late} of its {spent.size} steps computed for longer than the {limit * 1e3:g} ms to the "
                f"next one, p99 {cpu_p99 * 1e3:.3g} ms of CPU time ({p99 * 1e3:.3g} ms by the clock, {busy}); a live "
                "robot would stop for it: lower its rate_hz, or raise run.period"
            )
        else:
            text = (
                f"was late: {late} of its {spent.size} steps took longer than the {limit * 1e3:g} ms to the next one "
                f"by the clock, p99 {p99 * 1e3:.3g} ms, but they computed for {cpu_p99 * 1e3:.3g} ms of CPU time: it "
                f"waits for something, or other programs took the processor ({busy})"
            )
        figures = {"steps": spent.size, "late": late, "limit_ms": limit * 1e3, "p99_ms": p99 * 1e3}
        warnings.add(
            "slow" if is_slow else "late", source, text, {**figures, "cpu_p99_ms": cpu_p99 * 1e3, "load": load}
        )


def far_commands(warnings: RunWarnings, steppers: Iterable[Stepper]) -> None:
    """Warn of commands far beyond the robot's limits, which the gate limited."""
    for stepper in steppers:
        for note in notes_of(stepper.node):
            warnings.add("limits", (stepper.role, stepper.name), note)


@dataclass(frozen=True)
class Volume:
    """Amount of data of one stream.

    Attributes:
        source, port: The stream.
        largest, total: Size of its largest message and of all messages, bytes.
    """

    source: Source
    port: str
    largest: int
    total: int


def volumes_of(trace: TraceWriter, steppers: Sequence[Stepper]) -> Iterator[Volume]:
    """Volumes of a run's streams: from the trace; for a shadow, estimated from its last message."""
    traced = set()
    for label, largest, total in trace.volumes():
        role, name, port, _ = label.split(" ")
        traced.add((role, name, port))
        yield Volume((role, name), port, largest, total)
    for stepper in steppers:
        for port, slot in stepper.slots.items():
            if slot.message is not None and (stepper.role, stepper.name, port) not in traced:
                # A shadow is not in the trace, and recording all its messages just to count them would cost too much.
                size = _size(slot.message)
                yield Volume((stepper.role, stepper.name), port, size, size * slot.sequence)


def large_messages(warnings: RunWarnings, volumes: Iterable[Volume], seconds: float) -> None:
    """Warn of streams with more data than the network of a live robot can carry, in a run of `seconds`."""
    for one in volumes:
        # A run of a few ticks would turn the first map into an enormous rate.
        rate = one.total / max(seconds, 1.0)
        if one.largest <= LARGEST_MESSAGE and rate <= MOST_PER_SECOND:
            continue
        if one.largest > LARGEST_MESSAGE:
            said = f"a message of {one.largest / 1e6:.3g} MB on {one.port}, of at most {LARGEST_MESSAGE / 1e6:.3g} MB"
        else:
            said = f"{rate / 1e6:.3g} MB a second on {one.port}, of at most {MOST_PER_SECOND / 1e6:.3g} MB"
        warnings.add(
            "large",
            one.source,
            f"published {said}; a live robot would lose messages and stop: publish less often, or a part",
            {"largest_bytes": one.largest, "bytes_per_s": rate},
            one.port,
        )


def _size(message: Message) -> int:
    """Size of a message's fields and arrays, bytes."""
    rest, _, _, size = writer_of(type(message))(message)
    return len(rest) + size


@dataclass(frozen=True)
class Heard:
    """What a platform has published so far.

    Attributes:
        began, ticks: Its first tick in this process, and the number of ticks since the run began.
        scans: By sensor, the number of messages and the tick of the last one; -1 for none.
        asked: Tick of the last request for a sweep; -1 if none is known.
    """

    began: int
    ticks: int
    scans: Mapping[str, tuple[int, int]]
    asked: int = -1


def silent_sensors(warnings: RunWarnings, system: System, heard: Heard) -> None:
    """Warn of range sensors that never published a message, or that stopped."""
    source, period = ("platform", system.config.platform.instance), system.config.run.period
    cls = system.parts[source].cls
    assert issubclass(cls, Platform)
    for sensor in system.sensors:
        if not issubclass(cls.sensor_kinds[sensor.kind], (RangeScan, Sweep)):
            continue  # a sensor of another kind may publish only when there is something to report
        count, tick = heard.scans[sensor.name]
        since = tick if count else heard.began - 1
        allowed = max(SENSOR_SILENCE, 3.0 * period * (tick - heard.began + 1) / max(1, count))
        if cls.scans_on_request(sensor):
            allowed = system.config.navigation.map_timeout
            # A sweep comes only when asked for: silence counts from the request on.
            since = heard.ticks if count or heard.asked < 0 else heard.asked
        silence = (heard.ticks - 1 - since) * period
        if silence <= allowed:
            continue
        when = f"after {max(0, tick) * period:.2f} s" if count else f"in {(heard.ticks - heard.began) * period:.2f} s"
        text = f"gave no scan of the sensor {sensor.name!r} {when}: check its cable, its driver and its settings"
        warnings.add("silent", source, text, {"scans": count, "silence_s": silence}, sensor.name)


def staying_thread(warnings: RunWarnings, owned: Owned, name: str) -> None:
    """Warn of a non-daemon thread that a plugin started: the process would wait for it at its end."""
    text = f"started the thread {name!r}, which still runs and is not a daemon ({owned.place})"
    warnings.add("thread", owned.source, f"{text}: a process would wait for it at its end", about=name)


def waiting_nodes(warnings: RunWarnings, steppers: Iterable[Stepper]) -> None:
    """Warn of plugins that never stepped because a needed stream had no message."""
    for stepper in steppers:
        if stepper.enabled and stepper.lacks:
            streams = " and ".join(stepper.lacks)
            warnings.add("waiting", (stepper.role, stepper.name), f"never stepped: no message came on {streams}")
