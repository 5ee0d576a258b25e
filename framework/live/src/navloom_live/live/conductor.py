"""Conducts a run under the barrier from outside the nodes: it starts ticks and collects their messages."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

from navloom.engine.lockstep import Observer, RunLog
from navloom.engine.streams import STEP
from navloom.engine.system import System
from navloom.engine.trace import TraceWriter
from navloom.errors import NavloomError
from navloom.messages import (
    Command,
    Envelope,
    Feedback,
    GateStatus,
    GoalResult,
    Message,
    Odometry,
    OperatorRequest,
    PortMark,
    Selection,
    Twist2D,
)
from navloom.messages.codec import schema_label
from navloom.messages.steps import StepReport
from navloom.navigation.braking import Ending

from navloom_live.live.barrier import Barrier
from navloom_live.live.live_node import Source
from navloom_live.live.live_node_builder import all_sources
from navloom_live.live.mailbox import Inlet, Mailbox
from navloom_live.live.process_streams import Switchboard

__all__ = ["BarrierError", "Conductor"]

BARRIER_STALL_LIMIT = 30.0
"""Time without any progress after which the run has failed, s."""


class BarrierError(NavloomError, RuntimeError):
    """A node did not report a tick, so the run ends. The text names the node."""

    exit_code = 1


class Conductor:
    """The operator node of a run under the barrier, which also writes the run's trace.

    Args:
        system: The robot; its plugins are not made here.
        board: Streams of this process.
        requests: Operators' requests by tick.
        observers: Receive the messages of the active instances, in the order of lockstep.
        trace: Receives the same messages.
        check: Called while waiting; raises an exception to end the run.
    """

    def __init__(
        self,
        system: System,
        board: Switchboard,
        requests: Mapping[int, Sequence[OperatorRequest]],
        observers: Sequence[Observer],
        trace: TraceWriter,
        check: Callable[[], None],
    ) -> None:
        self.system, self.requests, self.observers, self.trace = system, dict(requests), observers, trace
        self.log = RunLog()
        mailbox = Mailbox()
        sources = all_sources(system)
        self._own = ("operator", "main")
        self._requests = board.outlet(self._own, "request")
        self._steps = board.outlet(self._own, STEP)
        self._inlets: dict[Source, dict[str, Inlet]] = {
            (spec.role, name): {port: board.inlet((spec.role, name), port, mailbox, None) for port in spec.outputs}
            for spec in system.specs
            for role, name in sources
            if role == spec.role and role != "operator"
        }
        streams = {inlet: (source, port) for source, ports in self._inlets.items() for port, inlet in ports.items()}
        reports = {source: board.inlet(source, STEP, mailbox, None) for source in sources if source != self._own}
        self._barrier = Barrier(mailbox, reports, streams, self._while_waiting)
        self._check = check
        self._chosen = {role: system.config.role_table(role).instance for role in system.config.roles}
        self._selection: Selection | None = None
        self._idle, self._is_commanded = True, False
        self._measured: Twist2D | None = None
        self._moved_at = 0.0
        self._reported = 0
        self._tick = 0

    def run(self, ticks: int, progress: Callable[[int], None] | None = None) -> RunLog:
        """Run until the last goal has ended and the robot stands, but at most this many ticks.

        Raises:
            BarrierError: A node that should have reported did not.
        """
        ending = Ending(self.system.braking, max(self.requests, default=0))
        began = time.perf_counter_ns()
        self._moved_at = time.monotonic()
        # One tick ahead of those that are collected: nodes never wait for this process.
        self._let_begin(0)
        for number in range(ticks):
            before = time.perf_counter_ns()
            self._tick = number
            self._let_begin(number + 1)
            self._collect(number)
            self.log.tick_ns.append(time.perf_counter_ns() - before)
            if progress is not None and number % 16 == 0:
                progress(number)
            if ending.is_over(number, self._idle, self._is_commanded, self._measured):
                break
        self.log.wall_ns = time.perf_counter_ns() - began
        self.log.ticks = len(self.log.tick_ns)
        self.log.trace_sha256 = self.trace.sha256()
        return self.log

    def _let_begin(self, number: int) -> None:
        """Publish a tick's operator requests, and allow the nodes to step it."""
        time_ns = round(number * self.system.config.run.period * 1e9)
        for request in self.requests.get(number, ()):
            self._requests.publish(request, number, time_ns, time_ns, 0)
        marks = (PortMark("request", self._requests.sequence), PortMark("command", 0))
        report = StepReport("tick", (), marks, True, 0, 0, 0, "")
        self._steps.publish(report, number, time_ns, time_ns, 0)

    def _collect(self, number: int) -> None:
        """Wait for every active instance's report of a tick, and take the messages that it published."""
        if self._selection is not None and number >= self._selection.from_tick:
            self._chosen |= self._selection.chosen
            self.log.swaps = self._selection.epoch
            self._selection = None
        time_ns = round(number * self.system.config.run.period * 1e9)
        for request in self.requests.get(number, ()):
            at = Envelope(self._requests.key, 0, number, time_ns, time_ns, self.log.swaps)
            self._keep(self._own, "request", request, at)
        for source, ports in self._inlets.items():
            role, name = source
            # Read and thrown away, or its queue would grow for the whole run.
            if self._chosen.get(role, name) != name:
                for inlet in ports.values():
                    for _ in self._barrier.read(inlet, number, waits=False):
                        pass
                continue
            report = self._barrier.await_report(source, number)
            if role in self.log.step_ns and report.duration_ns:
                self.log.step_ns[role].append(report.duration_ns)
            if report.fault is not None and report.fault[0] == number:
                self.log.faults.append(f"{role} {name} failed: {report.fault[1]}")
                self.log.failed.append((role, name, number))
            for port, inlet in ports.items():
                for message, envelope, tick in self._barrier.read(inlet, number):
                    # A swap brings earlier messages of the new instance along, which lockstep has not in its trace.
                    if tick == number:
                        self._keep(source, port, message, envelope)
        self.trace.end_tick(number)

    def _keep(self, source: Source, port: str, message: Message, at: Envelope) -> None:
        role, name = source
        label = f"{role} {name} {port} {schema_label(type(message))}".encode()
        self.trace.entries.append((label, message, at[2:], at.key))
        for observer in self.observers:
            if observer.wants is None or (role, port) in observer.wants:
                observer.on_message(role, name, True, port, message, at)
        if isinstance(message, Selection) and message.epoch:
            self._selection = message
        elif isinstance(message, GateStatus):
            self.log.hear_gate(message)
        elif isinstance(message, GoalResult):
            self.log.results.append(message)
        elif isinstance(message, Feedback):
            self._idle = message.goal_id == 0
        elif isinstance(message, Odometry):
            self._measured = message.twist
        elif isinstance(message, Command) and role == "gate":
            self._is_commanded = any(message.twist.read_fields())

    def _while_waiting(self) -> None:
        self._check()
        reported = sum(progress.done for progress in self._barrier.progress.values())
        now = time.monotonic()
        if reported != self._reported:
            self._reported, self._moved_at = reported, now
        elif now - self._moved_at > BARRIER_STALL_LIMIT:
            # Reports of nodes that are not waited for at the moment may still be in their queues.
            self._barrier.hear_all()
            sources = [s for s in self._barrier.progress if self._chosen.get(s[0], s[1]) == s[1]]
            # Those that are farthest behind hold up all others.
            behind = min(self._barrier.progress[source].done for source in sources)
            named = [f"{r} {n}" for r, n in sources if self._barrier.progress[(r, n)].done == behind]
            raise BarrierError(
                f"tick {self._tick}: no progress for {BARRIER_STALL_LIMIT:g} s; not reported since tick {behind}: "
                f"{', '.join(named)}"
            )
