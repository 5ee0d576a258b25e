"""The lockstep executor: one process, simulated time, messages passed by reference. Repeatable bit for bit."""

from __future__ import annotations

from array import array
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter_ns
from typing import Protocol, TypeAlias, TypeVar

from navloom.engine.catalogue import Catalogue
from navloom.engine.node_ports import When
from navloom.engine.nodes.gate_node import GateNode
from navloom.engine.nodes.goal_node import GoalNode
from navloom.engine.nodes.localizer_node import LocalizerNode
from navloom.engine.nodes.node_base import Outputs, Tick
from navloom.engine.nodes.operator_node import OperatorNode
from navloom.engine.nondeterminism import StepInspector
from navloom.engine.stepper import Read, Stepper, waiting_words
from navloom.engine.trace import TraceWriter
from navloom.messages import Envelope, GateStatus, GoalResult, Message, Odometry, OperatorRequest, Selection, StepRecord
from navloom.navigation.braking import Braking, Ending

__all__ = ["Lockstep", "Observer", "RunLog"]

T = TypeVar("T")
Keepers: TypeAlias = tuple[Callable[[int], None], ...]
SIMULATED = ("platform", "world")
"""Nodes whose steps no robot has to compute."""
PROGRESS_INTERVAL_NS = 100_000_000
"""Shortest wall time between two reports of progress, ns; slower ticks are each reported."""


class Observer(Protocol):
    """Receives the messages and step records of a run. It must not change them.

    Attributes:
        wants: (role, port) pairs of the messages that it receives; None for all.
        wants_steps: Whether it receives step records.
    """

    wants: frozenset[tuple[str, str]] | None
    wants_steps: bool

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        """A message was published."""

    def on_step(self, record: StepRecord) -> None:
        """A node stepped, silent or not."""


def _no_times() -> array[int]:
    """Of the module, so that a log can be sent to another process."""
    return array("q")


@dataclass
class RunLog:
    """Results and timings of a run.

    Attributes:
        results: Result of each goal, in order.
        ticks: Number of ticks.
        tick_ns: Wall time of each tick.
        control_ns, control_cpu_ns: Wall time and CPU time of each tick's steps of the active nodes except platform and
            world; empty if not measured.
        step_ns: By role, wall time of each step of planner and mapper.
        spent_ns, computed_ns: By role and instance, wall time and CPU time of each step; empty for a live run.
        wall_ns: Wall time from the first tick to the last.
        swaps: Number of selections after the first.
        gate_stops: How often the gate stopped a driving robot.
        gate_limits: How often its monitor began to slow or stop the robot.
        faults: "role instance failed: cause" for each plugin that failed.
        failed: Role, instance and tick of each of them.
        trace_sha256: Hash of the trace.
    """

    results: list[GoalResult] = field(default_factory=list)
    ticks: int = 0
    tick_ns: list[int] = field(default_factory=list)
    control_ns: list[int] = field(default_factory=list)
    control_cpu_ns: list[int] = field(default_factory=list)
    step_ns: dict[str, list[int]] = field(default_factory=lambda: {"planner": [], "mapper": []})
    spent_ns: dict[tuple[str, str], array[int]] = field(default_factory=lambda: defaultdict(_no_times))
    computed_ns: dict[tuple[str, str], array[int]] = field(default_factory=lambda: defaultdict(_no_times))
    wall_ns: int = 0
    swaps: int = 0
    gate_stops: int = 0
    gate_limits: int = 0
    faults: list[str] = field(default_factory=list)
    failed: list[tuple[str, str, int]] = field(default_factory=list)
    trace_sha256: str = ""
    _stopped_for: str = ""
    _limited_by: str = ""

    def hear_gate(self, status: GateStatus) -> None:
        """Count a stop or limit of the gate that the previous status did not have."""
        stopped_for = status.reason if status.interrupts else ""
        self.gate_stops += bool(stopped_for) and stopped_for != self._stopped_for
        limited_by = "" if status.limit == "overridden" else status.limit
        self.gate_limits += bool(limited_by) and not self._limited_by
        self._stopped_for, self._limited_by = stopped_for, limited_by


