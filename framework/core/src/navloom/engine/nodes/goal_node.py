"""The node of the goal: its state machine (`navigation.goal_machine`) on ports."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from navloom.engine.node_ports import Latest, New, Out, Output
from navloom.engine.nodes.executor_inputs import GoalTold
from navloom.engine.nodes.node_base import Node, Tick
from navloom.engine.streams import (
    AvoiderPorts,
    GatePorts,
    GoalPorts,
    LocalizerPorts,
    MapperPorts,
    OperatorPorts,
    PlannerPorts,
    RecoveryPorts,
    ReferencePorts,
)
from navloom.messages import OperatorRequest, Path, PlanFailure, Selection
from navloom.navigation.goal_machine import GoalMachine
from navloom.navigation.goal_rules import GoalView

__all__ = ["GoalNode"]


class GoalNode(Node):
    """Connects the goal's state machine to its ports.

    Args:
        machine: The goal's state machine.
        optional: Nodes whose failure does not end a goal.

    Attributes:
        fault: Failure that ends the goal; empty for none.
        is_lost: Live: the platform is silent.
        restarted: Live: roles whose instance restarted since the last step.
        submitted: Live: requests that came through a service instead of a port since the last step.
    """

    role = "goal"
    ticks = True
    is_awaited = True
    hears = "faults"
    request = New(OperatorPorts.request)
    pose = Latest(LocalizerPorts.pose)
    map = Latest(MapperPorts.map)
    # Delayed inputs break the circle: goal, planner, reference, gate and back to the goal.
    path = Latest(PlannerPorts.path, delayed=True)
    failure = Latest(PlannerPorts.failure, delayed=True)
    reference = Latest(ReferencePorts.reference, delayed=True)
    trajectory = Latest(ReferencePorts.trajectory, delayed=True)
    avoider = Latest(AvoiderPorts.status, delayed=True)
    handover = Latest(AvoiderPorts.handover, delayed=True)
    recovery = New(RecoveryPorts.status, delayed=True)
    gate = Latest(GatePorts.status, delayed=True)
    commanded = Latest(GatePorts.command, delayed=True)
    selection = Latest(GatePorts.selection, delayed=True)
    plan = Output(GoalPorts.plan)
    sweep = Output(GoalPorts.sweep)
    recover = Output(GoalPorts.recovery)
    clear = Output(GoalPorts.clear)
    drive = Output(GoalPorts.drive)
    feedback = Output(GoalPorts.feedback)
    result = Output(GoalPorts.result)
    cause = pose

    def __init__(self, machine: GoalMachine, optional: Collection[str] = ()) -> None:
        self.machine, self.optional = machine, optional
        self.fault = ""
        self.is_lost = False
        self.restarted: set[str] = set()
        self.submitted: list[OperatorRequest] = []
        self._answer: Path | PlanFailure | None = None
        self._selection: Selection | None = None
        self._selected = ("", "")
        self._looks_around = False
        # The state machine names its ports as text: it is pure and knows no ports.
        self._out: dict[str, Out[Any]] = {out.name: out for out in self.outs()}

    def step(self, tick: Tick) -> None:
        self.told = self._note()
        for answer in (self.path.value, self.failure.value):
            if answer is None or answer is self._answer:
                continue
            # Both ports keep their last message: the newer request decides which of the two is the answer.
            if self._answer is None or answer.request_id > self._answer.request_id:
                self._answer = answer
        steps, selection = self.recovery.values, self.selection.value
        if selection is not self._selection:
            self._selection = selection
            self._selected = _instances(selection)
            self._looks_around = self._finds_itself(selection)
        seen = GoalView(
            tick.number,
            tick.time,
            tick.time_ns,
            self.pose.value,
            self.map.value,
            self._answer,
            self.avoider.value,
            self.handover.value,
            # `New`, not `Latest`: the last message of an earlier attempt must not count for this one.
            steps[-1] if steps else None,
            self.gate.value,
            self.reference.value,
            self._selected,
            self.trajectory.value,
            self._is_through_seen(),
            0.0 if self.commanded.value is None else self.commanded.value.twist.vx,
            self._looks_around,
        )
        for request in self.request.values:
            if request.do == "goal" and request.goal is not None:
                self.machine.submit(request.goal, seen)
            elif request.do == "cancel":
                self.machine.cancel(seen)
            elif request.do in ("place", "relocalise"):
                self.machine.place(seen)
        if self.fault:
            self.machine.fail(self.fault, seen)
        if self.is_lost:
            self.machine.hold(seen)
        else:
            self.machine.go_on(seen)
        if self.restarted:
            # A set has another order in each process, and a replay must repeat the same one.
            for role in sorted(self.restarted):
                self.machine.restart_of(role, seen)
            self.restarted.clear()
        for port, message in self.machine.step(seen):
            self._out[port].put(message)

    def _is_through_seen(self) -> bool:
        """Whether the planner's newest path is one of the known map, because what the mapper saw leaves none."""
        answer, failure = self._answer, self.failure.value
        return isinstance(answer, Path) and failure is not None and failure.request_id == answer.request_id

    def _finds_itself(self, selection: Selection | None) -> bool:
        """Whether the active localizer can search, and the active recovery looks around meanwhile."""
        chosen = {} if selection is None else selection.chosen
        return {f"{role} {chosen.get(role)}" for role in ("localizer", "recovery")} <= self.machine.rules.searchers

    def _note(self) -> str:
        if not (self.fault or self.is_lost or self.restarted or self.submitted):
            return ""
        told = GoalTold(self.fault, self.is_lost, tuple(sorted(self.restarted)), tuple(self.submitted))
        self.submitted = []
        return told.text


def _instances(selection: Selection | None) -> tuple[str, str]:
    """Active instances of mapper and planner; empty before the first selection."""
    if selection is None:
        return "", ""
    chosen = selection.chosen
    return chosen["mapper"], chosen["planner"]
