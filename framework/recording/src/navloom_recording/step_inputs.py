"""Finds the inputs of a recorded step by the sequence numbers in its step record."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from navloom.config.schema import Config
from navloom.engine.node_ports import Input, NodeSpec
from navloom.engine.nodes.executor_inputs import GoalTold
from navloom.messages import Envelope, Message, OperatorRequest, Selection, StepReport

from navloom_recording.message_cache import Entry, Shelf
from navloom_recording.reader import Recorded

__all__ = ["Chosen", "Fed", "Feeder", "Step"]


@dataclass(frozen=True, eq=False)
class Step:
    """A step record and its position in the file.

    Attributes:
        role, instance: The node.
        report, at: The record and its envelope; `at.sequence` counts the records of the instance.
        place, received_ns: Index of the record in the file, and its receive time, ns.
    """

    role: str
    instance: str
    report: StepReport
    at: Envelope
    place: int
    received_ns: int


class Chosen:
    """The active instance of each role, according to the recorded selections."""

    def __init__(self, config: Config) -> None:
        first = {role: config.role_table(role).instance for role in config.roles}
        # Epoch 0 is the config's own selection, which is announced before any recorder listens.
        self._by_epoch: dict[int, dict[str, str]] = {0: first}
        self._from: list[tuple[int, dict[str, str]]] = [(0, first)]

    def learn(self, selection: Selection) -> None:
        """Add a selection."""
        chosen = self._by_epoch[0] | selection.chosen
        self._by_epoch[selection.epoch] = chosen
        # A gate that restarted announces its selection again.
        if self._from[-1][0] < selection.from_tick:
            self._from.append((selection.from_tick, chosen))

    def under(self, role: str, epoch: int) -> str:
        """The active instance under a selection; the framework's own nodes are called main."""
        known = self._by_epoch.get(epoch) or self._from[-1][1]
        return known.get(role, "main")

    def at(self, role: str, tick: int) -> str:
        """The active instance in a tick."""
        place = bisect_right([first for first, _ in self._from], tick) - 1
        return self._from[max(0, place)][1].get(role, "main")


@dataclass
class Fed:
    """Inputs of a step by name, in the form that a node receives, and those that the recording lacks."""

    given: dict[str, Any] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)


class Feeder:
    """Finds the inputs of steps.

    Args:
        prefix: REALM/ROBOT.
        shelf: Recent messages of the recording.
        chosen: Active instances.
        instances: Names of the instances, by role.
    """

    def __init__(self, prefix: str, shelf: Shelf, chosen: Chosen, instances: Mapping[str, Sequence[str]]) -> None:
        self.prefix, self.shelf, self.chosen, self.instances = prefix, shelf, chosen, instances

    def feed(self, spec: NodeSpec, step: Step, since: int) -> Fed:
        """The inputs of a step.

        Args:
            spec: Wiring of the node that receives the inputs.
            step: The step's record.
            since: Tick of the instance's previous step, for inputs that the record does not name: another plugin's.
        """
        fed = Fed()
        submitted = GoalTold.of(step.report.told).submitted
        read = {one.input: one.sequences for one in step.report.read}
        for given in spec.inputs:
            # The record is of the recorded plugin: another one may read further streams.
            find = self._named if given.name in read else self._by_tick
            entries = find(given, step, read.get(given.name, (since,)), submitted, fed)
            fed.given[given.name] = _as_read(given, entries)
        return fed

    def _named(
        self, given: Input, step: Step, numbers: Sequence[int], submitted: Sequence[OperatorRequest], fed: Fed
    ) -> list[tuple[Message, Envelope | None]]:
        found: list[tuple[Message, Envelope | None]] = []
        by_service = iter(submitted)
        lacking = []
        # Tracks are recorded as runs of numbers, since one step may read thousands.
        for number in _spread(numbers) if given.reading == "track" else numbers:
            if number == 0:  # came through a service, which has no sequence numbers
                found += [(request, None) for request in islice(by_service, 1)]
                continue
            opened = self._find(given, number, step)
            if opened is None:
                lacking.append(number)
            else:
                found.append((opened.message, opened.envelope))
        if lacking:
            which = str(lacking[0]) if len(lacking) == 1 else f"{lacking[0]} and {len(lacking) - 1} more"
            fed.missing.append(f"{given.name} ({given.role}.{given.port} number {which})")
        return found

    def _find(self, given: Input, number: int, step: Step) -> Recorded | None:
        names = self.instances.get(given.role, ("main",))
        under = self.chosen.under(given.role, step.at.epoch)
        found = {name: entry for name in names if (entry := self._entry(given, name, number, step)) is not None}
        if given.reading in ("new", "track"):  # waiting messages remain when another instance becomes active
            for name, entry in found.items():
                opened = entry.open()
                if opened is not None and self.chosen.at(given.role, opened.envelope.tick) == name:
                    return opened
        return found[under].open() if under in found else None

    def _entry(self, given: Input, name: str, number: int, step: Step) -> Entry | None:
        return self.shelf.get(f"{self.prefix}/{given.role}/{name}/{given.port}", number, step.place)

    def _by_tick(
        self, given: Input, step: Step, since: Sequence[int], submitted: Sequence[OperatorRequest], fed: Fed
    ) -> list[tuple[Message, Envelope | None]]:
        """Messages by their ticks: new ones since the previous step; for a sampled input the newest up to this step."""
        name = self.chosen.under(given.role, step.at.epoch)
        last = step.at.tick - given.delayed
        first = since[0] + 1 - given.delayed if given.reading == "new" else 0
        entries = self.shelf.recent(f"{self.prefix}/{given.role}/{name}/{given.port}")
        opened = [one for entry in entries if (one := entry.open()) is not None]
        return [(one.message, one.envelope) for one in opened if first <= one.envelope.tick <= last]


def _as_read(given: Input, found: list[tuple[Message, Envelope | None]]) -> Any:
    """These messages in the form that the node receives; see `Reading`."""
    if given.reading == "latest":
        return found[-1][0] if found else None
    if given.reading == "offers":
        return found[-1] if found else None
    messages = [message for message, _ in found]
    return messages if given.reading == "track" else tuple(messages)


def _spread(runs: Sequence[int]) -> Iterator[int]:
    """Every number of runs that are given as pairs of first and last."""
    for first, last in zip(runs[::2], runs[1::2], strict=False):
        yield from range(first, last + 1)
