"""The lockstep executor: one process, simulated time, references passed. Repeatable bit for bit."""

from __future__ import annotations

from array import array
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter_ns
from typing import Protocol, TypeVar

from navloom.engine.nodes import Tick, fault_text
from navloom.engine.own_nodes import GateNode, GoalNode, OperatorNode
from navloom.engine.trace import TraceWriter
from navloom.engine.wiring import Instance
from navloom.messages import Envelope, GateStatus, GoalResult, Message, OperatorRequest, Selection, StepRecord
from navloom.messages.codec import encode

__all__ = ["Lockstep", "Observer", "RunLog"]

T = TypeVar("T")
TELL_NS = 100_000_000
"""Wall time between two reports of progress, ns. Slower ticks are reported one by one."""
MAIN_PORTS = {"mapper": ("map",), "planner": ("path", "failure"), "localizer": ("pose",), "recovery": ("command",)}


class Observer(Protocol):
    """Something that looks on. It must not change what it is shown.

    Attributes:
        wants: (role, port) pairs to be shown; None for all.
        wants_steps: Whether step records are made for it.
    """

    wants: frozenset[tuple[str, str]] | None
    wants_steps: bool

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        """A message was published."""

    def on_step(self, record: StepRecord) -> None:
        """A node stepped, silent or not."""


@dataclass
class RunLog:
    """What a run leaves behind.

    Attributes:
        results: Of every goal, in order.
        ticks: Ticks run.
        tick_ns: Wall time of each.
        control_ns: Wall time of each tick's steps of the active nodes but the platform; empty where it is not measured.
        step_ns: By role, wall time of each step of planner and mapper.
        spent_ns: By role and instance, wall time of each step; empty for a live run.
        wall_ns: From the first tick to the last.
        swaps: Selections after the first.
        gate_stops: How often the gate stopped a driving robot.
        gate_limits: How often its monitor began to slow or stop the robot.
        faults: "role instance: what happened" of plugins that broke.
        trace_sha256: Hash of the trace.
    """

    results: list[GoalResult] = field(default_factory=list)
    ticks: int = 0
    tick_ns: list[int] = field(default_factory=list)
    control_ns: list[int] = field(default_factory=list)
    step_ns: dict[str, list[int]] = field(default_factory=lambda: {"planner": [], "mapper": []})
    spent_ns: dict[tuple[str, str], array[int]] = field(default_factory=lambda: defaultdict(lambda: array("q")))
    wall_ns: int = 0
    swaps: int = 0
    gate_stops: int = 0
    gate_limits: int = 0
    faults: list[str] = field(default_factory=list)
    trace_sha256: str = ""
    _stopped_for: str = ""
    _limited_by: str = ""

    def hear_gate(self, status: GateStatus) -> None:
        """Count what a status of the gate says beyond the one before."""
        stopped_for = status.reason if status.stopped and status.reason not in ("no_trajectory", "ending") else ""
        self.gate_stops += bool(stopped_for) and stopped_for != self._stopped_for
        limited_by = "" if status.limit == "overridden" else status.limit
        self.gate_limits += bool(limited_by) and not self._limited_by
        self._stopped_for, self._limited_by = stopped_for, limited_by


