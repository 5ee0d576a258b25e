"""The gate node live: it decides once per platform tick, and checks in between when an input may have gone stale."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

from navloom.engine.build import stride_of
from navloom.engine.nodes.executor_inputs import Obeyed
from navloom.engine.nodes.gate_node import LIVE_LEAD, GateNode
from navloom.engine.nodes.node_base import Tick
from navloom.engine.system import System
from navloom.messages import Command, Envelope, OperatorRequest, StepReport, StopReason

from navloom_live.live.live_node import Feed, Source
from navloom_live.live.live_node_builder import Hosted, Widening, all_sources
from navloom_live.live.live_runner import LiveRunner
from navloom_live.live.mailbox import Inlet
from navloom_live.live.node_placement import are_on_one_host
from navloom_live.live.presence import Presence
from navloom_live.live.publisher_restarts import RestartWatch, RivalWatch
from navloom_live.live.run_clock import RunClock
from navloom_live.timing import (
    GATE_CHECK_INTERVAL,
    PRESENCE_DOUBT_PERIODS,
    REMOTE_GOAL_SILENCE,
    STALE_CHECK_DELAY,
    command_wait,
)

__all__ = ["BETWEEN", "LiveGate"]

BETWEEN = "check"
"""Trigger in the step record of a stop between two ticks."""
CHAINS = 1000
"""Number of ticks for which `chains_s` is kept."""
DECIDING = ("odometry", "controller", "avoider", "recovery")
"""Inputs of which two publishers stop the robot."""
CHAIN = ("controller", "avoider")
"""Roles whose commands belong to each tick of a robot that follows a trajectory."""


def _between_poses(system: System, period: float) -> float:
    """How much longer than a tick the goal waits for a pose of the slowest localizer, s: it steps with each pose."""
    strides = [stride_of(part.table, period) for (role, _), part in system.parts.items() if role == "localizer"]
    return (max(strides) - 1) * period


class LiveGate(LiveRunner):
    """Steps the gate.

    Args:
        hosted, clock, period, ends: See `LiveRunner`.
        presence: Which instances have a liveliness token.
        system: The robot.

    Attributes:
        deadline: Time without a platform stamp after which the platform is silent, s.
        chains_s: Time from a platform stamp until all commands of its tick had arrived, even late, s; newest last.
    """

    def __init__(
        self,
        hosted: Hosted,
        clock: RunClock,
        period: float,
        ends: Callable[[], bool],
        presence: Presence,
        system: System,
    ) -> None:
        super().__init__(hosted, clock, period, ends)
        assert isinstance(self.cell.node, GateNode)
        self.gate = self.cell.node
        self.gate.is_warm = self._is_warm
        self.gate.lead = LIVE_LEAD
        self.deadline, self.presence = system.config.gate.stop_deadline, presence
        self._feeds = {feed.wire.input.name: feed for feed in self.cell.feeds}
        self._marks: dict[Source, tuple[dict[str, int], bool]] = {}
        self._began_ns = clock.monotonic_ns()
        self._catalogue, required = system.catalogue, system.catalogue.required_roles()
        # All instances, also alternatives: which of them are active is looked up at each check.
        self._needed = [source for source in all_sources(system) if source[0] in required]
        more = _between_poses(system, period)
        # The goal publishes no command that could go stale: its steps are timed instead.
        near = self.deadline + command_wait(period) + more
        self._goal_deadline = near if are_on_one_host(system.config, "goal", "gate") else max(near, REMOTE_GOAL_SILENCE)
        self._doubt_ns = round((min(PRESENCE_DOUBT_PERIODS * period, self.deadline) + more) * 1e9)
        # Never, as an integer: these times are compared with others in nanoseconds.
        self._goal_ends_ns = self._doubt_ends_ns = 2**62
        self._looked_ns = 0
        self._may_wait, self._waiting = system.may_wait, dict[Source, str]()
        self.gate.find_waiting = self._find_waiting
        self.chains_s: deque[float] = deque(maxlen=CHAINS)
        self._chain: tuple[int, int] | None = None
        self._platform = RestartWatch()
        self._awaited_tick = -1
        self._watch_rivals()

    def _watch_rivals(self) -> None:
        """Watch each stream that the gate decides on for a second publisher; operators may be several."""
        for feed in self.cell.feeds:
            if feed.wire.input.name in DECIDING and feed.rivals is None:
                feed.rivals = RivalWatch()

    def admit(self, more: Widening) -> None:
        """As in `LiveRunner`; once it is active, the robot does not drive without it."""
        super().admit(more)
        self._watch_rivals()
        if more.source[0] in self._catalogue.required_roles():
            self._needed.append(more.source)
        self._may_wait.append(more.source)

    def run(self) -> None:
        """Run until the process ends, and then publish a last stop."""
        super().run()
        tick = self._tick(self.clock.tick)
        # The wheels stop with the gate, without waiting until its silence is noticed.
        outputs = self.stepper.run(tick, lambda tick: self.gate.stop(StopReason("ending"), tick.time_ns))
        self.cell.publish(outputs, tick, self.cause_of(tick))

    def begin_anew(self, tick: int) -> None:
        """As in `LiveRunner`; the current selection applies at once by the new clock."""
        super().begin_anew(tick)
        self._chain = None
        self.gate.begin_anew()

    def rings(self, feed: Feed) -> bool:
        """Messages of the goal and the recovery's command; for ticks and their commands see `_await_tick`."""
        return feed.wire.input.name in ("drive", "recovering", "recovery")

    def wait_time(self) -> float:
        """Longest wait for a message, s: until an input that was fresh at the last check may have gone stale."""
        if not self.clock.is_known:
            return GATE_CHECK_INTERVAL
        # Limits in the past were seen by the last check; they must not make this loop spin.
        coming = [limit_ns for limit_ns in self._limits_ns() if limit_ns >= self._looked_ns]
        return min(
            GATE_CHECK_INTERVAL, max(0.0, (min(coming, default=2**62) - self.clock.now_ns()) * 1e-9 + STALE_CHECK_DELAY)
        )

    def _limits_ns(self) -> Iterator[int]:
        """Run clock up to which each input stays fresh, ns."""
        stamp_ns, limits, gate = self.clock.stamp_ns, self.gate.gate.limits, self.gate
        held_ns = round(command_wait(self.period) * 1e9)
        yield stamp_ns + round(self.deadline * 1e9)
        yield self._goal_ends_ns
        yield self._doubt_ends_ns
        if self.clock.tick > self.stepper.stepped:
            yield stamp_ns + held_ns
        yield stamp_ns + round(self.period * 1e9) + held_ns  # the next tick, whose stamp may not wake the gate
        for offer in (gate.operator, gate.recovery, gate.controller, gate.avoider):
            if offer.when is not None:
                yield offer.when[2] + limits.stop_deadline_ns
        for scan in gate.required.values():
            if scan.when is not None:
                yield scan.when[1] + limits.sensor_timeout_ns

    def act(self) -> None:
        """Decide when a tick is complete or has waited long enough; in between, stop if something is wrong."""
        clock, stepper = self.clock, self.stepper
        if not clock.is_known:
            self._await_tick()
            return
        self.gate.now_ns = self._looked_ns = clock.now_ns()
        # By this host's monotonic clock: two hosts need no common time.
        self.gate.is_silent = clock.silence_s() > self.deadline
        self._follow_platform()
        self.gate.late = "" if self._is_goal_in_time() else "goal main"
        self.gate.gone = self._gone()
        for source in [source for source in self.cell.reports if not self.presence.is_alive(source)]:
            self.cell.reports[source].clear()  # its successor has to warm up again
            self._marks.pop(source, None)
        number = clock.tick
        self._time_chain(number)
        if number > stepper.stepped and (self._is_complete(number) or clock.silence_s() >= command_wait(self.period)):
            self.step("tick", number)
        else:
            self._look(number)
        self._await_tick()

    def _look(self, number: int) -> None:
        """Check between two ticks, and stop if something is wrong."""
        tick, stepper = self._tick(number), self.stepper
        # As of the coming tick: what arrived after the last decision counts.
        stepper.prepare(number + 1, number)
        outputs = stepper.run(tick, self.gate.check)
        if outputs or stepper.fault:
            self.note()
            self.tell(outputs, tick, BETWEEN, self.cell.read_marks(number + 1, number))

    def obey(self, request: OperatorRequest) -> None:
        """Take an operator's request, on the gate's own thread."""
        slot = self._feeds["operator"].slot
        driving = slot.message if isinstance(slot.message, Command) else None
        sequence = 0 if driving is None else slot.sequence
        # For the step record: a request by a service is in no stream, and a replay needs it.
        self.gate.obeyed.append(Obeyed(request.do, request.role, request.instance, sequence))
        self.gate.obey(request, driving)

    def step(self, trigger: str, number: int) -> None:
        """One decision."""
        self.step_once(self._tick(number), trigger, number - 1)

    def cause_of(self, tick: Tick) -> int:
        """Platform stamp that the decision derives from."""
        return self.gate.cause_ns

    def _tick(self, number: int) -> Tick:
        time_ns = max(0, self.clock.stamp_ns)
        return Tick(max(0, number), time_ns * 1e-9, time_ns, self.cell.epoch)

    def _is_complete(self, number: int) -> bool:
        """Whether every command expected for this tick has arrived."""
        recovering = self._feeds["recovering"].wire.slot.message
        if recovering is not None and getattr(recovering, "active", False):
            return self._feeds["recovery"].wire.slot.tick >= number
        return not self._follows() or all(self._feeds[role].wire.slot.tick >= number for role in CHAIN)

    def _follows(self) -> bool:
        """Whether the goal authorises following a trajectory."""
        return bool(getattr(self._feeds["drive"].wire.slot.message, "path_id", 0))

    def _time_chain(self, number: int) -> None:
        """Record how long the commands of a tick took, also if the next tick begins before they are complete."""
        if self._chain is None and number > self.stepper.stepped and self._follows():
            self._chain = number, self.clock.stamp_ns
        if self._chain is not None and self._is_complete(self._chain[0]):
            if self._follows():
                self.chains_s.append(max(0, self.clock.now_ns() - self._chain[1]) * 1e-9)
            self._chain = None

    def _await_tick(self) -> None:
        """Let only the last input that the next decision lacks wake the gate; earlier ones wait for it.

        For a robot that follows a trajectory this is a command, which arrives some ms after the stamp of its tick.
        """
        number = self.stepper.stepped + 1 if self._chain is None else self._chain[0]
        missing = [role for role in CHAIN if self._feeds[role].wire.slot.tick < number] if self._follows() else []
        # The avoider follows the controller, so that its command comes last.
        last = missing[-1] if missing else "odometry"
        for feed in self.cell.feeds:
            if feed.wire.input.name == last:
                feed.inlet.listen()
            elif feed.wire.input.name in (*CHAIN, "odometry"):
                feed.inlet.rings = False

    def _find_waiting(self) -> str:
        """The first active instance whose reports say that it waits for a stream, and for which; empty for none."""
        for source in self._may_wait:
            self.hear(source)
        found = [self._waiting.get(source, "") for source in self._may_wait if self.cell.in_charge(source)]
        return next(filter(None, found), "")

    def _follow_platform(self) -> None:
        """After a restart of the platform, tell the gate, and wait for a later step of the goal, which ends the goal.

        Until then the trajectory is still authorised, but the robot's pose is not known.
        """
        slot = self._feeds["odometry"].slot
        if slot.envelope is not None and self._platform.has_restarted(slot.envelope):
            self._awaited_tick, self.gate.has_new_platform = slot.tick, True
        if self._awaited_tick >= 0:
            for source in self.cell.reports:
                if source[0] == "goal":
                    self.hear(source)

    def _gone(self) -> StopReason | None:
        self._doubt_ends_ns = 2**62
        for feed in self.cell.feeds:
            if feed.rivals is not None and feed.rivals.is_split and self.cell.in_charge(feed.source):
                return StopReason("rivals", " ".join(feed.source), self.presence.processes(feed.source))
        if self._awaited_tick >= 0:
            return StopReason("goal_halted")
        for role, name in self._needed:
            if self.cell.in_charge((role, name)) and not self._is_there((role, name)):
                return StopReason("gone", f"{role} {name}")
        return None

    def _is_goal_in_time(self) -> bool:
        goals = [inlet.heard_ns for (role, _), inlet in self.cell.reports.items() if role == "goal"]
        silence_ns = self.clock.monotonic_ns() - max(self._began_ns, *goals)
        left_ns = round(self._goal_deadline * 1e9) - silence_ns
        self._goal_ends_ns = self._looked_ns + left_ns
        return left_ns >= 0

    def _is_there(self, source: Source) -> bool:
        """Whether an instance runs: it has its token, or an active instance of its process has just been heard.

        When a link to the router closes, Zenoh may report the tokens of a process as lost for a moment, although its
        messages still arrive over another link.
        """
        if self.presence.is_alive(source):
            return True
        life = self.presence.last_life(source)
        heard = [
            inlet.heard_ns
            for mate, inlet in self._inlets()
            # Only active, required instances vouch for their process: a shadow could claim the life of another one.
            if life and mate in self._needed and self.cell.in_charge(mate) and self.presence.last_life(mate) == life
        ]
        left_ns = max(heard, default=0) + self._doubt_ns - self.clock.monotonic_ns()
        if left_ns > 0:
            self._doubt_ends_ns = min(self._doubt_ends_ns, self._looked_ns + left_ns)
        return left_ns > 0

    def _inlets(self) -> Iterator[tuple[Source, Inlet]]:
        """Every inlet, with the instance whose messages it receives."""
        yield from self.cell.reports.items()
        yield from ((feed.source, feed.inlet) for feed in self.cell.feeds)

    def _is_warm(self, role: str, name: str) -> bool:
        # Its reports do not wake the gate, so that they are read here.
        if (role, name) in self.cell.reports:
            self.hear((role, name))
        marks, is_enabled = self._marks.get((role, name), ({}, False))
        ports = self._catalogue.warming_ports(role)
        return is_enabled and (not ports or any(marks.get(port, 0) for port in ports))

    def _hear(self, source: Source, report: StepReport, at: Envelope) -> None:
        if source[0] == "goal" and at.tick > self._awaited_tick:
            self._awaited_tick = -1
        self._marks[source] = {mark.port: mark.sequence for mark in report.published}, report.enabled
        self._waiting[source] = "" if report.trigger else report.told
