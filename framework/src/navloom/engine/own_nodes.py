"""The framework's own nodes: operator, goal and gate. The reference node has a file of its own.

What an executor tells goal and gate beside their inputs goes into their step records as `told`, a JSON object; so a
replay can tell them the same. It is empty where nothing was told.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence

from navloom.engine.nodes import Inputs, Outputs, Tick
from navloom.messages import Envelope, GateStatus, OperatorRequest, Path, PlanFailure, RecoveryStep, Selection, Twist2D
from navloom.messages.motion import Command
from navloom.navigation.gate import STOPPED, CommandGate, Offer, Sensed
from navloom.navigation.goal_rules import Seen
from navloom.navigation.goals import GoalMachine

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
    """The goal's state machine on its ports.

    Attributes:
        fault: What broke, for which the goal ends; empty for nothing.
        is_lost: Live: the platform is not heard.
        restarted: Live: roles whose instance came back since the last step.
        submitted: Live: requests that came by a service instead of a port since the last step, as JSON.
        told: Of the last step: `fault`, `lost`, `restarted`, `submitted`.
    """

    def __init__(self, machine: GoalMachine) -> None:
        self.machine = machine
        self.fault = ""
        self.is_lost = False
        self.restarted: set[str] = set()
        self.submitted: list[dict[str, object]] = []
        self.told = ""
        self._answer: Path | PlanFailure | None = None
        self._selection: Selection | None = None
        self._selected = ("", "")

    def step(self, tick: Tick, given: Inputs) -> Outputs:
        self.told = self._note()
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
            given["trajectory"],
        )
        for request in given["request"]:
            if request.do == "goal":
                self.machine.submit(request.goal, seen)
            elif request.do == "cancel":
                self.machine.cancel(seen)
        if self.fault:
            self.machine.fail(self.fault, seen)
        if self.is_lost:
            self.machine.hold(seen)
        else:
            self.machine.go_on(seen)
        for role in sorted(self.restarted):
            self.machine.restart_of(role, seen)
        self.restarted.clear()
        return self.machine.step(seen)

    def _note(self) -> str:
        if not (self.fault or self.is_lost or self.restarted or self.submitted):
            return ""
        told = {
            "fault": self.fault,
            "lost": self.is_lost,
            "restarted": sorted(self.restarted),
            "submitted": self.submitted,
        }
        self.submitted = []
        return json.dumps(told)


def _instances(selection: Selection | None) -> tuple[str, str]:
    """Instances of mapper and planner in charge."""
    if selection is None:
        return "", ""
    chosen = selection.chosen
    return chosen["mapper"], chosen["planner"]


class GateNode:
    """The command gate on its ports, and the keeper of the selection.

    Args:
        gate: The decision.
        selected: Instance in charge, by role, at the start.
        is_warm: Whether an instance has published what its role is for, so that it can take over.

    Attributes:
        cause_ns: Platform stamp that the last command derives from.
        lead: Ticks between the word of a selection and the first in which it holds; live more, for it has to get there.
        now_ns: Live: what the platform's clock shows by now; None where its newest stamp is the time.
        is_silent, gone: Live: see `Sensed`.
        obeyed: Live: requests that came by a service since the last step, as JSON.
        told: Of the last step: `now_ns`, `silent`, `gone`, `obeyed`, `contact` (latched between two steps), and
            `warm`, the "role instance" that were found able to take over.
    """

    def __init__(self, gate: CommandGate, selected: dict[str, str], is_warm: Callable[[str, str], bool]) -> None:
        self.gate = gate
        self.selected = dict(selected)
        self.is_warm = is_warm
        self.epoch = 0
        self.cause_ns = 0
        self.lead = 1
        self.now_ns: int | None = None
        self.is_silent = False
        self.gone = ""
        self.obeyed: list[dict[str, object]] = []
        self.told = ""
        self._warm: list[str] = []
        self._pending: dict[str, str] = {}
        self._status: GateStatus | None = None
        self._required: tuple[str, ...] | None = None
        self._scans: tuple[str, ...] | None = None
        self._released: object = None
        self._has_selected = False
        self._from_tick = 0

    def step(self, tick: Tick, given: Inputs) -> Outputs:
        has_contact = self.gate.has_contact
        for request in given["request"]:
            self.obey(request, given["operator"])
        out: Outputs = []
        if self._take_over(tick.number) or not self._has_selected:
            self._has_selected = True
            self._from_tick = tick.number + self.lead if self.epoch else 0
            chosen = tuple(f"{role} {name}" for role, name in sorted(self.selected.items()))
            out.append(("selection", Selection(self.epoch, self._from_tick, chosen)))
        sensed = self._sensed(given)
        self._see(given)
        twist, self.cause_ns, status = self.gate.decide(
            sensed, self._offers(given, tick.epoch), _engaged(given), tick.epoch, self.pending
        )
        out.append(("command", Command(twist)))
        self._gave(twist, sensed.platform_ns)
        if status != self._status:
            self._status = status
            out.append(("status", status))
        self._note(has_contact)
        return out

    def check(self, tick: Tick, given: Inputs) -> Outputs:
        """Between two ticks: stop at once where something is wrong by now; nothing where all is well or stopped."""
        sensed, has_contact = self._sensed(given), self.gate.has_contact
        has_seen = self._see(given)
        reason = self.gate.choose(sensed, self._offers(given, tick.epoch), _engaged(given), tick.epoch)[2]
        said = self._status
        if not reason and said is not None and has_seen:
            return self._look_again(said, sensed.platform_ns)
        if not reason or (said is not None and said.stopped and said.latched == self.gate.is_latched):
            return []
        self._note(has_contact)
        return self.stop(reason, sensed.platform_ns)

    def stop(self, reason: str, platform_ns: int) -> Outputs:
        """Zero, and why."""
        self.cause_ns = platform_ns
        self._status = self.gate.stop(reason, self.pending)
        self._gave(STOPPED, platform_ns)
        return [("command", Command(STOPPED)), ("status", self._status)]

    def restore(self, epoch: int, selected: dict[str, str], latched: str) -> None:
        """Take up where a gate before this one was: its selection, under a newer epoch, and its latched stop."""
        self.epoch = epoch + 1
        self.selected |= selected
        self.gate.latch(latched)

    def begin_anew(self) -> None:
        """The run clock began anew: the selection in force holds from its beginning."""
        self._from_tick = 0

    @property
    def pending(self) -> list[str]:
        """Swaps that wait, as "role instance", in order of role."""
        return [f"{role} {name}" for role, name in sorted(self._pending.items())]

    def obey(self, request: OperatorRequest, driving: tuple[Command, Envelope] | None) -> None:
        """Take an operator's request; `driving` is the newest command of an operator who drives himself."""
        if request.do in ("stop", "resume", "release", "enter_unseen"):
            self.gate.request(request.do)
        if request.do in ("release", "resume"):
            self._released = driving[0] if driving else None
        elif request.do == "swap":
            if self.selected.get(request.role) != request.instance:
                self._pending[request.role] = request.instance
            else:
                self._pending.pop(request.role, None)

    def _take_over(self, number: int) -> bool:
        """Select the pending instances that are warm, once the selection before holds; True where there were any."""
        if number < self._from_tick:
            return False
        warm = [role for role, name in self._pending.items() if self.is_warm(role, name)]
        self._warm = [f"{role} {self._pending[role]}" for role in warm]
        for role in warm:
            self.selected[role] = self._pending.pop(role)
        self.epoch += bool(warm)
        return bool(warm)

    def _note(self, has_contact: bool) -> None:
        if self.now_ns is None and not self._warm:
            self.told = ""
            return
        told = {
            "now_ns": self.now_ns,
            "silent": self.is_silent,
            "gone": self.gone,
            "obeyed": self.obeyed,
            "contact": has_contact,
            "warm": self._warm,
        }
        self.told = json.dumps({name: value for name, value in told.items() if value})
        self.obeyed, self._warm = [], []

    def _look_again(self, said: GateStatus, platform_ns: int) -> Outputs:
        """What a scan between two ticks changes."""
        found = self.gate.look_again(said, platform_ns * 1e-9)
        if found is None:
            return []
        twist, self._status = found
        self._gave(twist, platform_ns)
        self._note(self.gate.has_contact)
        return [("command", Command(twist)), ("status", self._status)]

    def _see(self, given: Inputs) -> bool:
        """Show the monitor what came in since the last look; True where a scan did."""
        monitor, odometry = self.gate.monitor, given["odometry"]
        if monitor is None or not odometry:
            return False
        monitor.move(odometry[0])
        if self._scans is None:
            self._scans = tuple(name for name in given if name.startswith("scan."))
        news = [monitor.look(name, scan) for name in self._scans for scan in given[name]]
        return any(news)

    def _gave(self, twist: Twist2D, time_ns: int) -> None:
        if self.gate.monitor is not None:
            self.gate.monitor.give(time_ns * 1e-9, twist)

    def _sensed(self, given: Inputs) -> Sensed:
        if self._required is None:
            self._required = tuple(name for name in given if name.startswith("required."))
        odometry, contact = given["odometry"], given["contact"]
        stamps = {
            name.removeprefix("required."): given[name][1].stamp_ns if given[name] else 0 for name in self._required
        }
        newest = odometry[1].stamp_ns if odometry else 0
        if self.now_ns is not None:
            newest = max(newest, self.now_ns)
        return Sensed(newest, contact is not None and contact.touching, stamps, self.is_silent, self.gone)

    def _offers(self, given: Inputs, epoch: int) -> dict[str, Offer | None]:
        drive, recovering, operator = given["drive"], given["recovering"], given["operator"]
        offers: dict[str, Offer | None] = {}
        if operator and operator[0] is not self._released:
            offers["operator"] = self._offer("operator", operator, epoch)
        if recovering is not None and recovering.active:
            offers["recovery"] = self._offer("recovery", given["recovery"], epoch)
        elif drive is not None and drive.path_id:
            offers["controller"] = self._offer("controller", given["controller"], epoch)
            offers["avoider"] = self._offer("avoider", given["avoider"], epoch)
        return offers

    def _offer(self, role: str, held: tuple[Command, Envelope] | None, epoch: int) -> Offer | None:
        """A command on offer. One made before the selection began to hold is not asked to know it."""
        if held is None:
            return None
        message, envelope = held
        made_under = envelope.epoch if envelope.tick >= self._from_tick else epoch
        return Offer(self.selected.get(role, "main"), message.twist, envelope.cause_ns, made_under)


def _engaged(given: Inputs) -> bool:
    handover = given["handover"]
    return handover is not None and handover.engaged
