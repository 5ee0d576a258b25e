"""One process of a live robot: its nodes, each on its own thread, over one Zenoh session."""

from __future__ import annotations

import math
import os
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from navloom.engine.catalogue import FRAMEWORK, Catalogue
from navloom.engine.lockstep_builder import own_node
from navloom.engine.nodes.gate_node import GateNode
from navloom.engine.nodes.goal_node import GoalNode
from navloom.engine.nodes.node_base import Node
from navloom.engine.plugin_factory import configure, make_plugins, role_nodes
from navloom.engine.system import System
from navloom.messages import Parameters
from navloom.plugins.code_owners import home_of, place_in

from navloom_live.hosting.addition_wiring import AddedInstances
from navloom_live.hosting.fork_inheritance import keep_from_children
from navloom_live.hosting.heartbeat import StopDetector
from navloom_live.hosting.node_services import Services
from navloom_live.hosting.process_warnings import ProcessWarnings
from navloom_live.live.barrier import BarrierEnded
from navloom_live.live.barrier_runner import BarrierRunner
from navloom_live.live.live_gate import LiveGate
from navloom_live.live.live_goal import LiveGoal
from navloom_live.live.live_node import Source
from navloom_live.live.live_node_builder import Hosted, all_sources, make_cell
from navloom_live.live.live_platform import LivePlatform
from navloom_live.live.live_runner import LiveRunner
from navloom_live.live.node_placement import spread
from navloom_live.live.presence import Presence, life_here
from navloom_live.live.process_streams import Switchboard
from navloom_live.live.replicated_state import Memory
from navloom_live.live.replicated_state_reader import MemoryReader
from navloom_live.live.requests import Extend, Extended
from navloom_live.live.run_clock import RunClock
from navloom_live.timing import PATIENT_STEP_LIMIT, RECORDER_WAIT, STATE_RECALL_WAIT, WATCH_INTERVAL
from navloom_live.transport.keyspace import ATTENDANT, LINKED, KeySpace
from navloom_live.transport.links import Link
from navloom_live.transport.zenoh_bus import Bus, BusError

__all__ = ["HUNG", "NodeProcess", "Share", "leave", "longest_seizure", "longest_step"]

HUNG = 70
"""Exit code of a process that ended because a node hangs."""
RECORDER_START_LIMIT = 20.0
"""How long after the robot's start its platform may wait for a recorder, s."""


@dataclass(frozen=True)
class Share:
    """What one process runs.

    Attributes:
        name: Name of the process.
        sources: Its nodes.
        link: How it joins the robot's network.
        barrier: Ticks run under the barrier instead of by the wall clock.
        start_ns: Platform host's monotonic clock at run clock 0, ns.
        attended: A recorder joins the robot: the platform begins once it listens.
        joins: The process joins a robot that is up: if that is attended, it begins once the recorder listens to it.
    """

    name: str
    sources: tuple[Source, ...]
    link: Link
    barrier: bool = False
    start_ns: int = 0
    attended: bool = False
    joins: bool = False


