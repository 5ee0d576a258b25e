"""From a built system to a lockstep executor: instances, slots and wires."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from navloom.config.schema import ROLE_TABLES
from navloom.engine.build import System, configure, role_nodes, stride_of
from navloom.engine.events import schedule
from navloom.engine.lockstep import Lockstep, Observer
from navloom.engine.nodes import Node
from navloom.engine.own_nodes import GateNode, GoalNode, OperatorNode
from navloom.engine.ports import NodeSpec
from navloom.engine.reference import ReferenceNode
from navloom.engine.trace import TraceWriter
from navloom.engine.wiring import Instance, Slot, Wire
from navloom.geometry.footprints import inscribed_radius
from navloom.navigation.gate import CommandGate, Limits
from navloom.navigation.goal_rules import GoalRules
from navloom.navigation.goals import GoalMachine
from navloom.navigation.monitor import Monitor, MonitorLimits
from navloom.navigation.replanning import ReplanRules

__all__ = ["gate_limits", "goal_rules", "lockstep_of", "make_instance", "own_node"]


def lockstep_of(system: System, observers: Sequence[Observer] = (), trace: TraceWriter | None = None) -> Lockstep:
    """The executor of a system whose plugins are made."""
    period = system.config.run.period
    by_role: dict[str, list[Instance]] = {}
    executor: Lockstep | None = None

    def is_warm(role: str, name: str) -> bool:
        assert executor is not None
        return executor.is_warm(role, name)

    nodes = role_nodes(system)
    for spec in system.specs:
        by_role[spec.role] = _instances(system, spec, nodes, is_warm)
    for spec in system.specs:
        for instance in by_role[spec.role]:
            _wire(instance, {role: found[0] for role, found in by_role.items()})
    executor = Lockstep(
        [instance for spec in system.specs for instance in by_role[spec.role]],
        period,
        schedule(system.config, system.goal),
        lambda role, instance, values: configure(system, role, instance, values),
        observers,
        trace,
    )
    return executor


def _selected(system: System) -> dict[str, str]:
    return {role: system.config.role_table(role).instance for role in ROLE_TABLES if role != "platform"}


def own_node(system: System, role: str, is_warm: Callable[[str, str], bool], is_live: bool = False) -> Node | None:
    """The framework's own node of a role; None where a plugin's belongs."""
    if role == "operator":
        return OperatorNode()
    if role == "goal":
        return GoalNode(GoalMachine(replace(goal_rules(system), is_live=is_live)))
    if role == "reference":
        return ReferenceNode.of(system.config, system.robot)
    if role == "gate":
        return GateNode(CommandGate(gate_limits(system), gate_monitor(system)), _selected(system), is_warm)
    return None


def make_instance(system: System, spec: NodeSpec, name: str, node: Node) -> Instance:
    """One node, not wired yet."""
    robot = system.config.robot
    prefix = f"{robot.realm}/{robot.name}/{spec.role}"
    slots = {port: Slot(f"{prefix}/{name}/{port}", f"{spec.role} {name} {port}") for port in spec.outputs}
    part = system.parts.get((spec.role, name))
    if part is None:
        return Instance(spec, node, name, True, True, 1, 0, slots)
    period = system.config.run.period
    active = name == system.config.role_table(spec.role).instance
    enabled = active or getattr(part.table, "shadow", True)
    delay = math.ceil(round(part.table.latency / period, 6))
    return Instance(spec, node, name, active, enabled, stride_of(part.table, period), delay, slots)


def _instances(
    system: System, spec: NodeSpec, nodes: dict[tuple[str, str], Node], is_warm: Callable[[str, str], bool]
) -> list[Instance]:
    """Instances of one row of the table, the active one first."""
    own = own_node(system, spec.role, is_warm)
    if own is not None:
        return [make_instance(system, spec, "main", own)]
    made = [make_instance(system, spec, name, nodes[(role, name)]) for role, name in system.parts if role == spec.role]
    return sorted(made, key=lambda instance: not instance.active)


def _wire(instance: Instance, active: dict[str, Instance]) -> None:
    for given in instance.spec.inputs:
        instance.connect(Wire(given, active[given.role].slots[given.port]))


def goal_rules(system: System) -> GoalRules:
    rules, run = system.config.navigation, system.config.run
    return GoalRules(
        tolerance=system.goal_tolerance,
        heading_tolerance=math.radians(rules.heading_tolerance_deg),
        stuck_after=rules.stuck_after,
        max_recoveries=rules.max_recoveries,
        map_timeout=rules.map_timeout,
        plan_timeout=rules.plan_timeout,
        deadline=system.time_limit,
        scans_on_request=system.scans_on_request,
        feedback_ticks=max(1, round(0.5 / run.period)),
        replan=ReplanRules(
            rules.replan_when_blocked,
            rules.replan_period,
            rules.replan_gain,
            inscribed_radius(system.robot.footprint),
        ),
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
        turn_acceleration=robot.max_angular_acceleration,
    )


def gate_monitor(system: System) -> Monitor | None:
    """The look ahead of the gate; None where the config does without, and for a robot without range sensors."""
    robot, gate = system.robot, system.config.gate
    inputs = next(spec.inputs for spec in system.specs if spec.role == "gate")
    if not any(given.name.startswith("scan.") for given in inputs):
        return None
    return Monitor(
        MonitorLimits(
            footprint=robot.footprint,
            period=system.config.run.period,
            deceleration=robot.max_deceleration,
            turn_deceleration=robot.max_angular_acceleration,
            lag=robot.motor_lag,
            dead_time=robot.dead_time,
            sigma=gate.range_sigma,
        )
    )
