"""One node of a live robot in its process: the instance, its mailbox, and all its streams in and out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from navloom.engine.node import Node, Outputs, Tick
from navloom.engine.stepper import Stepper, waiting_words
from navloom.engine.wiring import Slot, Wire
from navloom.messages import InputRead, PortMark, Selection, StepReport
from navloom.runtime.keyspace import STEP
from navloom.runtime.mailbox import Inlet, Mailbox
from navloom.runtime.outlet import Outlet

__all__ = ["Cell", "Feed", "Source"]

Source = tuple[str, str]
"""Role and instance that a stream comes from."""


@dataclass(eq=False)
class Feed:
    """A stream of one instance into one input of the node.

    Attributes:
        wire: The input.
        inlet: Where its messages wait.
        slot: The node's own copy of the port.
        source: Who publishes it.
    """

    wire: Wire
    inlet: Inlet
    slot: Slot
    source: Source


class Cell:
    """A node with everything it needs to be stepped by a thread of its own.

    Attributes:
        stepper: Its wires lead to slots of its own, filled from the feeds.
        mailbox: Woken by every feed.
        feeds: Its inputs, of all instances of each role it reads.
        reports: Step reports by source.
        outlets: By port; that of the step reports is under "step".
        epoch: Of the selection in force.
        chosen: Instance in charge, by role.
        versions: Changes of its parameters so far.
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
        self.outlets = dict(outlets)
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
        """What is stepped."""
        return self.stepper.node

    def select(self, selection: Selection) -> None:
        """Read the instances now in charge."""
        self.recall(selection.chosen, selection.epoch)

    def recall(self, chosen: Mapping[str, str], epoch: int) -> None:
        """Read these instances, under this epoch."""
        self.epoch = epoch
        self.chosen |= chosen
        self.stepper.active = self.in_charge(self.source)
        for feed in self.feeds:
            if self.in_charge(feed.source) and feed.wire.slot is not feed.slot:
                feed.wire.lead_to(feed.slot)

    def in_charge(self, source: Source) -> bool:
        """An instance is the one of its role that is read."""
        role, name = source
        return self.chosen.get(role, name) == name

    def read_marks(self, number: int, since: int) -> tuple[InputRead, ...]:
        """Sequence numbers of what a step in this tick reads."""
        return tuple(InputRead(name, numbers) for name, numbers in self.stepper.read_marks(number, since))

    def publish(self, outputs: Outputs, made: Tick, cause_ns: int) -> None:
        """Send what a step gave."""
        for out, message in outputs:
            self.outlets[out.name].publish(message, made.number, made.time_ns, cause_ns, made.epoch)

    def report(
        self, tick: Tick, trigger: str = "", read: tuple[InputRead, ...] = (), spent_ns: int = 0, fault: str = ""
    ) -> None:
        """Say that this tick is done, and what came of it; a silent one has no trigger."""
        marks = tuple(PortMark(port, outlet.sequence) for port, outlet in self.outlets.items() if port != STEP)
        enabled = self.stepper.enabled
        told = self.node.told if trigger else waiting_words(*self.source, self.stepper.lacks)
        message = StepReport(trigger, read, marks, enabled, self.versions, self.resets, spent_ns, fault, told)
        self.outlets[STEP].publish(message, tick.number, tick.time_ns, tick.time_ns, tick.epoch)