@dataclass(eq=False)
class NodeProcess:
    """Runs its share of a robot until `ending` is set.

    Attributes:
        system: The robot; only the plugins of this share are made.
        share: What runs here.
        ending: Set it to end the process.
        known: The supervisor's copy of the robot's memory, see `Memory`.
        runners: Runner of each node, by source, once it runs.
        hung: Why the process ends for a hanging node; empty for none.
        life: Distinguishes this process from its successor.
    """

    system: System
    share: Share
    ending: threading.Event = field(default_factory=threading.Event)
    known: bytes = b""
    runners: dict[Source, LiveRunner | BarrierRunner] = field(default_factory=dict)
    hung: str = ""
    life: str = field(default_factory=life_here)
    warnings: ProcessWarnings = field(init=False)
    _heard: threading.Event = field(default_factory=threading.Event)
    _is_fork: bool = False

    def run(
        self,
        say: Callable[[str], None] = lambda text: None,
        ready: Callable[[], None] = lambda: None,
        alive: Callable[[], None] = lambda: None,
    ) -> None:
        """Join, step, leave. Returns when `ending` is set, or an active node hangs.

        Args:
            say: Receives messages about what is being prepared.
            ready: Called once every node runs.
            alive: Called regularly while no active node hangs, for instance to feed a service manager's watchdog.

        Raises:
            ConfigError, LinkError, BusError: Nothing ran.
        """
        self.warnings = ProcessWarnings(self.system, self.share.sources)
        with self.warnings.watch():
            self._run(say, ready, alive)

    def _run(self, say: Callable[[str], None], ready: Callable[[], None], alive: Callable[[], None]) -> None:
        make_plugins(self.system, say, self.share.sources)

        def goes_on() -> bool:
            alive()
            return not self.ending.is_set()

        try:
            joined = Bus(self.share.link, math.inf, say, goes_on)
        except BusError:
            # An ending process gives up waiting for the network, which is no failure.
            if self.ending.is_set():
                return
            raise
        with joined as bus:
            # After joining, when the sockets exist, and before any plugin steps, which may start a program.
            keep_from_children(self.share.link, self._forked)
            threads = self._start(bus, ready, alive)
            self._watch(threads, alive)
            self.ending.set()
            for runner in self.runners.values():
                runner.cell.mailbox.ring()
            for thread in threads:
                # With a limit: a plugin may be in a long step, and the supervisor waits no longer either.
                thread.join(1.0)

    def _forked(self) -> None:
        """Mark this process as a plugin's fork, which must not continue as a node."""
        self._is_fork = True

    def _is_over(self) -> bool:
        return self._is_fork or self.ending.is_set()

    def _start(self, bus: Bus, ready: Callable[[], None], alive: Callable[[], None]) -> list[threading.Thread]:
        robot = self.system.config.robot
        keys = KeySpace(robot.realm, robot.name)
        clock, memory = RunClock(), Memory()
        age = None if self.share.barrier else clock.age_s
        board = Switchboard(bus, keys, self.share.barrier, age, self.system.catalogue)
        nodes = self._nodes()
        hosted = {source: make_cell(self.system, source, node, board) for source, node in nodes.items()}
        if self.share.barrier:
            self.runners = {source: self._barrier_runner(cell) for source, cell in hosted.items()}
            runs: dict[str, Callable[[], None]] = {}
            live: dict[Source, LiveRunner] = {}
            extend: Callable[[Extend], Extended] | None = None
        else:
            # The supervisor's copy first: with all nodes in one process, nobody else could answer.
            memory.learn(self.known)
            self._recollect(bus, keys, memory)
            presence = Presence(keys, set(nodes), self._came)
            live = {source: self._live_runner(cell, clock, memory, presence) for source, cell in hosted.items()}
            self.runners = dict(live)
            if self.share.attended:  # the platform waits for it; all others learn of its subscriptions with the token
                bus.watch(keys.process(ATTENDANT, LINKED), lambda key, alive: self._heard.set())
            monitor = MemoryReader(self.system, board, clock, memory, self._wake, self._is_over)
            fetching = threading.Thread(target=presence.follow, args=(board.fetch, self._is_over), daemon=True)
            for source, runner in live.items():
                if source in self.system.parts:
                    runner.cell.outlets["parameters"] = board.outlet(source, "parameters")
            self._restore(live, memory)
            runs = {"memory": monitor.run}
            extend = AddedInstances(self.system, hosted, live, board, monitor).extend
        services = Services(self.system, self.share.name, keys, bus, hosted, live, memory, clock, board, self.warnings)
        # Connected once all inlets are made: no message may arrive at half a node.
        board.connect()
        services.offer(extend)
        if self.share.barrier:
            self._await_others(bus, keys, alive)
        else:
            bus.watch(keys.alive("*", "*", "*"), lambda key, alive: self._change(presence, key, alive))
            fetching.start()
            if self.share.attended and self.share.joins:
                self._heard.wait(RECORDER_WAIT)  # a recorder that is gone by now must not keep it from its work
        runs |= {" ".join(source): runner.run for source, runner in self.runners.items()}
        threads = [threading.Thread(target=run, name=name, daemon=True) for name, run in runs.items()]
        for thread in threads:
            thread.start()
        for source in nodes:
            # Last: who sees the token expects that this node can receive.
            bus.announce(keys.alive(*source, self.life))
        ready()
        return threads

    def _await_others(self, bus: Bus, keys: KeySpace, alive: Callable[[], None]) -> None:
        """Wait until this process and all others receive each other: under the barrier no message may be lost.

        A token is declared after the streams that its process reads, on the same link: a process that sees the token
        can send to all these streams.
        """
        wanted = set(spread(self.system.config, all_sources(self.system), None))
        seen: set[str] = {self.share.name}

        def change(key: str, alive: bool) -> None:
            if alive:
                seen.add(key.split("/")[-2])

        bus.watch(keys.process("*", LINKED), change)
        bus.announce(keys.process(self.share.name, LINKED))
        while not wanted <= seen and not self.ending.wait(0.005):
            alive()

    def _recollect(self, bus: Bus, keys: KeySpace, memory: Memory) -> None:
        """Query all other processes for the robot's memory. Those behind a new link are known a moment after it."""
        limit, link = time.monotonic() + STATE_RECALL_WAIT, self.share.link
        peers = link.peers if link.mesh is None else link.mesh.link.peers
        # A process that has just started does not know the run clock yet; behind a router, others may appear later.
        needs_clock = link.is_spread and any(role == "platform" for role, _ in self.share.sources)
        while bus.neighbours():
            answers = list(bus.ask(keys.process("*", "memory"), timeout=1.0))
            for answer in answers:
                memory.learn(answer.data)
            is_enough = len(answers) >= max(1, peers) and (memory.clock_ns >= 0 or not needs_clock)
            if is_enough or time.monotonic() > limit:
                return
            # Answers come from processes that may just be joining, too.
            time.sleep(0.02)

    def _nodes(self) -> dict[Source, Node]:
        """The nodes of this share in the order of the graph."""
        plugins = role_nodes(self.system, self.share.sources)
        made: dict[Source, Node] = {}
        for source in all_sources(self.system):
            if source in self.share.sources:
                own = own_node(self.system, source[0], lambda role, name: False, is_live=not self.share.barrier)
                made[source] = own if own is not None else plugins[source]
        return made

    def _barrier_runner(self, hosted: Hosted) -> BarrierRunner:
        def check() -> None:
            if self._is_over():
                raise BarrierEnded

        source = hosted.cell.source
        return BarrierRunner(
            hosted.cell, hosted.requests, hosted.selection, self.system,
            lambda values: self.configure(source, values), check,
        )  # fmt: skip

    def _live_runner(self, hosted: Hosted, clock: RunClock, memory: Memory, presence: Presence) -> LiveRunner:
        config = self.system.config
        role = hosted.cell.source[0]
        common = (hosted, clock, config.run.period, self._is_over)
        if role == "platform":
            # Other processes follow the clock of the previous platform, so it must not go back.
            start_ns = min(self.share.start_ns, time.monotonic_ns() - memory.clock_ns)
            return LivePlatform(*common, config.gate.stop_deadline, start_ns, self._may_begin, presence.processes)
        if role == "gate":
            return LiveGate(*common, presence, self.system)
        return LiveGoal(*common) if role == "goal" else LiveRunner(*common)

    def _may_begin(self) -> bool:
        """Whether the recorder listens, or is late; a platform restarting after RECORDER_START_LIMIT does not wait."""
        late = time.monotonic_ns() - self.share.start_ns > RECORDER_START_LIMIT * 1e9
        # A mapper with memory could not be replayed if the recorder missed its first scans.
        return not self.share.attended or late or self._heard.is_set()

    def configure(self, source: Source, values: tuple[str, ...]) -> None:
        """Change an instance's parameters, all or none. Raises ConfigError for values that do not fit."""
        configure(self.system, *source, values)

    def _restore(self, live: Mapping[Source, LiveRunner], memory: Memory) -> None:
        """Continue where an earlier process of this share was, as far as the memory tells."""
        for source, runner in live.items():
            if memory.selected:
                # A process that restarts during a drive must not bring back the instances of the config.
                runner.recall(memory.selected, max(0, memory.epoch))
            version, values = memory.parameters.get(" ".join(source), (0, ()))
            if values:
                self.configure(source, values)
                runner.cell.versions = version
                runner.cell.outlets["parameters"].publish(Parameters(version, values), 0, 0, 0, 0)
            node = runner.cell.node
            if isinstance(node, GateNode) and memory.epoch >= 0:
                # An operator's stop must hold, even if the gate is killed.
                node.restore(memory.epoch, memory.selected, memory.stop[1])
            if isinstance(node, GoalNode) and memory.goal[0] >= 0:
                node.machine.begin(memory.goal[0] + 1, memory.goal[1])

    def _wake(self, entry: str) -> None:
        """Enable an instance that is to take over."""
        role, _, name = entry.partition(" ")
        runner = self.runners.get((role, name))
        if runner is not None:
            runner.cell.stepper.enabled = True
            runner.cell.mailbox.ring()

    def _change(self, presence: Presence, key: str, alive: bool) -> None:
        """Take the appearance or disappearance of a token; the gate checks at once whether a required node is gone."""
        presence.change(key, alive)
        for runner in self.runners.values():
            if isinstance(runner, LiveGate):
                runner.cell.mailbox.ring()

    def _came(self, source: Source, again: bool) -> None:
        """An instance came up: tell the goal if it is active and was restarted."""
        for runner in self.runners.values():
            if isinstance(runner, LiveGoal) and again and runner.cell.in_charge(source):
                runner.change(lambda runner=runner: runner.goal.restarted.add(source[0]))  # type: ignore[misc]

    def _watch(self, threads: Sequence[threading.Thread], alive: Callable[[], None]) -> None:
        """Wait for the end; give up if an active node hangs in its step or a thread died."""
        limit = self.system.config.live.hang_timeout
        stops = StopDetector()
        while not self.ending.wait(WATCH_INTERVAL):
            went_on_ns = stops.look()
            for source, runner in self.runners.items():
                stepper = runner.cell.stepper
                since_ns = stepper.busy_since_ns
                allowed = longest_step(source[0], limit, self.system.catalogue)
                # A shadow that hangs disturbs nobody, and ticks of the barrier have no deadline.
                if not stepper.active or since_ns is None or isinstance(runner, BarrierRunner):
                    continue
                # A host in suspend, or a debugger, stops the whole process: that is no hanging node.
                if time.monotonic_ns() - max(since_ns, went_on_ns) > allowed * 1e9:
                    self.hung = f"{' '.join(source)} has been in one step for {allowed:g} s{_at(source, stepper.node)}"
                    return
            if not all(thread.is_alive() for thread in threads):
                self.hung = "a node's thread ended unexpectedly"
                return
            alive()


