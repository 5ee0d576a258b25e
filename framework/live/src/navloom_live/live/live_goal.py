"""The goal node live: it also steps without new poses, so that a goal ends even if other nodes are gone."""

from __future__ import annotations

import time
from collections.abc import Callable

from navloom.engine.nodes.goal_node import GoalNode
from navloom.messages import Envelope, OperatorRequest, StepReport

from navloom_live.live.live_node import Source
from navloom_live.live.live_node_builder import Hosted
from navloom_live.live.live_runner import LiveRunner
from navloom_live.live.publisher_restarts import RestartWatch
from navloom_live.live.run_clock import RunClock
from navloom_live.timing import GOAL_CHECK_INTERVAL, GOAL_POSE_WAIT, PLATFORM_SILENCE

__all__ = ["LiveGoal"]

BROKEN = 20
"""Number of consecutive failed steps of a plugin after which the goal ends with an error."""


class LiveGoal(LiveRunner):
    """Steps the goal node."""

    def __init__(self, hosted: Hosted, clock: RunClock, period: float, ends: Callable[[], bool]) -> None:
        super().__init__(hosted, clock, period, ends)
        assert isinstance(self.cell.node, GoalNode)
        self.goal = self.cell.node
        self._request = next(wire for wire in self.stepper.wires if wire.input.name == "request")
        self._stepped_at = time.monotonic()
        self.faults: dict[Source, tuple[int, str]] = {}
        self._platform = RestartWatch()
        self._has_platform_restarted = self._is_asked = False
        self._longest = max(GOAL_POSE_WAIT, 2.0 * period)

    def wait_time(self) -> float:
        """Longest wait for a message, s."""
        left = self._longest + self._stepped_at - time.monotonic()
        return min(super().wait_time(), max(GOAL_CHECK_INTERVAL, left))

    def act(self) -> None:
        """Step with each pose; also without one when poses stay away, and once a tick after a request."""
        super().act()
        stepped, silence = self.stepper.stepped, time.monotonic() - self._stepped_at
        # The platform ignores requests of later ticks than its own, and poses of ticks already stepped are skipped.
        is_asked = self._is_asked and stepped <= self.clock.tick
        if (is_asked or silence > self._longest) and self.clock.is_known:
            # The tick that the platform would have by now: the run clock of the goal must go on, or nothing would time
            # out.
            self.step("tick", stepped + max(1, int(silence / self.period)))

    def step(self, trigger: str, number: int) -> None:
        """One step of the goal's state machine, with the faults and silences that this process knows of."""
        for _, envelope in self.cell.platform.take() if self.cell.platform is not None else ():
            self._has_platform_restarted |= self._platform.has_restarted(envelope)
        for source, inlet in self.cell.faults.items():
            for message, envelope in inlet.take():
                if isinstance(message, StepReport):
                    self._blame(source, message, envelope)
        self.goal.fault = self._trouble()
        self.goal.is_lost = self.clock.silence_s() > max(PLATFORM_SILENCE, 2.0 * self.period)
        self._stepped_at, self._is_asked = time.monotonic(), False
        super().step(trigger, number)

    def submit(self, request: OperatorRequest) -> None:
        """Take an operator's request, on the goal's own thread."""
        assert self._request.queue is not None
        self.goal.submitted.append(request)
        # In a tick far ahead, so that no step takes it for an old message; it was in no stream, hence sequence 0.
        self._request.queue.append((2**62, request, 0))
        self._is_asked = True

    def _blame(self, source: Source, report: StepReport, at: Envelope) -> None:
        """Count a node's consecutive faults; the count restarts with its process."""
        before = self.faults.get(source, (0, ""))[0] if at.sequence > 1 else 0
        if report.fault:
            self.faults[source] = (before + 1, report.fault)
        else:
            self.faults.pop(source, None)

    def _trouble(self) -> str:
        if self._has_platform_restarted:
            self._has_platform_restarted = False
            return "the platform began anew, and where the robot is now is not known: `navloom place` tells it"
        for (role, name), (times, text) in self.faults.items():
            if times >= BROKEN and self.cell.in_charge((role, name)) and role not in self.goal.optional:
                del self.faults[role, name]  # the next goal tries again
                return f"{role} {name} failed {times} times in a row: {text}"
        return ""
