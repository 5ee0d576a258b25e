"""One node of a live robot in its process: the instance, its mailbox, and its input and output streams."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from navloom.engine.nodes.node_base import Node, Outputs, Tick
from navloom.engine.stepper import Stepper, waiting_words
from navloom.engine.streams import STEP
from navloom.engine.wiring import Slot, Wire
from navloom.messages import InputRead, PortMark, Selection, StepReport

from navloom_live.live.mailbox import Inlet, Mailbox
from navloom_live.live.node_output import Dated, Outlet
from navloom_live.live.publisher_restarts import RivalWatch

__all__ = ["Cell", "Feed", "Source"]

Source = tuple[str, str]
"""Role and instance that a stream comes from."""


@dataclass(eq=False)
class Feed:
    """A stream of one instance into one input of the node.

    Attributes:
        wire: The input.
        inlet: Queue of its messages.
        slot: The node's own copy of the port.
        source: Role and instance that publish it.
        rivals: Live: finds a second process that publishes it; None where that does no harm.
    """

    wire: Wire
    inlet: Inlet
    slot: Slot
    source: Source
    rivals: RivalWatch | None = None


class Cell:
    """A node with everything that its own thread needs to step it.

    Attributes:
        stepper: Its wires read the cell's own slots, which the feeds fill.
        mailbox: Woken by every feed.
        feeds: Its inputs, from all instances of each role it reads.
        reports: Step reports, by source.
        faults: Step reports of faults, by source, if the node acts on them.
        platform: The platform's odometry, if the node acts on a restart of the platform.
        outlets: By port; the outlet of the step reports is "step".
        fault: Outlet of this node's fault reports; None under a barrier, where every node reads all reports.
        epoch: Epoch of the current selection.
        chosen: Active instance, by role.
        versions: Number of parameter changes so far.
    """

    def __init__(
        self,
        stepper: Stepper,
        mailbox: Mailbox,
        feeds: Iterable[Feed],
        reports: Mapping[Source, Inlet],
        outlets: Mapping[str, Outlet],
        chosen: Mapping[str, str],
    ) -> None:
        self.stepper = stepper
        self.mailbox = mailbox
        self.feeds = list(feeds)
        self.reports = dict(reports)
        self.faults: dict[Source, Inlet] = {}
        self.platform: Inlet | None = None
        self.outlets = dict(outlets)
        self.fault: Outlet | None = None
        self._was_faulty = False
        self.epoch = 0
        self.chosen = dict(chosen)
        self.versions = 0
        self.resets = 0

    @property
    def source(self) -> Source:
        """Role and name of the instance."""
        return self.stepper.role, self.stepper.name

    @property
    def node(self) -> Node:
        """The node."""
        return self.stepper.node

    def select(self, selection: Selection) -> None:
        """Read the instances that are now active."""
        self.recall(selection.chosen, selection.epoch)

    def recall(self, chosen: Mapping[str, str], epoch: int) -> None:
        """Read these active instances, under this epoch."""
        self.epoch = epoch
        self.chosen |= chosen
        self.stepper.active = self.in_charge(self.source)
        for feed in self.feeds:
            # Each instance has a slot of its own, so that a swap finds the newest message of the new one.
            if self.in_charge(feed.source) and feed.wire.slot is not feed.slot:
                feed.wire.lead_to(feed.slot)

    def in_charge(self, source: Source) -> bool:
        """Whether an instance is active."""
        role, name = source
        return self.chosen.get(role, name) == name

    def read_marks(self, number: int, since: int) -> tuple[InputRead, ...]:
        """Sequence numbers of the messages that a step in this tick reads."""
        return tuple(InputRead(name, numbers) for name, numbers in self.stepper.read_marks(number, since))

    def publish(self, outputs: Outputs, made: Tick, cause_ns: int) -> None:
        """Send a step's outputs."""
        _send(self._hand_on(outputs, made, cause_ns))

    def report(
        self, tick: Tick, trigger: str = "", read: tuple[InputRead, ...] = (), spent_ns: int = 0, fault: str = ""
    ) -> None:
        """Report that this tick is done; `trigger` is empty if the node did not step."""
        _send([self._hand_on_report(tick, trigger, read, spent_ns, fault)])

    @property
    def is_followed(self) -> bool:
        """Whether any node or tool reads its step reports."""
        return self.outlets[STEP].is_heard

    def tell(
        self, outputs: Outputs, tick: Tick, cause_ns: int, trigger: str, read: tuple[InputRead, ...] | None, fault: str
    ) -> None:
        """Send a step's outputs and then its report, together. `read` is None if no one reads the report."""
        burst = self._hand_on(outputs, tick, cause_ns)
        # The first step without a fault is news too: it ends the count of faults in a row.
        is_news = self.fault is not None and (bool(fault) or self._was_faulty)
        if read is None and not is_news:
            # Counted, so that a recorder that joins sees a gap and not a restart.
            self.outlets[STEP].pass_over()
        else:
            burst.append(self._hand_on_report(tick, trigger, read or (), self.stepper.spent_ns, fault))
        if is_news and self.fault is not None:
            self._was_faulty = bool(fault)
            message, at = burst[-1][1]
            burst.append((self.fault, self.fault.hand_on(message, at.tick, at.stamp_ns, at.cause_ns, at.epoch)))
        _send(burst)

    def _hand_on(self, outputs: Outputs, made: Tick, cause_ns: int) -> list[tuple[Outlet, Dated]]:
        outlets, number, time_ns, epoch = self.outlets, made.number, made.time_ns, made.epoch
        burst = []
        for out, message in outputs:
            outlet = outlets[out.name]
            burst.append((outlet, outlet.hand_on(message, number, time_ns, cause_ns, epoch)))
        return burst

    def _hand_on_report(
        self, tick: Tick, trigger: str, read: tuple[InputRead, ...], spent_ns: int, fault: str
    ) -> tuple[Outlet, Dated]:
        marks = tuple([PortMark(port, outlet.sequence) for port, outlet in self.outlets.items() if port != STEP])
        enabled = self.stepper.enabled
        told = self.node.told if trigger else waiting_words(*self.source, self.stepper.lacks)
        message = StepReport(trigger, read, marks, enabled, self.versions, self.resets, spent_ns, fault, told)
        outlet = self.outlets[STEP]
        return outlet, outlet.hand_on(message, tick.number, tick.time_ns, tick.time_ns, tick.epoch)


def _send(burst: list[tuple[Outlet, Dated]]) -> None:
    """Send messages that were handed on.

    Readers in this process are woken once all messages are queued, and before any is encoded for other processes: one
    of them is the next node in the chain from sensor to wheels.
    """
    for outlet, _ in burst:
        outlet.wake()
    for outlet, dated in burst:
        outlet.send(dated)
