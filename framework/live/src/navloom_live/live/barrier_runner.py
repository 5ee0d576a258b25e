"""A node under the barrier: it steps a tick only when it has all inputs of that tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from navloom.engine.nodes.gate_node import GateNode
from navloom.engine.nodes.goal_node import GoalNode
from navloom.engine.nodes.localizer_node import LocalizerNode
from navloom.engine.nodes.node_base import Tick
from navloom.engine.system import System
from navloom.engine.wiring import QueueWire
from navloom.messages import OperatorRequest, Selection

from navloom_live.live.barrier import Barrier, BarrierEnded
from navloom_live.live.live_node import Cell, Feed, Source

__all__ = ["BarrierRunner"]

OPERATOR: Source = ("operator", "main")
GATE: Source = ("gate", "main")


class BarrierRunner:
    """Steps one cell tick by tick, as the operator node allows.

    Args:
        cell: The node.
        requests, selection: Feeds of the operators' requests and the gate's selection.
        system: The robot.
        configure: Changes the plugin's parameters.
        check: Raises BarrierEnded when the process ends.
    """

    def __init__(
        self,
        cell: Cell,
        requests: Feed,
        selection: Feed,
        system: System,
        configure: Callable[[tuple[str, ...]], None],
        check: Callable[[], None],
    ) -> None:
        self.cell, self.requests, self.selection, self.catalogue = cell, requests, selection, system.catalogue
        self.roles, self.period = [spec.role for spec in system.specs], system.config.run.period
        self.configure, self._may_wait, self._number = configure, system.may_wait, 0
        feeds = [*cell.feeds, requests, selection]
        streams = {feed.inlet: (feed.source, feed.wire.input.port) for feed in feeds}
        self.barrier = Barrier(cell.mailbox, cell.reports, streams, check)
        self._delayed = [selection, *(feed for feed in cell.feeds if feed.wire.delayed)]
        self._direct = [feed for feed in cell.feeds if not feed.wire.delayed]
        self._watched: set[Source] = set()
        if isinstance(cell.node, GateNode):
            cell.node.is_warm = self._is_warm
            cell.node.find_waiting = self._find_waiting

    def run(self) -> None:
        """Step tick after tick until the process ends."""
        number = 0
        try:
            while True:
                self._tick(number)
                number += 1
        except BarrierEnded:
            return

    def _tick(self, number: int) -> None:
        self._number = number
        self.barrier.await_report(OPERATOR, number)
        if number:
            # The gate announces a selection one tick ahead: its report tells whether there is one.
            self.barrier.await_report(GATE, number - 1)
        self.barrier.hear_all()
        # In this order: a selection of the last tick decides from which instances this tick reads.
        self._let_in(self._delayed, number - 1, number - 1)
        self._let_in([self.requests], number, number)
        self._obey(number)
        self._follow_selection(number)
        self._let_in(self._direct, number, number - 1)
        self._await_others(number)
        self._step(number)

    def _let_in(self, feeds: Sequence[Feed], tick: int, others: int) -> None:
        """Admit all messages of active instances up to `tick`, and those of others up to `others` that have arrived."""
        for feed in feeds:
            if not self.cell.in_charge(feed.source):
                self._apply(feed, others, waits=False)
            elif tick >= 0:
                self.barrier.await_report(feed.source, tick)
                self._apply(feed, tick)

    def _apply(self, feed: Feed, upto: int, waits: bool = True) -> None:
        for message, envelope, tick in self.barrier.read(feed.inlet, upto, waits):
            feed.slot.take(message, envelope, tick)

    def _obey(self, number: int) -> None:
        """Act on requests: change parameters, enable the target of a swap, and watch pending instances."""
        wire = self.requests.wire
        assert isinstance(wire, QueueWire)
        wire.prepare(number, number - 1)
        for request in wire.values:
            assert isinstance(request, OperatorRequest)
            target = (request.role, request.instance)
            if request.do == "swap":
                self._watched.add(target)
            # Every node sees every request, and each acts on its own.
            if target == self.cell.source and request.do == "swap":
                self.cell.stepper.enabled = True
            elif request.do in ("place", "relocalise") and isinstance(self.cell.node, LocalizerNode):
                self.cell.node.place(request, self.cell.stepper.active)
            elif target == self.cell.source and request.do == "set":
                self.configure(request.values)
                self.cell.versions += 1

    def _follow_selection(self, number: int) -> None:
        message: Any = self.selection.slot.message
        if not isinstance(message, Selection) or message.epoch <= self.cell.epoch or message.from_tick > number:
            return
        fresh = {*message.chosen.items()}
        for feed in self.cell.feeds:
            if feed.source in fresh and not self.cell.in_charge(feed.source):
                # The new instance was not waited for until now: what it published before is read first.
                self.barrier.await_report(feed.source, number - 1)
                self._apply(feed, number - 1)
        self.cell.select(message)

    def _await_others(self, number: int) -> None:
        """Let the goal know of every fault, and the gate of every instance that may take over."""
        node, place = self.cell.node, self.roles.index(self.cell.source[0])
        if isinstance(node, GoalNode):
            for source in self.barrier.progress:
                if self.cell.in_charge(source) and source != self.cell.source and source[0] not in node.optional:
                    # Nodes that step after the goal can only have reported the tick before.
                    tick = number if self.roles.index(source[0]) < place else number - 1
                    fault = self.barrier.await_report(source, tick).fault
                    if fault is not None and fault[0] <= tick:
                        node.fault = f"{source[0]} {source[1]} failed: {fault[1]}"
        if isinstance(node, GateNode):
            for source in self._watched:
                # Whether a pending instance is warm must not depend on how fast its process is.
                self.barrier.await_report(source, number)

    def _find_waiting(self) -> str:
        """The first active instance that waits for a stream in this tick, and for which; all step before the gate."""
        found = [
            self.barrier.await_report(one, self._number).waiting for one in self._may_wait if self.cell.in_charge(one)
        ]
        return next(filter(None, found), "")

    def _step(self, number: int) -> None:
        cell, stepper = self.cell, self.cell.stepper
        time_ns = round(number * self.period * 1e9)
        tick = Tick(number, time_ns * 1e-9, time_ns, cell.epoch)
        for made in stepper.due(number):
            cell.publish(*made)
        trigger = stepper.fired(number) if stepper.enabled and number % stepper.stride == 0 else ""
        if not trigger:
            # Also without a step: all readers wait for this report.
            cell.report(tick)
            return
        since = number - stepper.stride
        read = cell.read_marks(number, since)
        outputs = stepper.step(tick, since)
        if stepper.fault:
            # As in lockstep: both must give the same trace.
            stepper.enabled = False
        cause_ns = stepper.cause_of(time_ns)
        if outputs and stepper.delay:
            stepper.hold_back(outputs, tick, cause_ns)
        else:
            cell.publish(outputs, tick, cause_ns)
        cell.report(tick, trigger, read, stepper.spent_ns, stepper.fault)

    def _is_warm(self, role: str, name: str) -> bool:
        progress, ports = self.barrier.progress[(role, name)], self.catalogue.warming_ports(role)
        return progress.enabled and (not ports or any(progress.marks.get(port, 0) for port in ports))
