"""A node on the wall clock: it steps when its trigger arrives, on the inputs at hand; it never waits for long."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping

import numpy as np
from navloom.engine.nodes.node_base import Outputs, Tick
from navloom.messages import Envelope, InputRead, Selection, StepReport

from navloom_live.live.live_node import Feed, Source
from navloom_live.live.live_node_builder import Hosted, Widening
from navloom_live.live.mailbox import Inlet
from navloom_live.live.publisher_restarts import BACKWARDS
from navloom_live.live.run_clock import RunClock
from navloom_live.timing import RUNNER_IDLE, SIBLING_WAIT_FIRST, WAITING_REPORT_INTERVAL

__all__ = ["STEPS_KEPT", "Change", "LiveRunner", "StepTimes"]


Change = Callable[[], None]


class LiveRunner:
    """Steps one cell as its inputs arrive.

    Args:
        hosted: The node with its feeds.
        clock: The run clock as this process knows it.
        period: Length of a tick, s.
        ends: Whether the process is ending.
    """

    def __init__(self, hosted: Hosted, clock: RunClock, period: float, ends: Callable[[], bool]) -> None:
        self.cell, self.clock, self.period, self.ends = hosted.cell, clock, period, ends
        self.selection = hosted.selection
        self.done: dict[Source, int] = {}
        self.stepper = hosted.cell.stepper
        self.faulted = 0
        self.fault = ""
        self._said_waiting = 0.0
        self._changes: deque[Change] = deque()
        self._seen = 0
        self._waits_since: tuple[int, float] = (-1, 0.0)
        self._pace = self.stepper.cause
        self._siblings = hosted.awaited
        self.times = StepTimes()
        self._parts = {
            source: [feed for feed in self.cell.feeds if feed.source == source and not feed.wire.delayed]
            for source in self._siblings
        }
        self._patience = self.cell.node.patience
        self._all_feeds = (self.selection, *self.cell.feeds)
        self._ringing = {feed.inlet for feed in self.cell.feeds if self.rings(feed)}
        for inlet in (*(feed.inlet for feed in self._all_feeds), *self.cell.reports.values()):
            inlet.rings = inlet in self._ringing

    def rings(self, feed: Feed) -> bool:
        """Whether messages of this feed wake the node: only those that make it step. All others wait until then."""
        # A node that woke for each input would only wait for the rest, and for the GIL.
        return feed.wire is self._pace if self.stepper.spec.ticks else feed.wire.input.triggers

    def change(self, change: Change) -> None:
        """Schedule a call between two steps, on the node's own thread."""
        self._changes.append(change)
        self.cell.mailbox.ring()

    def admit(self, more: Widening) -> None:
        """Read an instance that was added to the robot, too. On the node's own thread."""
        cell = self.cell
        cell.feeds += more.feeds
        cell.reports |= more.reports
        cell.faults |= more.faults
        self._all_feeds = (self.selection, *cell.feeds)
        self._ringing |= {feed.inlet for feed in more.feeds if self.rings(feed)}
        for inlet in (*(feed.inlet for feed in more.feeds), *more.reports.values()):
            inlet.rings = inlet in self._ringing
        if more.is_awaited:
            self._siblings.add(more.source)
            self._parts[more.source] = [feed for feed in more.feeds if not feed.wire.delayed]
        cell.recall({}, cell.epoch)  # a long step may have delayed this until after the instance became active

    def run(self) -> None:
        """Step until the process ends."""
        while not self.ends():
            self._seen = self.cell.mailbox.wait(self._seen, self.wait_time())
            self.take_in()
            self.act()

    def wait_time(self) -> float:
        """Longest wait for a message, s."""
        return min(self._patience, RUNNER_IDLE) if self._waits_since[0] >= 0 else RUNNER_IDLE

    def act(self) -> None:
        """Step if a step is due."""
        found = self._due()
        if found is None:
            return
        trigger, number = found
        if self._awaits_siblings(number):
            return
        self.step(trigger, number)

    # --- taking in --------------------------------------------------------------------------------------------------

    def take_in(self) -> None:
        """Move messages from the inlets into the node's slots, follow the selection, and run scheduled calls."""
        for feed in self._all_feeds:
            if feed.inlet.has_news:
                self._fill(feed)
        selection = self.selection.slot.message
        if (
            isinstance(selection, Selection)
            and selection.epoch > self.cell.epoch
            # The newest tick that this process knows of, by any stream: the clock's own message may be late.
            and selection.from_tick <= max([self.clock.tick, *(feed.slot.tick for feed in self.cell.feeds)])
        ):
            self.recall(selection.chosen, selection.epoch)
        while self._changes:
            self._changes.popleft()()

    def hear(self, source: Source) -> None:
        """Take an instance's step reports."""
        for message, envelope in self.cell.reports[source].take():
            if isinstance(message, StepReport):
                self._hear(source, message, envelope)

    def recall(self, chosen: Mapping[str, str], epoch: int) -> None:
        """Read these active instances from now on; enable this node if it is one of them."""
        self.cell.recall(chosen, epoch)
        self.stepper.enabled = self.stepper.enabled or self.stepper.active

    def _hear(self, source: Source, report: StepReport, at: Envelope) -> None:
        self.done[source] = at.tick

    def _fill(self, feed: Feed) -> None:
        slot = feed.slot
        is_clock = feed.source[0] == "platform" and feed.wire.input.port == "odometry"
        rivals = feed.rivals
        for message, envelope in feed.inlet.take():
            held = slot.envelope
            if rivals is not None:
                rivals.note(envelope.sequence, envelope.stamp_ns)
            # A message may come twice (by two links) or late (the answer to a query).
            if held is not None and envelope.tick <= slot.tick:
                is_known = envelope.tick == slot.tick and envelope.sequence == held.sequence
                # Only the platform can show that the clock restarted: an old message of another node is only old.
                is_near = is_clock or self.clock.tick < envelope.tick + BACKWARDS
                is_anew = envelope.tick <= slot.tick - BACKWARDS and is_near
                if is_known or (envelope.tick < slot.tick and not is_anew):
                    feed.inlet.counts.late += 1
                    continue
                if is_anew:
                    self.begin_anew(envelope.tick)
            slot.take(message, envelope, envelope.tick)
            if is_clock:
                self.clock.observe(envelope.stamp_ns, feed.inlet.arrived_ns, envelope.tick)

    def begin_anew(self, tick: int) -> None:
        """Handle a restart of the run clock, now at this tick: state of the old clock would lie in the future."""
        stepper, limit = self.stepper, tick + BACKWARDS
        # Or the node would wait until the new clock has reached the old one.
        if stepper.stepped >= limit:
            stepper.stepped = -1
        self.done = {source: done for source, done in self.done.items() if done < limit}
        self._waits_since = (-1, 0.0)
        for feed in self.cell.feeds:
            if feed.slot.tick >= limit:  # the message stays, but no longer counts as new
                feed.slot.tick, feed.slot.older = -1, (None, 0, -1)
        for wire in stepper.wires:
            if wire.queue is not None:
                kept = [entry for entry in wire.queue if entry[0] < limit]
                wire.queue.clear()
                wire.queue.extend(kept)

    # --- when to step -----------------------------------------------------------------------------------------------

    def _due(self) -> tuple[str, int] | None:
        """Trigger and tick of a step that is due; None for none."""
        stepper = self.stepper
        if not stepper.enabled:
            return None
        if stepper.is_short():
            self._say_waiting()
            return None
        if stepper.spec.ticks:
            wire = self._pace
            # Each tick once, however often its message comes.
            if wire is None or wire.slot.tick <= stepper.stepped:
                return None
            return ("tick", wire.slot.tick) if wire.slot.tick % stepper.stride == 0 else None
        now = max((wire.slot.tick for wire in stepper.wires), default=-1)
        for wire in stepper.triggers:
            if wire.has_news(stepper.stepped, now) and now % stepper.stride == 0:
                return wire.input.name, now if wire.delayed or wire.queue is not None else wire.slot.tick
        return None

    def _say_waiting(self) -> None:
        """Report, at intervals, which streams the node waits for."""
        now = time.monotonic()
        if now - self._said_waiting > WAITING_REPORT_INTERVAL and self.clock.is_known:
            self._said_waiting = now
            time_ns = max(0, self.clock.now_ns())
            self.cell.report(Tick(max(0, self.clock.tick), time_ns * 1e-9, time_ns, self.cell.epoch))

    def _awaits_siblings(self, number: int) -> bool:
        """Whether to wait a moment for other inputs of the same tick; later ticks do not extend the wait."""
        # Otherwise a stream that is always late would keep the node waiting for ever.
        wanted = number if self._waits_since[0] < 0 else min(number, self._waits_since[0])
        late = [
            source for source in self._siblings if self.cell.in_charge(source) and not self._is_done(source, wanted)
        ]
        now = time.monotonic()
        if late and self._waits_since[0] < 0:
            self._waits_since = (wanted, now)
            for source in late:
                for inlet in self._words(source):
                    # Only while it waits: in other ticks these messages need not wake it.
                    inlet.listen()
            # The first look may be early: the wake-up of the late input comes anyway.
            return True
        patience = max(SIBLING_WAIT_FIRST, self._patience) if self.stepper.stepped < 0 else self._patience
        if late and now - self._waits_since[1] < patience:
            return True
        if self._waits_since[0] >= 0:
            self._waits_since = (-1, 0.0)
            for source in self._siblings:
                for inlet in self._words(source):
                    inlet.rings = inlet in self._ringing
        return False

    def _words(self, source: Source) -> list[Inlet]:
        """Inlets that show that an instance has finished a tick."""
        report = self.cell.reports.get(source)
        return [report] if report is not None else [feed.inlet for feed in self._parts[source]]

    def _is_done(self, source: Source, number: int) -> bool:
        """Whether an instance's outputs of a tick are here: a message on each port that is read, or its report."""
        if all(feed.slot.tick >= number for feed in self._parts[source]):
            return True
        if source in self.cell.reports:
            self.hear(source)
        return self.done.get(source, -1) >= number

    # --- stepping ---------------------------------------------------------------------------------------------------

    def step(self, trigger: str, number: int) -> None:
        """One step: publish its outputs, and report a fault; a failed node is stepped again in the next tick."""
        stepper = self.stepper
        time_ns = self._time_of(number)
        tick = Tick(number, time_ns * 1e-9, time_ns, self.cell.epoch)
        # Messages of ticks that were skipped count too, but no more than two ticks of them.
        missed = min(2, max(0, number - stepper.stride - stepper.stepped)) if stepper.stepped >= 0 else 0
        self.step_once(tick, trigger, number - stepper.stride - missed)

    def step_once(self, tick: Tick, trigger: str, since: int) -> None:
        """Step and publish the outputs; queues give the messages after tick `since`."""
        # Most steps have no reader of reports, and marks cost as much as a small step.
        read = self.cell.read_marks(tick.number, since) if self.cell.is_followed else None
        outputs = self.stepper.step(tick, since)
        self.times.note(tick.number, self.stepper.spent_ns, self.stepper.computed_ns)
        self.note()
        self.tell(outputs, tick, trigger, read)

    def tell(self, outputs: Outputs, tick: Tick, trigger: str, read: tuple[InputRead, ...] | None) -> None:
        """Send a step's outputs and its report; `read` is None if no one reads the report."""
        self.cell.tell(outputs, tick, self.cause_of(tick), trigger, read, self.fault)

    def cause_of(self, tick: Tick) -> int:
        """Platform stamp that a step's outputs derive from."""
        return self.stepper.cause_of(tick.time_ns)

    def note(self) -> None:
        """Record the fault of the last step."""
        self.fault = self.stepper.fault
        self.faulted = self.faulted + 1 if self.fault else 0

    def _time_of(self, number: int) -> int:
        """Run clock of a tick, ns: the stamp of an input message of that tick."""
        for wire in self.stepper.wires:
            envelope = wire.slot.envelope
            # The stamp of the tick is the platform's: this host's clock would differ from the other hosts'.
            if envelope is not None and envelope.tick == number:
                return envelope.stamp_ns
        return max(0, self.clock.now_ns())