class Lockstep:
    """Steps the nodes of a graph in order, tick by tick.

    Args:
        catalogue: The robot's nodes.
        steppers: In the order they step; of a role the active one first.
        period: Length of a tick, s.
        braking: How the robot comes to rest, which the end of a run waits for.
        requests: Operators' requests by tick.
        configure: Changes parameters for `set`: (role, instance, assignments).
        observers: Receive messages and step records.
        trace: Receives the active nodes' messages.

        Attributes:
            inspector: Runs and inspects the steps of some ticks; None for no inspection.
    """

    def __init__(
        self,
        catalogue: Catalogue,
        steppers: Sequence[Stepper],
        period: float,
        braking: Braking,
        requests: Mapping[int, Sequence[OperatorRequest]],
        configure: Callable[[str, str, tuple[str, ...]], None],
        observers: Sequence[Observer] = (),
        trace: TraceWriter | None = None,
    ) -> None:
        self.catalogue = catalogue
        self.steppers = list(steppers)
        self.period = period
        self.requests = dict(requests)
        self.configure = configure
        self.trace = trace or TraceWriter()
        self.log = RunLog()
        self._ending = Ending(braking, max(self.requests, default=0))
        self._by_name = {(stepper.role, stepper.name): stepper for stepper in self.steppers}
        self._active = {stepper.role: stepper for stepper in self.steppers if stepper.active}
        self._delayed = [stepper for stepper in self.steppers if stepper.delay]
        self._plan: list[tuple[Stepper, int, Keepers, Keepers]] = []
        self._epoch = 0
        self._control_ns: list[int] = []
        self._control_cpu_ns: list[int] = []
        self._versions: dict[tuple[str, str], int] = {}
        self._selection: Selection | None = None
        self._step_observers = [o for o in observers if o.wants_steps]
        self.inspector: StepInspector | None = None
        self._operator = self._node("operator", OperatorNode)
        self._goal = self._node("goal", GoalNode)
        self.gate = self._node("gate", GateNode)
        self._watch(observers)
        self._make_plan()

    def _make_plan(self) -> None:
        """List the enabled steppers, each with its stride and the recorders of its durations; redone at each change."""
        self._plan = [
            (stepper, stepper.stride, tuple(self._keepers(stepper)), tuple(self._cpu_keepers(stepper)))
            for stepper in self.steppers
            if stepper.enabled
        ]

    def _keepers(self, one: Stepper) -> Iterator[Callable[[int], None]]:
        """Functions that record the duration of each step of an instance, ns."""
        log = self.log
        yield log.spent_ns[one.role, one.name].append
        if one.active and one.role in log.step_ns:
            yield log.step_ns[one.role].append
        if one.active and one.role not in SIMULATED:
            yield self._control_ns.append

    def _cpu_keepers(self, one: Stepper) -> Iterator[Callable[[int], None]]:
        """Functions that record the CPU time of each step of an instance, ns."""
        yield self.log.computed_ns[one.role, one.name].append
        if one.active and one.role not in SIMULATED:
            yield self._control_cpu_ns.append

    def is_warm(self, role: str, name: str) -> bool:
        """Whether an instance is enabled and has published its role's result."""
        stepper, ports = self._by_name[(role, name)], self.catalogue.warming_ports(role)
        return stepper.enabled and (not ports or any(stepper.slots[port].tick >= 0 for port in ports))

    def waiting(self, may_wait: Sequence[tuple[str, str]]) -> str:
        """The first of these instances that is active and waits for streams, and which streams; empty for none."""
        found = [one for source in may_wait if (one := self._by_name[source]).active and one.lacks]
        return waiting_words(found[0].role, found[0].name, found[0].lacks) if found else ""

    def run(self, ticks: int, progress: Callable[[int], None] | None = None) -> RunLog:
        """Run until the last goal has ended and the robot stands, but at most this many ticks.

        `progress` receives the newest tick.
        """
        # Wall time for the log only; nodes get the run clock.
        started, told = perf_counter_ns(), 0
        try:
            for number in range(ticks):
                is_over = self.tick(number)
                now = perf_counter_ns()
                if progress is not None and now - told >= PROGRESS_INTERVAL_NS:
                    told = now
                    progress(number)
                if is_over:
                    break
        finally:
            # Also after an exception or Ctrl-C: the trace up to there shows what led to it.
            self.trace.flush()
        return self.finish(perf_counter_ns() - started)

    def tick(self, number: int) -> bool:
        """Make one tick. Returns whether the last goal has ended and the robot stands."""
        before = perf_counter_ns()
        self._control_ns.clear()
        self._control_cpu_ns.clear()
        self._step(number)
        self.log.tick_ns.append(perf_counter_ns() - before)
        self.log.control_ns.append(sum(self._control_ns))
        self.log.control_cpu_ns.append(sum(self._control_cpu_ns))
        odometry = self._active["platform"].slots["odometry"].message
        measured = odometry.twist if isinstance(odometry, Odometry) else None
        return self._ending.is_over(number, self._goal.machine.is_idle, self.gate.gate.is_moving, measured)

    def finish(self, wall_ns: int) -> RunLog:
        """Complete the log after the last tick; `wall_ns`: wall time of all ticks."""
        self.log.wall_ns = wall_ns
        self.log.ticks = len(self.log.tick_ns)
        self.log.trace_sha256 = self.trace.sha256()
        return self.log

    def _step(self, number: int) -> None:
        time_ns = round(number * self.period * 1e9)
        # Before anything steps: a tick belongs to one selection as a whole.
        if self._selection is not None and number >= self._selection.from_tick:
            self._select(self._selection)
        for request in self.requests.get(number, ()):
            self._take(request)
        tick = Tick(number, time_ns * 1e-9, time_ns, self._epoch)
        # Held back outputs come first, as live they would arrive before anything of this tick is computed.
        for stepper in self._delayed:
            for outputs, made, cause_ns in stepper.due(number):
                self._publish(stepper, outputs, number, (made.number, made.time_ns, cause_ns, made.epoch))
        inspector = self.inspector if self.inspector is not None and self.inspector.looks_at(number) else None
        for stepper, stride, keeps, cpu_keeps in self._plan:
            if stride != 1 and number % stride != 0:
                continue
            trigger = stepper.fired(number)
            if not trigger:
                continue
            since = number - stride
            # Before the step, which empties the queues.
            read = stepper.read_marks(number, since) if self._step_observers else ()
            outputs = stepper.step(tick, since) if inspector is None else inspector.step(stepper, tick, since)
            for keep in keeps:
                keep(stepper.spent_ns)
            for keep in cpu_keeps:
                keep(stepper.computed_ns)
            if stepper.fault:
                self._fault(stepper, stepper.fault)
            if self._step_observers:
                self._record(stepper, tick, trigger, read)
            if not outputs:
                continue
            cause_ns = stepper.cause_of(time_ns)
            if stepper.delay:
                stepper.hold_back(outputs, tick, cause_ns)
            else:
                self._publish(stepper, outputs, number, (number, time_ns, cause_ns, self._epoch))
        self.trace.end_tick(number)

    def _publish(self, stepper: Stepper, outputs: Outputs, number: int, when: When) -> None:
        entries = self.trace.entries if stepper.active else None
        for out, message in outputs:
            slot = out.slot
            slot.put(message, slot.sequence + 1, when, number)
            if entries is not None:
                cls = message.__class__
                entries.append((slot.labels.get(cls) or slot.label(cls), message, when, slot.key))

    def _fault(self, stepper: Stepper, fault: str) -> None:
        """Disable an instance that failed; end the goal if it was active and not optional."""
        text = f"{stepper.role} {stepper.name} failed: {fault}"
        self.log.faults.append(text)
        self.log.failed.append((stepper.role, stepper.name, stepper.stepped))
        # A plugin that raised once may be in any state.
        stepper.enabled = False
        self._make_plan()
        if stepper.active and stepper.role not in self._goal.optional:
            self._goal.fault = text

    def _record(self, stepper: Stepper, tick: Tick, trigger: str, read: Read) -> None:
        role, name = stepper.role, stepper.name
        version, told = self._versions.get((role, name), 0), stepper.node.told
        record = StepRecord(
            role, name, tick.number, trigger, read, version, 0, stepper.spent_ns, tick.time_ns, tick.epoch,
            stepper.fault, told,
        )  # fmt: skip
        for observer in self._step_observers:
            observer.on_step(record)

    def _take(self, request: OperatorRequest) -> None:
        """Pass a request to the operator node, change parameters, and enable the target of a swap."""
        self._operator.requests.append(request)
        if request.do == "set":
            self.configure(request.role, request.instance, request.values)
            key = (request.role, request.instance)
            self._versions[key] = self._versions.get(key, 0) + 1
        elif request.do in ("place", "relocalise"):
            for stepper in self.steppers:
                if isinstance(stepper.node, LocalizerNode):
                    stepper.node.place(request, stepper.active)
        elif request.do == "swap":
            # It steps as a shadow from now on, and takes over once it has published a result.
            self._by_name[(request.role, request.instance)].enabled = True
            self._make_plan()

    def _select(self, selection: Selection) -> None:
        """Connect every wire to the instances that are now active."""
        self._selection = None
        self._epoch = selection.epoch
        for entry in selection.instances:
            role, name = entry.split(" ", 1)
            old, new = self._active[role], self._by_name[(role, name)]
            if old is new:
                continue
            old.active, new.active = False, True
            self._active[role] = new
            for stepper in self.steppers:
                for wire in stepper.wires:
                    if wire.input.role == role:
                        wire.lead_to(new.slots[wire.input.port])
        self._make_plan()
        self.log.swaps = selection.epoch

    def active(self, role: str) -> Stepper:
        """The active instance of a role."""
        return self._active[role]

    def _node(self, role: str, kind: type[T]) -> T:
        node = self._active[role].node
        assert isinstance(node, kind)
        return node

    def _watch(self, observers: Sequence[Observer]) -> None:
        self._active["gate"].slots["selection"].watchers.append(self._on_selection)
        self._active["gate"].slots["status"].watchers.append(self._on_status)
        self._active["goal"].slots["result"].watchers.append(self._on_result)
        for stepper in self.steppers:
            for port, slot in stepper.slots.items():
                for observer in observers:
                    if observer.wants is None or (stepper.role, port) in observer.wants:
                        slot.watchers.append(_watcher(observer, stepper, port))

    def _on_selection(self, message: Message, at: Envelope) -> None:
        assert isinstance(message, Selection)
        # Epoch 0 is the selection of the config, by which the graph is wired already.
        self._selection = message if message.epoch else None

    def _on_status(self, message: Message, at: Envelope) -> None:
        assert isinstance(message, GateStatus)
        self.log.hear_gate(message)

    def _on_result(self, message: Message, at: Envelope) -> None:
        assert isinstance(message, GoalResult)
        self.log.results.append(message)


def _watcher(observer: Observer, stepper: Stepper, port: str) -> Callable[[Message, Envelope], None]:
    role, name, on_message = stepper.role, stepper.name, observer.on_message

    def watch(message: Message, at: Envelope) -> None:
        on_message(role, name, stepper.active, port, message, at)

    return watch
