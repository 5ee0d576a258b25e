"""The platform node live: the source of the run clock; it stops the wheels if the gate falls silent."""

from __future__ import annotations

import time
from collections.abc import Callable

from navloom.engine.nodes.node_base import Outputs, Tick
from navloom.engine.nodes.platform_node import PlatformNode
from navloom.engine.stepper import fault_text
from navloom.messages import Command, InputRead, Twist2D

from navloom_live.live.live_node import Feed, Source
from navloom_live.live.live_node_builder import Hosted
from navloom_live.live.live_runner import LiveRunner
from navloom_live.live.publisher_restarts import RivalWatch
from navloom_live.live.run_clock import RunClock
from navloom_live.timing import PLATFORM_RETRY_INTERVAL, RUNNER_IDLE, STALE_CHECK_DELAY, WHEELS_REFUSE_LIMIT

__all__ = ["LivePlatform"]

STILL = Twist2D(0.0, 0.0, 0.0)


class LivePlatform(LiveRunner):
    """Ticks by the wall clock, and passes commands to the platform as they arrive.

    Args:
        hosted, clock, period, ends: See `LiveRunner`.
        deadline: Age at which a command is stale, s.
        start_ns: This host's monotonic clock at run clock 0, ns.
        may_begin: Whether the first tick may begin.
        processes: The processes that run an instance, in words.

    Attributes:
        ticks, late: Number of ticks, and of those that began more than half a period late or were skipped.
        driven, own: Ticks in which the wheels turned, and those of them whose own command came before the next tick.
        stops: How often the wheels were stopped here for lack of a fresh command.
    """

    def __init__(
        self,
        hosted: Hosted,
        clock: RunClock,
        period: float,
        ends: Callable[[], bool],
        deadline: float,
        start_ns: int,
        may_begin: Callable[[], bool] = lambda: True,
        processes: Callable[[Source], str] = lambda source: "",
    ) -> None:
        super().__init__(hosted, clock, period, ends)
        assert isinstance(self.cell.node, PlatformNode)
        self.node = self.cell.node
        self.platform = self.node.plugin
        self.deadline_ns, self.start_ns = round(deadline * 1e9), start_ns
        self.period_ns = round(period * 1e9)
        self._may_begin = may_begin
        self.ticks = self.late = self.stops = self.driven = self.own = 0
        self._feeds = {feed.wire.input.name: feed for feed in self.cell.feeds}
        self._processes = processes
        self._rivals = self._feeds["command"].rivals = RivalWatch()
        self._taken: object = None
        self._twist = STILL
        self._untold_since: float | None = None
        self._refusal = ""
        self._cause_ns = -1
        self._next = -1

    def run(self) -> None:
        """Run until the process ends; then stop the wheels and close the platform."""
        while not self._may_begin() and not self.ends():
            time.sleep(PLATFORM_RETRY_INTERVAL)
        # Rounded up: the first tick is a whole one.
        self._next = max(0, -(-self._now_ns() // self.period_ns))
        try:
            super().run()
        finally:
            # Whatever ended the process, its wheels must not go on turning.
            self._drive(STILL)
            self.platform.close()

    def wait_time(self) -> float:
        """Time to the next tick, or until the gate's command goes stale, s."""
        now_ns = self._now_ns()
        left = (self._next * self.period_ns - now_ns) * 1e-9
        if self._twist != STILL:
            left = min(left, (self._cause_ns + self.deadline_ns - now_ns) * 1e-9 + STALE_CHECK_DELAY)
        if self._untold_since is not None:
            left = min(left, PLATFORM_RETRY_INTERVAL)
        return min(RUNNER_IDLE, max(0.0, left))

    def rings(self, feed: Feed) -> bool:
        """The gate's command wakes the node, so that it is passed on at once."""
        return feed.wire.input.name == "command"

    def act(self) -> None:
        """Pass on the gate's command; stop if it has gone stale; tick if a tick is due.

        Raises:
            RuntimeError: Commands to the wheels have failed for too long.
        """
        self._follow_gate()
        if self._untold_since is not None and time.monotonic() - self._untold_since > WHEELS_REFUSE_LIMIT:
            raise RuntimeError(
                f"commands to the wheels failed for {WHEELS_REFUSE_LIMIT:g} s: {self._refusal or self.fault}"
            )
        now_ns = self._now_ns()
        if now_ns < self._next * self.period_ns:
            return
        # Late ticks are skipped, not caught up: each output must be as new as its stamp.
        number = now_ns // self.period_ns
        if self._twist != STILL:
            self.driven += number - self._next + 1
            self.own += self._cause_ns >= (self._next - 1) * self.period_ns
        self.ticks += 1
        self.late += number - self._next + (now_ns - number * self.period_ns > self.period_ns // 2)
        self._next = number + 1
        self._advance(number)

    def _follow_gate(self) -> None:
        slot, now_ns = self._feeds["command"].slot, self._now_ns()
        message, envelope = slot.message, slot.envelope
        wanted = None if self._untold_since is None else self._twist
        if message is not self._taken and isinstance(message, Command) and envelope is not None:
            self._taken = message
            # Checked by the gate too, but the command may have been on its way since then.
            if 0 <= now_ns - envelope.cause_ns <= self.deadline_ns:
                self._cause_ns, wanted = envelope.cause_ns, message.twist
        if self._rivals.is_split:  # whose command is right is not known
            source = self._feeds["command"].source
            self._refusal = f"two gates send commands: {' '.join(source)} runs {self._processes(source)}"
            wanted = STILL if self._twist != STILL else None
        elif self._twist != STILL and now_ns - self._cause_ns > self.deadline_ns:
            self.stops += 1
            wanted = STILL
        if wanted is not None:
            self._drive(wanted)

    def _drive(self, twist: Twist2D) -> None:
        """Send a command to the wheels. A failure is retried, and reported with the tick."""
        self._twist = twist
        try:
            self.platform.drive(twist, max(0, self._now_ns()))
            self._untold_since = None
        # A bus error of a moment must not end the driver, which would stop the robot for seconds.
        except (Exception, SystemExit) as error:
            self._refusal = fault_text(error, self.node)
            self._untold_since = time.monotonic() if self._untold_since is None else self._untold_since

    def _advance(self, number: int) -> None:
        time_ns = number * self.period_ns
        tick = Tick(number, time_ns * 1e-9, time_ns, self.cell.epoch)
        # The step advances by what the wheels really do, which may be a stop of this class.
        self.node.driven = Command(self._twist)
        self.step_once(tick, "tick", number - 1)

    def note(self) -> None:
        """Record the fault of the last step, or of a command to the wheels since the previous step."""
        super().note()
        if self._refusal:
            self.fault = self.fault or self._refusal
            self.faulted, self._refusal = max(1, self.faulted), ""

    def tell(self, outputs: Outputs, tick: Tick, trigger: str, read: tuple[InputRead, ...] | None) -> None:
        """Send the odometry last: it triggers other nodes, and the tick's other messages must be on their way then."""
        # Its own clock is not read from the network.
        self.clock.observe(tick.time_ns, time.monotonic_ns(), tick.number)
        super().tell(sorted(outputs, key=lambda made: made[0].name == "odometry"), tick, trigger, read)

    def cause_of(self, tick: Tick) -> int:
        """The platform's own stamp."""
        return tick.time_ns

    def _now_ns(self) -> int:
        return time.monotonic_ns() - self.start_ns
