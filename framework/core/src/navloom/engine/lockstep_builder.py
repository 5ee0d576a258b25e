"""Builds a lockstep executor from a system: steppers, slots, and the wires between them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from navloom.engine.build import stride_of
from navloom.engine.event_schedule import schedule
from navloom.engine.lockstep import Lockstep, Observer
from navloom.engine.nodes.gate_node import GateNode
from navloom.engine.nodes.goal_node import GoalNode
from navloom.engine.nodes.node_base import Node
from navloom.engine.nodes.operator_node import OperatorNode
from navloom.engine.nodes.reference_node import ReferenceNode
from navloom.engine.nodes.world_node import WorldNode
from navloom.engine.plugin_factory import configure, role_nodes
from navloom.engine.stepper import Stepper
from navloom.engine.system import System
from navloom.engine.trace import TraceWriter
from navloom.engine.wiring import Slot, Wire, make_wire
from navloom.geometry.footprints import inscribed_radius
from navloom.geometry.moving_world import Law, MovingWorld, RobotBody, walks
from navloom.geometry.walls import walls_of
from navloom.geometry.world import World
from navloom.navigation.collision_monitor import CollisionMonitor, MonitorLimits
from navloom.navigation.command_gate import CommandGate, GateLimits
from navloom.navigation.goal_machine import GoalMachine
from navloom.navigation.goal_rules import GoalRules
from navloom.navigation.replanning import ReplanRules
from navloom.parts import part
from navloom.roles import FIXED

__all__ = ["gate_limits", "goal_rules", "lockstep_of", "make_stepper", "moving_world_of", "own_node"]


def lockstep_of(system: System, observers: Sequence[Observer] = (), trace: TraceWriter | None = None) -> Lockstep:
    """The executor of a system whose plugins are made."""
    # The gate's node asks the executor which instances are warm, and the executor is made from the nodes: bound late.
    executor: Lockstep | None = None

    def is_warm(role: str, name: str) -> bool:
        assert executor is not None
        return executor.is_warm(role, name)

    nodes = role_nodes(system)
    steppers = [one for spec in system.specs for one in _steppers(system, spec.role, nodes, is_warm)]
    for stepper, wires in zip(steppers, _plan(steppers), strict=True):
        stepper.connect(wires)
    executor = Lockstep(
        system.catalogue,
        steppers,
        system.config.run.period,
        system.braking,
        schedule(system.config, system.goal),
        lambda role, instance, values: configure(system, role, instance, values),
        observers,
        trace,
    )
    may_wait = system.may_wait
    if may_wait:
        gate = executor.gate
        # Only where a node can wait at all, since the gate asks in every tick.
        gate.find_waiting = lambda: executor.waiting(may_wait)
    return executor


def _plan(steppers: Sequence[Stepper]) -> list[list[Wire]]:
    """The inputs of each stepper, connected to the active instances.

    A `~` input is a plain read if all its publishers step later in a tick and none of them has latency.
    """
    # Reversed, so that the first of a role, which is the active one, stays.
    in_charge = {stepper.role: stepper for stepper in reversed(steppers) if stepper.active}
    place = {role: number for number, role in enumerate(dict.fromkeys(stepper.role for stepper in steppers))}
    with_latency = {stepper.role for stepper in steppers if stepper.delay}
    return [
        [
            make_wire(
                given,
                in_charge[given.role].slots[given.port],
                is_plain=place[given.role] > place[stepper.role] and given.role not in with_latency,
            )
            for given in stepper.spec.inputs
        ]
        for stepper in steppers
    ]


def _selected(system: System) -> dict[str, str]:
    active = {role: system.config.role_table(role).instance for role in system.config.roles if role not in FIXED}
    return {**active, **system.absent}


def own_node(system: System, role: str, is_warm: Callable[[str, str], bool], is_live: bool = False) -> Node | None:
    """The framework's own node of a role; None for the role of a plugin."""
    if role == "operator":
        return OperatorNode()
    if role == "world":
        world = None if system.loaded.member else moving_world_of([system])
        return WorldNode(world, system.true_start, round(is_live * system.config.run.period * 1e9))
    if role == "goal":
        return GoalNode(GoalMachine(replace(goal_rules(system), is_live=is_live)), system.catalogue.optional)
    if role == "reference":
        return ReferenceNode.of(system.config, system.robot, system.braking, system.goal_tolerance)
    if role == "gate":
        return GateNode(CommandGate(gate_limits(system), gate_monitor(system)), _selected(system), is_warm)
    return None


