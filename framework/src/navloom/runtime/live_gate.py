"""The command gate live: it decides once a platform tick, and looks every 10 ms whether the robot must stop."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from navloom.engine.build import System
from navloom.engine.node import Outputs, Tick
from navloom.engine.own_nodes import GateNode
from navloom.engine.told import Obeyed
from navloom.messages import Command, Envelope, OperatorRequest, StepReport
from navloom.navigation.gate import ENDING
from navloom.runtime.cell import Source
from navloom.runtime.cells import Hosted
from navloom.runtime.live import LiveRunner
from navloom.runtime.run_clock import RunClock

__all__ = ["BETWEEN", "CHECK", "LiveGate", "held_rate", "hold"]

CHECK = 0.01
"""s between two looks."""
BETWEEN = "check"
"""Trigger of a step record of a stop between two ticks."""
LEAD = 2
"""Ticks a selection is announced ahead, so that every host knows it when it begins to hold."""
HOLD, HOLD_MOST, HOLD_LEAST = 0.4, 0.8, 0.008
"""Share of the period that a tick's commands may take to come in; of a short period more, so that they have 8 ms."""
CHAINS = 1000
"""Ticks whose commands' times are kept."""
CHAIN = ("controller", "avoider")
"""Whose commands belong to each tick of a robot that follows a trajectory."""
GOAL_SILENCE = 0.5
"""s the goal may not step before what it authorised ends."""


def hold(period: float) -> float:
    """s after a platform stamp that the gate waits for the commands of its tick.

    Longer would cost a robot with ticks of 50 ms its way past one late command: decided on late as well, the command of
    the tick before would go stale.
    """
    return min(HOLD_MOST * period, max(HOLD * period, HOLD_LEAST))


def held_rate(seconds: float) -> float:
    """Ticks per s, at most, whose commands are waited for where they take s to come in: the inverse of `hold`."""
    return (HOLD_MOST if seconds <= HOLD_LEAST else HOLD) / seconds


