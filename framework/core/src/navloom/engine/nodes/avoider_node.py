"""The node around an avoider."""

from __future__ import annotations

from typing import Any, Self

from navloom.engine.answer_checks import TwistDoor
from navloom.engine.node_ports import Latest, OtherSensors, Output, Sensors
from navloom.engine.nodes.node_base import NodeSettings, Tick
from navloom.engine.nodes.role_node import RANGES, RoleNode, in_order, readings_of
from navloom.engine.streams import AvoiderPorts, ControllerPorts, GatePorts, LocalizerPorts, MapperPorts, ReferencePorts
from navloom.messages import Avoidance, AvoiderStatus, Command, HandOver
from navloom.navigation.handover import NO_TURN, NOWHERE, HandOverRule, own_turn, own_way
from navloom.roles import Avoider, AvoiderInput

__all__ = ["AvoiderNode"]


class AvoiderNode(RoleNode[Avoider]):
    """Turns scans and the target into a velocity, and decides whether the avoider drives.

    Args:
        plugin: The avoider.
        rule: Decides whether the avoider or the controller drives.
        look_ahead: How far the rule also checks the way that the robot itself takes next, m; 0 for not at all.
    """

    role = "avoider"
    is_awaited = True
    desired = Latest(ControllerPorts.command, triggers=True)
    scans = Sensors(RANGES)
    readings = OtherSensors(RANGES)
    pose = Latest(LocalizerPorts.pose)
    reference = Latest(ReferencePorts.reference)
    # Of the previous tick: the gate steps after the avoider, whose command it judges.
    gate = Latest(GatePorts.status, delayed=True)
    known = Latest(MapperPorts.known)
    command = Output(AvoiderPorts.command)
    status = Output(AvoiderPorts.status)
    handover = Output(AvoiderPorts.handover)
    cause = pose

    def __init__(self, plugin: Avoider, rule: HandOverRule, look_ahead: float) -> None:
        self.plugin = plugin
        self.door = TwistDoor(plugin, Avoidance)
        self.rule = rule
        self.look_ahead = look_ahead

    @classmethod
    def around(cls, plugin: Avoider, settings: NodeSettings) -> Self:
        rules = settings.navigation
        rule = HandOverRule(
            rules.handover,
            rules.handover_release,
            margin=rules.corridor_margin,
            footprint=settings.robot.footprint,
        )
        return cls(plugin, rule, rules.look_ahead if rules.handover_own_way else 0.0)

    def step(self, tick: Tick) -> None:
        estimate, reference, wanted = self.pose.value, self.reference.value, self.desired.value
        assert estimate is not None and reference is not None and wanted is not None
        scans, names = in_order(self.scans)
        # The length of the trajectory left beyond the target, so that an avoider can slow down before the goal.
        ahead = max(0.0, reference.remaining - _distance(estimate.pose, reference.target))
        limit, desired = self.gate.value, wanted.twist
        seen = AvoiderInput(
            tick.time_ns,
            scans,
            estimate,
            reference.target,
            reference.corridor,
            desired,
            ahead,
            # What the gate left of the last command: an avoider that is limited all the time is trapped.
            1.0 if limit is None else limit.share,
            names,
            readings_of(self.readings),
            self.extra(),
        )
        answer = self.door.check(self.plugin.avoid(seen))
        own, turn, known = NOWHERE, NO_TURN, self.known.value
        if self.look_ahead > 0.0:
            own, turn = own_way(estimate.pose, desired, self.look_ahead), own_turn(desired, self.rule.footprint)
        # A map at the wrong place would engage the avoider for walls that are elsewhere.
        grid = known if estimate.state == "tracking" else None
        way, width = reference.way, reference.corridor
        # After the avoider, also in a shadow: which of them would drive is on record beside its command.
        handover = self.rule.step(tick.time, scans, estimate.pose, way, width, own, turn, grid)
        # Avoiders look ahead: one that took over a way back or to the side would turn the robot round.
        if reference.speed < 0.0 or reference.lateral_speed != 0.0:
            handover = HandOver(False, handover.nearest)
        self.command.put(Command(answer.twist))
        self.status.put(AvoiderStatus(answer.status, answer.diagnostics))
        self.handover.put(handover)


def _distance(pose: Any, point: Any) -> float:
    return float(((point.x - pose.x) ** 2 + (point.y - pose.y) ** 2) ** 0.5)