STEPS_KEPT = 4096
"""Number of recorded steps."""


class StepTimes:
    """Ticks and durations of the newest steps of one node. One thread writes, any may read."""

    def __init__(self) -> None:
        self._kept = np.zeros((STEPS_KEPT, 3), dtype=np.int64)
        self._steps = 0

    def note(self, tick: int, spent_ns: int, computed_ns: int) -> None:
        """Record a step: its tick, its duration, and the thread's CPU time within it."""
        self._kept[self._steps % STEPS_KEPT] = tick, spent_ns, computed_ns
        # After the row, so that a reader never counts one that is not written.
        self._steps += 1

    def newest(self, most: int = STEPS_KEPT) -> list[tuple[int, int]]:
        """(tick, ns) of at most `most` steps, oldest first."""
        return [(tick, spent) for tick, spent, _ in self._newest(most)]

    def computed(self, most: int = STEPS_KEPT) -> list[tuple[int, int]]:
        """Duration and CPU time, ns, of at most `most` steps, oldest first."""
        return [(spent, computed) for _, spent, computed in self._newest(most)]

    def _newest(self, most: int) -> list[list[int]]:
        places = np.arange(max(0, self._steps - min(most, STEPS_KEPT)), self._steps) % STEPS_KEPT
        rows: list[list[int]] = self._kept[places].tolist()
        return rows
