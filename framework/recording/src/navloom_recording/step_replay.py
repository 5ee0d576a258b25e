"""Replays nodes step by step on the inputs that their step records name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from navloom.config import ConfigError
from navloom.engine.event_schedule import schedule
from navloom.engine.lockstep_builder import own_node
from navloom.engine.nodes.executor_inputs import GateTold, GoalTold, LocalizerTold, gone_of
from navloom.engine.nodes.gate_node import LIVE_LEAD, GateNode
from navloom.engine.nodes.goal_node import GoalNode
from navloom.engine.nodes.localizer_node import LocalizerNode
from navloom.engine.nodes.node_base import Node, Tick
from navloom.engine.open_loop_node import FedNode
from navloom.engine.plugin_factory import configure, make_plugins, role_nodes
from navloom.engine.streams import STEP
from navloom.engine.system import System
from navloom.messages import Command, Envelope, Message, OperatorRequest, Parameters, Selection, StepReport
from navloom.messages.codec import encode, schema_label

from navloom_recording.excerpt import SOURCES, Excerpt, stop_inside
from navloom_recording.message_cache import Entry, Shelf
from navloom_recording.reader import RawRecorded, Recording
from navloom_recording.step_inputs import Chosen, Fed, Feeder, Step

__all__ = ["Again", "ReplayNode", "Replayer", "Stepped"]

WHOLE = Excerpt()
AHEAD_NS = 2_000_000_000
"""Time that is read ahead of a step, ns of receive time: over a network inputs may be received after the record."""

Source = tuple[str, str]


@dataclass
class ReplayNode:
    """A node that is replayed.

    Attributes:
        source, fed: Its role and instance, and the node, which receives its inputs directly.
        versions: Number of parameter changes so far.
        previous: Its previous step record.
        lives: Number of starts of its process, as far as recorded.
        notes: What a reader must know about its replay.
        is_unknown: The recording joined a running node, so that its state at the first recorded step is not known.
    """

    source: Source
    fed: FedNode
    versions: int = 0
    previous: Step | None = None
    lives: int = 1
    notes: list[str] = field(default_factory=list)
    is_unknown: bool = False


@dataclass(frozen=True)
class Stepped:
    """A replayed step.

    Attributes:
        step: Its record.
        fed: Its inputs.
        outputs: Its outputs, with their ports.
        fault: The exception's text; empty if there was none.
        follows: Whether the preceding record exists too, so that all messages in between belong to this step.
    """

    step: Step
    fed: Fed
    outputs: list[tuple[str, Message]]
    fault: str
    follows: bool


Again = Callable[[ReplayNode, Stepped, Shelf], None]


class Replayer:
    """Reads a recording once, from its beginning, and steps nodes on it.

    Args:
        recording: A recording with step records.
        system: System of the nodes; its plugins are created here.
        stand_ins: By role, the instance that makes the steps of the recorded active instance. None: every instance
            makes its own steps.
        say: Receives progress of the preparation.
        excerpt: The steps to make; default all.
    """

    def __init__(
        self,
        recording: Recording,
        system: System,
        stand_ins: Mapping[str, str] | None = None,
        say: Callable[[str], None] = lambda text: None,
        excerpt: Excerpt = WHOLE,
    ) -> None:
        self.recording, self.system, self.header = recording, system, recording.header
        self.stand_ins, self.excerpt = dict(stand_ins or {}), excerpt
        self.shelf = Shelf()
        self.chosen = Chosen(recording.header.loaded().config)
        self.is_live = self.header.kind == "live"
        self.nodes: dict[Source, ReplayNode] = {}
        self.silent: set[Source] = set()
        wanted = {(role, name) for role, name in system.parts if role not in SOURCES}
        if self.stand_ins:
            wanted = {(role, name) for role, name in self.stand_ins.items()}
        elif excerpt.only is not None:
            wanted &= {excerpt.only}
        make_plugins(system, say, wanted)
        self._wanted = wanted
        names: dict[str, list[str]] = {}
        for role, name in recorded_instances(recording):
            names.setdefault(role, []).append(name)
        self.feeder = Feeder(self.header.prefix, self.shelf, self.chosen, names)
        self._changes: dict[Source, list[tuple[str, ...]]] = {}
        self._parameters: dict[Source, dict[int, tuple[str, ...]]] = {}
        self._places: list[tuple[int, OperatorRequest]] = []
        if self.header.kind == "barrier":
            self._put_schedule()

    def _put_schedule(self) -> None:
        """Add the operator's requests of a barrier run: they come from the config and are not recorded."""
        key, number = f"{self.header.prefix}/operator/main/request", 0
        for tick, requests in sorted(schedule(self.system.config, self.system.goal).items()):
            stamp_ns = round(tick * self.header.period * 1e9)
            for request in requests:
                number += 1
                data = encode(request, Envelope(key, number, tick, stamp_ns, stamp_ns, 0))
                raw = RawRecorded(key, schema_label(OperatorRequest), memoryview(data), 0, number)
                entry = Entry(raw, 0)
                self.shelf.put(entry)
                self._learn(entry)

    def run(self, again: Again, progress: Callable[[float, float], None] | None = None) -> None:
        """Step through the recording.

        Args:
            again: Called with each replayed step.
            progress: Called with the time replayed so far and the total time, s.
        """
        waiting: list[Step] = []
        first_ns, last_ns = self.recording.span_ns()
        for place, raw in enumerate(self.recording.raw()):
            entry = Entry(raw, place)
            self.shelf.put(entry)
            step = self._learn(entry)
            if step is not None and self.excerpt.has((step.role, step.instance), step.at.tick):
                waiting.append(step)
            # In batches of half the time ahead, so that the list is not searched for each message.
            if waiting and raw.received_ns - waiting[0].received_ns > AHEAD_NS:
                ready = [one for one in waiting if raw.received_ns - one.received_ns > AHEAD_NS // 2]
                waiting = waiting[len(ready) :]
                self._make(ready, again)
                if progress is not None:
                    progress((raw.received_ns - first_ns) * 1e-9, (last_ns - first_ns) * 1e-9)
        self._make(waiting, again)

    def _make(self, steps: list[Step], again: Again) -> None:
        for step in steps:
            node = self._node_of(step)
            if node is not None:
                stepped = self._step(node, step)
                if stepped is not None:
                    again(node, stepped, self.shelf)

    def _learn(self, entry: Entry) -> Step | None:
        """Store what the replay itself needs from a message; returns the step if it is a step record."""
        raw = entry.raw
        role, name, port = raw.key.split("/", 2)[-1].split("/", 2)
        if port not in (STEP, "selection", "parameters", "request"):
            return None
        opened = entry.open()
        if opened is None:
            return None
        message, at = opened.message, opened.envelope
        if isinstance(message, Selection):
            self.chosen.learn(message)
        elif isinstance(message, Parameters):
            self._parameters.setdefault((role, name), {})[message.version] = message.values
        elif isinstance(message, OperatorRequest) and message.do == "set":
            self._changes.setdefault((message.role, message.instance), []).append(message.values)
        elif isinstance(message, OperatorRequest) and message.do in ("place", "relocalise"):
            self._places.append((at.tick, message))
        elif isinstance(message, StepReport):
            return Step(role, name, message, at, entry.place, raw.received_ns)
        return None

    def _node_of(self, step: Step) -> ReplayNode | None:
        """The node that replays a step; None if no node does."""
        source = (step.role, step.instance)
        if step.role in self.stand_ins:
            if self.chosen.under(step.role, step.at.epoch) != step.instance:
                return None
            source = (step.role, self.stand_ins[step.role])
        elif self.stand_ins or step.role in SOURCES:
            return None
        if source not in self.nodes:
            if source not in self._wanted and source not in self.system.wiring:
                # A node whose plugin is not installed here: `check` tells about it.
                self.silent.add(source)
                return None
            self.nodes[source] = self._begin(source)
        return self.nodes[source]

    def _begin(self, source: Source) -> ReplayNode:
        """A new node, in its state at the start of its process."""
        role, _ = source
        spec = self.system.wiring[source]
        own = own_node(self.system, role, lambda role, name: False, is_live=self.is_live)
        node = own if own is not None else role_nodes(self.system, {source})[source]
        if isinstance(node, GateNode) and self.is_live:
            node.lead = LIVE_LEAD
        return ReplayNode(source, FedNode(spec, node))

    def _step(self, node: ReplayNode, step: Step) -> Stepped | None:
        before = node.previous
        # A falling number: its process was restarted, and with it the state of the plugin.
        if before is not None and before.instance == step.instance and step.at.sequence <= before.at.sequence:
            self._start_again(node, step)
            before = None
        elif before is None and step.at.sequence > 1 and self.is_live:
            node.is_unknown = True
            node.notes.append(
                f"the recording begins after its first step, so its state at tick {step.at.tick} is not known"
            )
        same = before is not None and before.instance == step.instance
        follows = before is not None and same and step.at.sequence == before.at.sequence + 1
        if before is None:
            follows = step.at.sequence == 1
        elif same and not follows:
            lacking = step.at.sequence - before.at.sequence - 1
            node.notes.append(f"{lacking} step records before tick {step.at.tick} are missing")
        node.previous = step
        if not step.report.trigger:
            return Stepped(step, Fed(), [], "", follows)
        self._change_parameters(node, step)
        since = before.at.tick if before is not None else step.at.tick - 1
        localizer = node.fed.node
        if isinstance(localizer, LocalizerNode):
            for at, request in self._places:
                if since < at <= step.at.tick:
                    localizer.place(request, is_active=False)  # the recorded run has refused it if it had to
            for request in LocalizerTold.of(step.report.told).requests:
                localizer.place(request, is_active=False)
        fed = self.feeder.feed(node.fed.spec, step, since)
        tick = Tick(step.at.tick, step.at.stamp_ns * 1e-9, step.at.stamp_ns, step.at.epoch)
        act = self._tell(node.fed.node, step)
        if self.excerpt.debugs(step.at.tick):
            act = stop_inside(node.fed.node, act)
        outputs = node.fed.step(tick, fed.given, act)
        return Stepped(step, fed, outputs, node.fed.fault, follows)

    def _tell(self, node: Node, step: Step) -> Callable[[Tick], None]:
        """Set the state that the executor gave to a node, and return the function to call."""
        if isinstance(node, GoalNode):
            of_goal = GoalTold.of(step.report.told)
            node.fault, node.is_lost, node.restarted = of_goal.fault, of_goal.lost, set(of_goal.restarted)
        if not isinstance(node, GateNode):
            return node.step
        told = GateTold.of(step.report.told)
        node.is_warm = lambda role, name: f"{role} {name}" in told.warm
        node.find_waiting = lambda: told.waiting
        if self.is_live:
            # What the executor told the gate beside its inputs decides as they do.
            node.now_ns, node.is_silent, node.gone = told.now_ns or 0, told.silent, gone_of(told.gone)
            node.has_new_platform, node.late = told.restarted, told.late
            node.gate.speed_limit = told.speed_limit
            for one in told.obeyed:
                entry = self.shelf.get(f"{self.header.prefix}/operator/main/command", one.driving, step.place)
                opened = entry.open() if entry is not None and one.driving else None
                driving = opened.message if opened and isinstance(opened.message, Command) else None
                node.obey(OperatorRequest(one.do, None, one.role, one.instance), driving)
            if told.contact and not node.gate.has_contact:
                node.gate.latch_contact()
        return node.check if step.report.trigger == "check" else node.step

    def _start_again(self, node: ReplayNode, step: Step) -> None:
        """Restart the node, because its process was restarted."""
        node.lives += 1
        node.notes.append(f"its process was restarted before tick {step.at.tick}")
        if node.source in self.system.parts:
            make_plugins(self.system, only={node.source})
        fresh = self._begin(node.source)
        node.fed, node.versions, node.is_unknown = fresh.fed, 0, False
        if isinstance(node.fed.node, (GateNode, GoalNode)):
            node.notes.append("what it received from the other processes at that time is not recorded")

    def _change_parameters(self, node: ReplayNode, step: Step) -> None:
        """Bring a plugin's parameters to the version of a step."""
        role, name = node.source
        if role in self.stand_ins or node.source not in self.system.parts:
            return
        for version in range(node.versions + 1, step.report.params_version + 1):
            # Live they are published; in other runs they are requests of the operator.
            kept, asked = self._parameters.get(node.source, {}), self._changes.get(node.source, [])
            values = kept.get(version) if self.is_live else asked[version - 1] if version <= len(asked) else None
            node.versions = version
            if values is None:
                node.notes.append(f"its parameters of version {version} are not in the recording")
                continue
            try:
                configure(self.system, role, name, values)
            except ConfigError as error:
                node.notes.append(f"its parameters of version {version} do not fit: {error}")


def recorded_instances(recording: Recording) -> Iterator[Source]:
    """Role and instance of every node with messages in a recording."""
    keys = recording.keys()
    for node in sorted({key.split("/", 2)[-1].rsplit("/", 1)[0] for key in keys}):
        role, _, name = node.partition("/")
        yield role, name
