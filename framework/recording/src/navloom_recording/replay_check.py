"""Checks that a replay with the same plugins reproduces the recording bit for bit, and finds the first difference."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from navloom.config import Loaded
from navloom.engine.build import assemble
from navloom.engine.catalogue import catalogue_of
from navloom.engine.system import System
from navloom.messages import Message
from navloom.messages.schema import in_version

from navloom_recording.message_cache import Entry, Shelf
from navloom_recording.message_comparison import ReplayDifference, first_difference, is_same
from navloom_recording.step_outputs import Outcomes
from navloom_recording.step_replay import Replayer, ReplayNode, Stepped

__all__ = ["NodeCheck", "StepFault", "check", "installed_part"]


@dataclass(frozen=True)
class StepFault:
    """An exception of a replayed step.

    Attributes:
        tick: Tick of the step.
        text: The error, with the plugin's line.
        is_recorded: Whether the recorded step raised the same.
    """

    tick: int
    text: str
    is_recorded: bool


@dataclass
class NodeCheck:
    """Result of the replay of one node.

    Attributes:
        node: "role instance".
        steps: Number of replayed steps.
        messages: Number of messages compared bit for bit.
        differing: Number of them that differ, messages that only one side published included.
        unverified: Number of messages that differ where the node's state is not known, which may be why.
        first: The first difference; None if there is none.
        not_fed: Number of steps that lacked an input.
        first_not_fed: The first of them, and what it lacked.
        unrecorded: Number of messages that its step records count but the recording lacks.
        faults: Number of steps that raised an exception.
        first_fault, last_fault: The first and the last exception; None if there is none.
        notes: What else a reader must know.
    """

    node: str
    steps: int = 0
    messages: int = 0
    differing: int = 0
    unverified: int = 0
    first: ReplayDifference | None = None
    not_fed: int = 0
    first_not_fed: str = ""
    unrecorded: int = 0
    faults: int = 0
    first_fault: StepFault | None = None
    last_fault: StepFault | None = None
    notes: list[str] = field(default_factory=list)

    def to_json(self) -> dict[str, Any]:
        """The result as `replay --json` prints it."""
        return asdict(self)

    def caveats(self) -> list[str]:
        """Why equality proves less than it seems, or why a difference may have its cause before the recording."""
        found = list(self.notes)
        if self.unverified:
            found.append(f"{self.unverified} of its messages differ, which its unknown state may explain")
        if self.not_fed:
            found.append(f"{self.not_fed} steps were not fed in full: {self.first_not_fed}")
        if self.unrecorded:
            found.append(f"{self.unrecorded} messages it published are missing")
        return found


class _Checker:
    """Compares each replayed step with its recorded outputs."""

    def __init__(self, replayer: Replayer) -> None:
        self.outcomes = Outcomes(replayer)
        self.found: dict[tuple[str, str], NodeCheck] = {}

    def again(self, node: ReplayNode, stepped: Stepped, shelf: Shelf) -> None:
        """Compare one step."""
        step = stepped.step
        found = self.found.setdefault(node.source, NodeCheck(" ".join(node.source), notes=node.notes))
        counted = Counter(port for port, _ in stepped.outputs)
        numbers = self.outcomes.numbers(stepped, {port: counted[port] for port in node.fed.spec.outputs})
        # The numbers above are counted for each record, also for one without a step.
        if not step.report.trigger:
            return
        found.steps += 1
        if stepped.fed.missing:
            found.not_fed += 1
            found.first_not_fed = found.first_not_fed or f"tick {step.at.tick} lacks {'; '.join(stepped.fed.missing)}"
        if stepped.fault:
            found.faults += 1
            found.last_fault = StepFault(step.at.tick, stepped.fault, stepped.fault == step.report.fault)
            found.first_fault = found.first_fault or found.last_fault
        if stepped.fault != step.report.fault:
            recorded, replayed = step.report.fault or "no fault", stepped.fault or "no fault"
            self._differs(node, found, ReplayDifference(step.at.tick, found.node, "fault", "", recorded, replayed))
        for port, wanted in numbers.items():
            given = [message for name, message in stepped.outputs if name == port]
            entries = [self.outcomes.entry(step, port, number, shelf) for number in wanted]
            if not stepped.follows and not all(_is_of(entry, step.at.tick) for entry in entries):
                # The node made it in a step before the recording, as a map that the recorder received when it joined.
                continue
            self._compare(node, found, step.at.tick, port, given, entries)

    def _compare(
        self,
        node: ReplayNode,
        node_check: NodeCheck,
        tick: int,
        port: str,
        given: list[Message],
        entries: list[Entry | None],
    ) -> None:
        for place in range(max(len(given), len(entries))):
            is_recorded = place < len(entries)
            entry = entries[place] if is_recorded else None
            if is_recorded and entry is None:
                # A message that the recorder lost says nothing about the plugin.
                node_check.unrecorded += 1
                continue
            node_check.messages += 1
            difference = _difference(entry, given[place] if place < len(given) else None)
            if difference is not None:
                self._differs(node, node_check, ReplayDifference(tick, node_check.node, port, *difference))

    def _differs(self, node: ReplayNode, node_check: NodeCheck, difference: ReplayDifference) -> None:
        if node.is_unknown:
            node_check.unverified += 1
            return
        node_check.differing += 1
        node_check.first = node_check.first or difference


def _is_of(entry: Entry | None, tick: int) -> bool:
    """Whether a message was published in the step of a tick."""
    opened = entry.open() if entry is not None else None
    return opened is not None and opened.envelope.tick == tick


def _difference(entry: Entry | None, replayed: Message | None) -> tuple[str, str, str] | None:
    recorded = entry.open() if entry is not None else None
    if recorded is None or replayed is None or entry is None:
        said = "nothing" if recorded is None else type(recorded.message).__name__
        return "", said, "nothing" if replayed is None else type(replayed).__name__
    # Bytes first: finding the differing field is for people, and much slower.
    if is_same(recorded, entry.raw.data, entry.raw.label, replayed):
        return None
    before, now = (in_version(message, entry.raw.label) for message in (recorded.message, replayed))
    return first_difference(before, now) or ("", "other bytes", "the same values in other bytes")


def installed_part(loaded: Loaded) -> tuple[System, list[NodeCheck]]:
    """The system of a recording without the nodes whose plugins are not installed, and a result for each of these."""
    config = loaded.config
    missing = catalogue_of(config)[1]
    if not missing:
        return assemble(loaded), []
    absent = {name: config.role_table(name).instance for name in missing}
    lines = [NodeCheck(f"{name} {absent[name]}", notes=[f"not checked: {why}"]) for name, why in missing.items()]
    return replace(assemble(replace(loaded, config=config.without(missing))), absent=absent), lines


def check(replayer: Replayer, progress: Callable[[float, float], None] | None = None) -> list[NodeCheck]:
    """Replay every node except the platform and the operator. Results by node, in the order of the graph."""
    checker = _Checker(replayer)
    replayer.run(checker.again, progress)
    order = {spec.role: number for number, spec in enumerate(replayer.system.specs)}
    return [checker.found[source] for source in sorted(checker.found, key=lambda source: (order[source[0]], source))]
