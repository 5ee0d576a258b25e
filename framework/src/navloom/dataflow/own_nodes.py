"""The framework's own nodes: operator, goal and gate. The reference node has a file of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from navloom.dataflow.nodes import Inputs, Outputs, Tick
from navloom.messages import Envelope, GateStatus, OperatorRequest, Path, PlanFailure, RecoveryStep, Selection, Twist2D
from navloom.messages.motion import Command
from navloom.navigation.gate import CommandGate, Offer, Sensed
from navloom.navigation.goals import GoalMachine, Seen

__all__ = ["GateNode", "GoalNode", "OperatorNode"]


class OperatorNode:
    """Publishes what operators asked for in this tick."""

    def __init__(self) -> None:
        self.requests: list[OperatorRequest] = []

    def step(self, tick: Tick, given: Inputs) -> Outputs:
        out: Outputs = [("request", request) for request in self.requests]
        self.requests = []
        return out


class GoalNode:
    """The goal's state machine on its ports."""

    def __init__(self, machine: GoalMachine) -> None:
        self.machine = machine
        self.fault = ""
        self._answer: Path | PlanFailure | None = None
        self._selection: Selection | None = None
        self._selected = ("", "")

    def step(self, tick: Tick, given: Inputs) -> Outputs:
        for answer in (given["path"], given["failure"]):
            if answer is not None and (self._answer is None or answer.request_id > self._answer.request_id):
                self._answer = answer
        steps: Sequence[RecoveryStep] = given["recovery"]
        if given["selection"] is not self._selection:
            self._selection = given["selection"]
            self._selected = _instances(self._selection)
        seen = Seen(
            tick.number,
            tick.time,
            tick.time_ns,
            given["pose"],
            given["map"],
            self._answer,
            given["avoider"],
            given["handover"],
            steps[-1] if steps else None,
            given["gate"],
            given["reference"],
            self._selected,
        )
        for request in given["request"]:
            if request.do == "goal":
                self.machine.submit(request.goal, seen)
            elif request.do == "cancel":
                self.machine.cancel(seen)
        if self.fault:
            self.machine.fail(self.fault, seen)
        return self.machine.step(seen)


def _instances(selection: Selection | None) -> tuple[str, str]:
    """Instances of mapper and planner in charge."""
    if selection is None:
        return "", ""
    chosen = dict(entry.split(" ", 1) for entry in selection.instances)
    return chosen["mapper"], chosen["planner"]


class GateNode:
    """The command gate on its ports, and the keeper of the selection.

    Args:
        gate: The decision.
        selected: Instance in charge, by role, at the start.
        is_warm: Whether an instance has published what its role is for, so that it can take over.
    """

    def __init__(self, gate: CommandGate, selected: dict[str, str], is_warm: Callable[[str, str], bool]) -> None:
        self.gate = gate
        self.selected = dict(selected)
        self.is_warm = is_warm
        self.epoch = 0
        self._pending: dict[str, str] = {}
        self._status: GateStatus | None = None
        self._required: tuple[str, ...] | None = None

    def step(self, tick: Tick, given: Inputs) -> Outputs:
        for request in given["request"]:
            if request.do in ("stop", "resume"):
                self.gate.request(request.do)
            elif request.do == "swap" and self.selected.get(request.role) != request.instance:
                self._pending[request.role] = request.instance
        out: Outputs = []
        if self._take_over() or tick.number == 0:
            chosen = tuple(f"{role} {name}" for role, name in sorted(self.selected.items()))
            out.append(("selection", Selection(self.epoch, tick.number + 1 if self.epoch else 0, chosen)))
        pending = [f"{role} {name}" for role, name in sorted(self._pending.items())]
        handover = given["handover"]
        twist, _, status = self.gate.decide(
            self._sensed(given), self._offers(given), handover is not None and handover.engaged, tick.epoch, pending
        )
        out.append(("command", Command(twist)))
        if status != self._status:
            self._status = status
            out.append(("status", status))
        return out

    def _take_over(self) -> bool:
        """Select the pending instances that are warm; True where there were any."""
        warm = [role for role, name in self._pending.items() if self.is_warm(role, name)]
        for role in warm:
            self.selected[role] = self._pending.pop(role)
        self.epoch += bool(warm)
        return bool(warm)

    def _sensed(self, given: Inputs) -> Sensed:
        if self._required is None:
            self._required = tuple(name for name in given if name.startswith("required."))
        odometry, contact = given["odometry"], given["contact"]
        stamps = {
            name.removeprefix("required."): given[name][1].stamp_ns if given[name] else 0 for name in self._required
        }
        newest = odometry[1].stamp_ns if odometry else 0
        return Sensed(newest, contact is not None and contact.touching, stamps)

    def _offers(self, given: Inputs) -> dict[str, Offer | None]:
        drive, recovering = given["drive"], given["recovering"]
        offers: dict[str, Offer | None] = {}
        if recovering is not None and recovering.active:
            offers["recovery"] = self._offer("recovery", given["recovery"])
        elif drive is not None and drive.path_id:
            offers["controller"] = self._offer("controller", given["controller"])
            offers["avoider"] = self._offer("avoider", given["avoider"])
        return offers

    def _offer(self, role: str, held: tuple[Command, Envelope] | None) -> Offer | None:
        if held is None:
            return None
        message, envelope = held
        twist: Twist2D = message.twist
        return Offer(self.selected[role], twist, envelope.cause_ns, envelope.epoch)