class LiveGate(LiveRunner):
    """Steps the gate.

    Args:
        hosted, clock, period, ends: See `LiveRunner`.
        deadline: s without a platform stamp after which it is silent.
        is_alive: Whether an instance's liveliness token is there.
        system: The robot.

    Attributes:
        chains_s: From a platform stamp until every command of its tick was here, s, newest last; in time or not.
    """

    def __init__(
        self,
        hosted: Hosted,
        clock: RunClock,
        period: float,
        ends: Callable[[], bool],
        deadline: float,
        is_alive: Callable[[Source], bool],
        system: System,
    ) -> None:
        super().__init__(hosted, clock, period, ends)
        assert isinstance(self.cell.node, GateNode)
        self.gate = self.cell.node
        self.gate.is_warm = self._is_warm
        self.gate.lead = LEAD
        self.deadline, self.is_alive = deadline, is_alive
        self._feeds = {feed.wire.input.name: feed for feed in self.cell.feeds}
        self._marks: dict[Source, dict[str, int]] = {}
        self._enabled: dict[Source, bool] = {}
        self._goal_heard = time.monotonic()
        self._catalogue, self._required = system.catalogue, system.catalogue.required_roles()
        self._may_wait, self._waiting = system.may_wait, dict[Source, str]()
        self.gate.find_waiting = self._find_waiting
        self.chains_s: deque[float] = deque(maxlen=CHAINS)
        self._chain: tuple[int, int] | None = None

    def run(self) -> None:
        """Until the process ends; then the robot is told to stand."""
        super().run()
        tick = self._tick(self.clock.tick)
        outputs = self.stepper.run(tick, lambda tick: self.gate.stop(ENDING, tick.time_ns))
        self.publish(outputs, tick)

    def begin_anew(self, tick: int) -> None:
        """Selections hold at once by the new clock."""
        super().begin_anew(tick)
        self._chain = None
        self.gate.begin_anew()

    def wait_time(self) -> float:
        """s to wait for news at most."""
        return CHECK

    def act(self) -> None:
        """Decide where a tick is complete or has waited long enough; in between, stop where something is wrong."""
        clock, stepper = self.clock, self.stepper
        if not clock.is_known:
            return
        self.gate.now_ns = clock.now_ns()
        self.gate.is_silent = clock.silence_s() > self.deadline
        self.gate.gone = self._gone()
        for source in [source for source in self._marks if not self.is_alive(source)]:
            del self._marks[source], self._enabled[source]  # what takes its place has to warm up anew
        number = clock.tick
        self._time_chain(number)
        if number > stepper.stepped and (self._is_complete(number) or clock.silence_s() >= hold(self.period)):
            self.step("tick", number)
            return
        tick = self._tick(number)
        stepper.prepare(number + 1, number)
        outputs = stepper.run(tick, self.gate.check)
        if outputs or stepper.fault:
            self.note()
            self.publish(outputs, tick)
            self.say(tick, BETWEEN, self.cell.read_marks(number + 1, number))

    def obey(self, request: OperatorRequest) -> None:
        """Take an operator's request, on the gate's own thread."""
        slot = self._feeds["operator"].slot
        driving = slot.message if isinstance(slot.message, Command) else None
        sequence = 0 if driving is None else slot.sequence
        self.gate.obeyed.append(Obeyed(request.do, request.role, request.instance, sequence))
        self.gate.obey(request, driving)

    def step(self, trigger: str, number: int) -> None:
        """One decision."""
        self.step_once(self._tick(number), trigger, number - 1)

    def publish(self, outputs: Outputs, tick: Tick) -> None:
        """Send what was decided."""
        self.cell.publish(outputs, tick, self.gate.cause_ns)

    def _tick(self, number: int) -> Tick:
        time_ns = max(0, self.clock.stamp_ns)
        return Tick(max(0, number), time_ns * 1e-9, time_ns, self.cell.epoch)

    def _is_complete(self, number: int) -> bool:
        """Every command that this tick can bring is here."""
        recovering = self._feeds["recovering"].wire.slot.message
        if recovering is not None and getattr(recovering, "active", False):
            return self._feeds["recovery"].wire.slot.tick >= number
        return not self._follows() or all(self._feeds[role].wire.slot.tick >= number for role in CHAIN)

    def _follows(self) -> bool:
        """A trajectory is to be followed."""
        return bool(getattr(self._feeds["drive"].wire.slot.message, "path_id", 0))

    def _time_chain(self, number: int) -> None:
        """Note how long the commands of a tick took; of one that is not complete when the next begins as well."""
        if self._chain is None and number > self.stepper.stepped and self._follows():
            self._chain = number, self.clock.stamp_ns
        if self._chain is not None and self._is_complete(self._chain[0]):
            if self._follows():
                self.chains_s.append(max(0, self.clock.now_ns() - self._chain[1]) * 1e-9)
            self._chain = None

    def _hear(self, source: Source, report: StepReport, at: Envelope) -> None:
        super()._hear(source, report, at)
        self._marks[source] = {mark.port: mark.sequence for mark in report.published}
        self._enabled[source] = report.enabled
        self._waiting[source] = "" if report.trigger else report.told
        if source[0] == "goal":
            self._goal_heard = time.monotonic()

    def _find_waiting(self) -> str:
        """Which active instance waits for a stream, as far as its reports say."""
        found = [self._waiting.get(source, "") for source in self._may_wait if self.cell.in_charge(source)]
        return next(filter(None, found), "")

    def _gone(self) -> str:
        if time.monotonic() - self._goal_heard > GOAL_SILENCE:
            return "goal main does not step"
        for role in self._required:
            name = self.cell.chosen.get(role)
            for source in self.cell.reports:
                if source[0] == role and (name is None or source[1] == name) and not self.is_alive(source):
                    return f"{role} {source[1]}"
        return ""

    def _is_warm(self, role: str, name: str) -> bool:
        ports, marks = self._catalogue.warming_ports(role), self._marks.get((role, name), {})
        return self._enabled.get((role, name), False) and (not ports or any(marks.get(port, 0) for port in ports))