def _at(source: Source, node: Node) -> str:
    """The line of its plugin that a node is executing, as the end of a message; empty for none."""
    idents = [thread.ident for thread in threading.enumerate() if thread.name == " ".join(source)]
    # The private function is the only way to another thread's stack.
    frame = sys._current_frames().get(idents[0] or 0) if idents else None
    place = place_in(frame, home_of(type(getattr(node, "plugin", node))))
    return f": it is at {place}" if place else ""


def longest_step(role: str, hang_timeout: float, catalogue: Catalogue = FRAMEWORK) -> float:
    """Longest step of a role before its process ends, s; from `live.hang_timeout`."""
    return max(hang_timeout, PATIENT_STEP_LIMIT) if catalogue.is_patient(role) else hang_timeout


def longest_seizure(sources: Sequence[Source], hang_timeout: float) -> float:
    """How long one of these nodes may hold the GIL of their process, s.

    This is the limit of the least patient node. The goal does not count: in one process with a mapper or planner it
    has to wait.
    """
    roles = [role for role, _ in sources if role != "goal"]
    return min((longest_step(role, hang_timeout) for role in roles), default=hang_timeout)


def leave(process: NodeProcess) -> int:
    """The exit code. A process with a hanging node exits at once, since its thread cannot be ended."""
    if process.hung:
        os._exit(HUNG)
    return 0
