"""The live gate on the clock of a test, which also says which nodes are alive and what they publish."""

from __future__ import annotations

from typing import Any

from cell_rig import give, inlets, silent_bus
from navloom.config import load_config
from navloom.engine.build import assemble
from navloom.engine.lockstep_builder import own_node
from navloom.engine.nodes.gate_node import GateNode
from navloom.engine.system import System
from navloom.messages import Command, Drive, Odometry, PortMark, Pose2D, StepReport, Twist2D
from navloom_live.live.live_gate import LiveGate
from navloom_live.live.live_node import Source
from navloom_live.live.live_node_builder import Hosted, all_sources, make_cell
from navloom_live.live.presence import Presence
from navloom_live.live.process_streams import Switchboard
from navloom_live.live.run_clock import RunClock
from navloom_live.transport.keyspace import KeySpace

PERIOD = 0.05
MS = 1_000_000
GOAL = ("goal", "main")
KEYS = KeySpace("lab", "r1")
OTHER = ("avoider", "other")
SHADOW = 'alternative=[{name="other", role="avoider", plugin="vfh"}]'
SYSTEM = assemble(load_config("paper", [SHADOW]))
PLATFORM = ("platform", SYSTEM.config.platform.instance)
STILL, AHEAD, ORIGIN = Twist2D(0.0, 0.0, 0.0), Twist2D(0.1, 0.0, 0.0), Pose2D(0.0, 0.0, 0.0)


class SetClock(RunClock):
    """A run clock on a monotonic clock that the test sets, ns."""

    def __init__(self) -> None:
        super().__init__(lambda: self.now)
        self.now = 0

    def observe(self, stamp_ns: int, arrived_ns: int, tick: int) -> None:
        super().observe(stamp_ns, self.now, tick)


class Gate:
    """The runner of the gate; the test sets which nodes are alive, and whether the goal steps by itself."""

    def __init__(self, system: System = SYSTEM) -> None:
        self.clock, self.presence = SetClock(), Presence(KEYS, (), lambda source, restarted: None)
        self.has_stamps, self.goal_steps = False, True
        self.begin(OTHER)
        node = own_node(system, "gate", lambda role, name: False, is_live=True)
        assert isinstance(node, GateNode)
        self.hosted: Hosted = make_cell(system, ("gate", "main"), node, Switchboard(silent_bus(), KEYS, lossless=False))
        self.runner = LiveGate(self.hosted, self.clock, PERIOD, lambda: False, self.presence, system)
        self.node = node

    def begin(self, *sources: Source, life: str = "a") -> None:
        """Nodes of one process announce that they are alive."""
        for source in sources:
            self.presence.change(KEYS.alive(*source, life), True)

    def lose(self, *sources: Source, life: str = "a") -> None:
        """Their tokens are reported as lost."""
        for source in sources:
            self.presence.change(KEYS.alive(*source, life), False)

    def tick(self, tick: int) -> None:
        stamp = round(tick * PERIOD * 1e9)
        self.give(PLATFORM, "odometry", Odometry(stamp, ORIGIN, STILL), tick)
        self.look()

    def report(self, source: Source, published: int, tick: int) -> None:
        """Receive the step report of a node."""
        marks = (PortMark("command", published),)
        self.give(source, "step", StepReport("tick", (), marks, True, 0, 0, 0, "", ""), tick)

    def look(self) -> None:
        if self.goal_steps:
            self._hear(KEYS.port(*GOAL, "step"))
        self.runner.take_in()
        self.runner.act()

    def give(self, source: Source, port: str, message: Any, tick: int, sequence: int | None = None) -> None:
        """Receive a message of a node."""
        stamp = round(tick * PERIOD * 1e9) if self.has_stamps else 0
        give(self.hosted.cell, KEYS.port(*source, port), message, tick, sequence=sequence, stamp_ns=stamp)
        self._hear(KEYS.port(*source, port))

    def _hear(self, key: str) -> None:
        """Let the last message of a stream have arrived now, on the clock of the test."""
        for inlet in inlets(self.hosted.cell, key):
            inlet.heard_ns = self.clock.now


def follow(gate: Gate) -> None:
    """Follow a trajectory; the commands of its first tick arrive 4 ms after the tick."""
    gate.begin(*all_sources(SYSTEM))
    gate.give(("goal", "main"), "drive", Drive(1, 1, None, False), 0)
    gate.tick(0)
    gate.clock.now += 4_000_000
    for role in ("controller", "avoider"):
        gate.give((role, gate.node.selected[role]), "command", Command(AHEAD), 0)
    gate.look()
    assert gate.hosted.cell.stepper.stepped == 0


def rings(gate: Gate) -> set[str]:
    return {feed.wire.input.name for feed in gate.hosted.cell.feeds if feed.inlet.rings}


def stamped(system: System = SYSTEM) -> Gate:
    """A gate whose messages have stamps, in a robot whose nodes are all alive."""
    gate = Gate(system)
    gate.has_stamps = True
    gate.begin(*all_sources(system))
    return gate


def at(gate: Gate, ms: float) -> None:
    """Set the clock to a run time, ms."""
    gate.clock.now = round(ms * MS)


def command(gate: Gate, *roles: str, tick: int, twist: Twist2D = AHEAD) -> None:
    for role in roles:
        gate.give((role, gate.node.selected[role]), "command", Command(twist), tick)


def driving(system: System = SYSTEM) -> Gate:
    """A gate that follows a trajectory; it has decided for the ticks 0 to 2, and the clock is at 100 ms."""
    gate = stamped(system)
    gate.give(GOAL, "drive", Drive(1, 1, None, False), 0)
    for tick in range(3):
        at(gate, 50 * tick)
        command(gate, "controller", "avoider", tick=tick)
        gate.tick(tick)
    assert stepped(gate) == 2
    return gate


def stepped(gate: Gate) -> int:
    return gate.hosted.cell.stepper.stepped


def published(gate: Gate, port: str = "command") -> int:
    """Number of messages on a port so far."""
    return gate.hosted.cell.outlets[port].sequence


def last(gate: Gate, port: str = "status") -> Any:
    found = gate.hosted.cell.outlets[port].last
    assert found is not None
    return found[0]