class Lockstep:
    """Steps the instances of a graph in order, tick by tick.

    Args:
        instances: In the order they step; of a role the active one first.
        period: s.
        requests: Operators' requests by tick.
        configure: Changes parameters for `set`: (role, instance, assignments).
        observers: Who looks on.
        trace: Where the active nodes' messages go.
    """

    def __init__(
        self,
        instances: Sequence[Instance],
        period: float,
        requests: Mapping[int, Sequence[OperatorRequest]],
        configure: Callable[[str, str, tuple[str, ...]], None],
        observers: Sequence[Observer] = (),
        trace: TraceWriter | None = None,
    ) -> None:
        self.instances = list(instances)
        self.period = period
        self.requests = dict(requests)
        self.configure = configure
        self.trace = trace or TraceWriter()
        self.log = RunLog()
        self._by_name = {(i.spec.role, i.name): i for i in self.instances}
        self._active = {i.spec.role: i for i in self.instances if i.active}
        self._epoch = 0
        self._control_ns = 0
        self._versions: dict[tuple[str, str], int] = {}
        self._due: dict[int, list[tuple[Instance, list[tuple[str, Message]], Tick, int]]] = {}
        self._selection: Selection | None = None
        self._step_observers = [o for o in observers if o.wants_steps]
        self._operator = self._node("operator", OperatorNode)
        self._goal = self._node("goal", GoalNode)
        self._gate = self._node("gate", GateNode)
        self._watch(observers)

    def is_warm(self, role: str, name: str) -> bool:
        """An instance has published what its role is for since it was enabled."""
        instance = self._by_name[(role, name)]
        ports = MAIN_PORTS.get(role, ("command",))
        return instance.enabled and (role == "recovery" or any(instance.slots[p].tick >= 0 for p in ports))

    def run(self, ticks: int, progress: Callable[[int], None] | None = None) -> RunLog:
        """Run until the last goal has ended, but no more than this many ticks. `progress` gets the newest tick."""
        started, told = perf_counter_ns(), 0
        last_request = max(self.requests, default=0)
        for number in range(ticks):
            before = perf_counter_ns()
            self._control_ns = 0
            self._step(number)
            now = perf_counter_ns()
            self.log.tick_ns.append(now - before)
            self.log.control_ns.append(self._control_ns)
            if progress is not None and now - told >= TELL_NS:
                told = now
                progress(number)
            if self._goal.machine.is_idle and number >= last_request + 1:
                break
        self.log.wall_ns = perf_counter_ns() - started
        self.log.ticks = len(self.log.tick_ns)
        self.log.trace_sha256 = self.trace.sha256()
        return self.log

    def _step(self, number: int) -> None:
        time_ns = round(number * self.period * 1e9)
        if self._selection is not None and number >= self._selection.from_tick:
            self._select(self._selection)
        for request in self.requests.get(number, ()):
            self._take(request)
        tick = Tick(number, time_ns * 1e-9, time_ns, self._epoch)
        for instance, outputs, made, cause in self._due.pop(number, ()):
            self._publish(instance, outputs, number, made, cause)
        for instance in self.instances:
            if instance.enabled and number % instance.stride == 0:
                self._step_instance(instance, tick)
        self.trace.end_tick(number)

    def _step_instance(self, instance: Instance, tick: Tick) -> None:
        number = tick.number
        trigger = instance.fired(number)
        if not trigger:
            return
        since = number - instance.stride
        consumed = (
            tuple((wire.input.name, wire.sequences(number, since)) for wire in instance.wires)
            if self._step_observers
            else ()
        )
        given = instance.read(number, since)
        before = perf_counter_ns()
        fault = ""
        try:
            outputs = instance.node.step(tick, given)
        except (Exception, SystemExit) as error:
            outputs, fault = [], fault_text(error, instance.node)
            self._fault(instance, fault)
        spent = perf_counter_ns() - before
        instance.stepped = number
        if instance.active and instance.spec.role != "platform":
            self._control_ns += spent
        if instance.spec.role in self.log.step_ns and instance.active:
            self.log.step_ns[instance.spec.role].append(spent)
        self.log.spent_ns[instance.spec.role, instance.name].append(spent)
        if self._step_observers:
            self._record(instance, tick, trigger, consumed, spent, fault)
        if not outputs:
            return
        cause = instance.cause_of(tick.time_ns)
        if instance.delay:
            self._due.setdefault(number + instance.delay, []).append((instance, outputs, tick, cause))
        else:
            self._publish(instance, outputs, number, tick, cause)

    def _publish(
        self, instance: Instance, outputs: Sequence[tuple[str, Message]], number: int, made: Tick, cause: int
    ) -> None:
        for port, message in outputs:
            slot = instance.slots[port]
            slot.put(message, number, made.number, made.time_ns, cause, made.epoch)
            if instance.active:
                at = Envelope(slot.key, 0, made.number, made.time_ns, cause, made.epoch)
                self.trace.add(slot.label(type(message)), encode(message, at))

    def _fault(self, instance: Instance, fault: str) -> None:
        """A plugin broke: it steps no more; the goal ends where it was the active one."""
        role, name = instance.spec.role, instance.name
        text = f"{role} {name} failed: {fault}"
        self.log.faults.append(text)
        instance.enabled = False
        if instance.active:
            self._goal.fault = text

    def _record(
        self,
        instance: Instance,
        tick: Tick,
        trigger: str,
        consumed: tuple[tuple[str, tuple[int, ...]], ...],
        spent: int,
        fault: str,
    ) -> None:
        role, name = instance.spec.role, instance.name
        version, told = self._versions.get((role, name), 0), getattr(instance.node, "told", "")
        record = StepRecord(
            role, name, tick.number, trigger, consumed, version, 0, spent, tick.time_ns, tick.epoch, fault, told
        )
        for observer in self._step_observers:
            observer.on_step(record)

    def _take(self, request: OperatorRequest) -> None:
        """Hand a request to the nodes, and do what only the executor can: parameters, and waking who waits."""
        self._operator.requests.append(request)
        if request.do == "set":
            self.configure(request.role, request.instance, request.values)
            key = (request.role, request.instance)
            self._versions[key] = self._versions.get(key, 0) + 1
        elif request.do == "swap":
            self._by_name[(request.role, request.instance)].enabled = True

    def _select(self, selection: Selection) -> None:
        """Lead every wire to the instances now in charge."""
        self._selection = None
        self._epoch = selection.epoch
        for entry in selection.instances:
            role, name = entry.split(" ", 1)
            old, new = self._active[role], self._by_name[(role, name)]
            if old is new:
                continue
            old.active, new.active = False, True
            self._active[role] = new
            for instance in self.instances:
                for wire in instance.wires:
                    if wire.input.role == role:
                        wire.lead_to(new.slots[wire.input.port])
        self.log.swaps = selection.epoch

    def _node(self, role: str, kind: type[T]) -> T:
        node = self._active[role].node
        assert isinstance(node, kind)
        return node

    def _watch(self, observers: Sequence[Observer]) -> None:
        self._active["gate"].slots["selection"].watchers.append(self._on_selection)
        self._active["gate"].slots["status"].watchers.append(self._on_status)
        self._active["goal"].slots["result"].watchers.append(self._on_result)
        for instance in self.instances:
            for port, slot in instance.slots.items():
                for observer in observers:
                    if observer.wants is None or (instance.spec.role, port) in observer.wants:
                        slot.watchers.append(_watcher(observer, instance, port))

    def _on_selection(self, message: Message, at: Envelope) -> None:
        assert isinstance(message, Selection)
        self._selection = message if message.epoch else None

    def _on_status(self, message: Message, at: Envelope) -> None:
        assert isinstance(message, GateStatus)
        self.log.hear_gate(message)

    def _on_result(self, message: Message, at: Envelope) -> None:
        assert isinstance(message, GoalResult)
        self.log.results.append(message)


def _watcher(observer: Observer, instance: Instance, port: str) -> Callable[[Message, Envelope], None]:
    role, name = instance.spec.role, instance.name

    def watch(message: Message, at: Envelope) -> None:
        observer.on_message(role, name, instance.active, port, message, at)

    return watch