def moving_world_of(systems: Sequence[System]) -> MovingWorld:
    """What moves in the world that systems share: its actors, and the robots."""
    world, period = systems[0].world, systems[0].config.run.period
    assert world is not None
    bodies = [RobotBody(system.config.robot.name, system.robot.footprint, system.robot.height) for system in systems]
    return MovingWorld(world, bodies, period, _law(world, period) if walks(world) else None)


def _law(world: World, period: float) -> Law:
    """How the actors of a world give way to each other, to robots and to walls: reciprocal velocity obstacles."""
    crowd, lines = part("navloom_orca.crowd", "an actor with goals"), walls_of(world)
    law = partial(crowd.react, lines=lines, reaction=crowd.Reaction(period=period))
    one = np.zeros((1, 2))
    law(one, one, np.ones(1), one, np.ones(1), np.zeros((1, 1), dtype=np.bool_))  # no control tick compiles
    return law


def make_stepper(system: System, role: str, name: str, node: Node) -> Stepper:
    """One instance of a node, not wired yet."""
    robot, spec = system.config.robot, system.wiring[role, name]
    prefix = f"{robot.realm}/{robot.name}/{spec.role}"
    slots = {
        port.name: Slot(f"{prefix}/{name}/{port.name}", f"{spec.role} {name} {port.name}", port.offset_ns)
        for port in spec.ports
    }
    part = system.parts.get((spec.role, name))
    if part is None:
        return Stepper(spec, node, name, slots, enabled=not (spec.role == "world" and system.loaded.member))
    period = system.config.run.period
    active = name == system.config.role_table(spec.role).instance
    return Stepper(
        spec,
        node,
        name,
        slots,
        active=active,
        enabled=active or getattr(part.table, "shadow", True),
        stride=stride_of(part.table, period),
        # Rounded first: 0.15 s of ticks of 0.05 s is 3.0000000000000004 ticks in floating point.
        delay=math.ceil(round(part.table.latency / period, 6)),
    )


def _steppers(
    system: System, role: str, nodes: dict[tuple[str, str], Node], is_warm: Callable[[str, str], bool]
) -> list[Stepper]:
    """Instances of one node, the active one first."""
    own = own_node(system, role, is_warm)
    if own is not None:
        return [make_stepper(system, role, "main", own)]
    made = [make_stepper(system, role, name, nodes[(role, name)]) for owner, name in system.parts if owner == role]
    return sorted(made, key=lambda one: not one.active)


def goal_rules(system: System) -> GoalRules:
    rules, run = system.config.navigation, system.config.run
    fastest = min(rules.speeds(system.robot.max_linear)[1], system.robot.max_linear)
    return GoalRules(
        tolerance=system.goal_tolerance,
        heading_tolerance=math.radians(rules.heading_tolerance_deg),
        stuck_after=rules.stuck_after,
        max_recoveries=rules.max_recoveries,
        patience=rules.patience,
        map_timeout=rules.map_timeout,
        localizer_timeout=system.localizer_timeout,
        searchers=frozenset(f"{role} {name}" for role, name in system.searchers),
        plan_timeout=rules.plan_timeout,
        deadline=system.time_limit,
        scans_on_request=system.scans_on_request,
        feedback_ticks=max(1, round(0.5 / run.period)),
        braking=system.braking,
        fastest=fastest,
        cruise=system.robot.max_linear if rules.handover == "always" else fastest,
        replan=ReplanRules(
            rules.replan_when_blocked,
            rules.replan_period,
            rules.replan_gain,
            # An obstacle nearer than this to the trajectory leaves no possible heading.
            inscribed_radius(system.robot.footprint),
        ),
    )


def gate_limits(system: System) -> GateLimits:
    gate = system.config.gate
    return GateLimits(
        robot=system.robot,
        period=system.config.run.period,
        stop_deadline_ns=round(gate.stop_deadline * 1e9),
        sensor_timeout_ns=round(gate.sensor_timeout * 1e9),
    )


def gate_monitor(system: System) -> CollisionMonitor | None:
    """The gate's collision monitor; None if the config disables it or the robot has no range sensors."""
    inputs = next(spec.inputs for spec in system.specs if spec.role == "gate")
    # Without a sensor, all space is unseen, and a monitor would stop the robot for good.
    if not any(given.name.startswith("scan.") for given in inputs):
        return None
    gate = system.config.gate
    return CollisionMonitor(
        MonitorLimits(system.robot, system.config.run.period, gate.range_sigma, approach_speed=gate.approach_speed)
    )
