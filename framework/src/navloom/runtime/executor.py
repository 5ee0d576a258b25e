"""From a built system to a lockstep executor: instances, slots and wires."""

from __future__ import annotations

import math
from collections.abc import Sequence

from navloom.config.schema import ROLE_TABLES
from navloom.dataflow.events import schedule
from navloom.dataflow.nodes import Node
from navloom.dataflow.own_nodes import GateNode, GoalNode, OperatorNode
from navloom.dataflow.ports import NodeSpec
from navloom.dataflow.reference import ReferenceNode
from navloom.navigation.gate import CommandGate, Limits
from navloom.navigation.goals import GoalMachine, GoalRules
from navloom.runtime.build import System, changed_params, role_nodes, stride_of
from navloom.runtime.lockstep import Lockstep, Observer
from navloom.runtime.trace import TraceWriter
from navloom.runtime.wiring import Instance, Slot, Wire

__all__ = ["gate_limits", "lockstep_of"]


def lockstep_of(system: System, observers: Sequence[Observer] = (), trace: TraceWriter | None = None) -> Lockstep:
    """The executor of a system whose plugins are made."""
    period = system.config.run.period
    by_role: dict[str, list[Instance]] = {}
    executor: Lockstep | None = None

    def is_warm(role: str, name: str) -> bool:
        assert executor is not None
        return executor.is_warm(role, name)

    nodes = role_nodes(system)
    own: dict[str, Node] = {
        "operator": OperatorNode(),
        "goal": GoalNode(GoalMachine(_goal_rules(system))),
        "reference": ReferenceNode.of(system.config, system.robot),
        "gate": GateNode(CommandGate(gate_limits(system)), _selected(system), is_warm),
    }
    for spec in system.specs:
        by_role[spec.role] = _instances(system, spec, own, nodes)
    for spec in system.specs:
        for instance in by_role[spec.role]:
            _wire(instance, {role: found[0] for role, found in by_role.items()})
    executor = Lockstep(
        [instance for spec in system.specs for instance in by_role[spec.role]],
        {key: system.plugin(*key) for key in system.parts},
        period,
        schedule(system.config, system.goal),
        lambda role, instance, values: changed_params(system, role, instance, values),
        observers,
        trace,
    )
    return executor


def _selected(system: System) -> dict[str, str]:
    return {role: system.config.role_table(role).instance for role in ROLE_TABLES if role != "platform"}


def _instances(
    system: System, spec: NodeSpec, own: dict[str, Node], nodes: dict[tuple[str, str], Node]
) -> list[Instance]:
    """Instances of one row of the table, the active one first."""
    robot = system.config.robot
    prefix = f"{robot.realm}/{robot.name}/{spec.role}"
    period = system.config.run.period

    def make(name: str, node: Node, active: bool, enabled: bool, stride: int, delay: int) -> Instance:
        slots = {port: Slot(f"{prefix}/{name}/{port}", f"{spec.role} {name} {port}") for port in spec.outputs}
        return Instance(spec, node, name, active, enabled, stride, delay, slots)

    if spec.role in own:
        return [make("main", own[spec.role], True, True, 1, 0)]
    made = []
    for (role, name), part in system.parts.items():
        if role == spec.role:
            active = name == system.config.role_table(role).instance
            enabled = active or getattr(part.table, "shadow", True)
            delay = math.ceil(round(part.table.latency / period, 6))
            made.append(make(name, nodes[(role, name)], active, enabled, stride_of(part.table, period), delay))
    return sorted(made, key=lambda instance: not instance.active)


def _wire(instance: Instance, active: dict[str, Instance]) -> None:
    for given in instance.spec.inputs:
        instance.connect(Wire(given, active[given.role].slots[given.port]))


def _goal_rules(system: System) -> GoalRules:
    rules, run = system.config.navigation, system.config.run
    return GoalRules(
        tolerance=system.goal_tolerance,
        heading_tolerance=math.radians(rules.heading_tolerance_deg),
        stuck_after=rules.stuck_after,
        max_recoveries=rules.max_recoveries,
        map_timeout=rules.map_timeout,
        plan_timeout=rules.plan_timeout,
        deadline=run.stop_after,
        scans_on_request=system.scans_on_request,
        feedback_ticks=max(1, round(0.5 / run.period)),
    )


def gate_limits(system: System) -> Limits:
    robot, gate = system.robot, system.config.gate
    return Limits(
        linear=robot.max_linear,
        angular=robot.max_angular,
        acceleration=robot.max_acceleration,
        deceleration=robot.max_deceleration,
        period=system.config.run.period,
        stop_deadline_ns=round(gate.stop_deadline * 1e9),
        sensor_timeout_ns=round(gate.sensor_timeout * 1e9),
    )
