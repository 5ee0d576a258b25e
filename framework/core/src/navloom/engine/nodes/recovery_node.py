"""The node around a recovery."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from navloom.engine.answer_checks import TwistDoor
from navloom.engine.node_ports import Latest, OtherSensors, Output, Sensors
from navloom.engine.nodes.node_base import Tick
from navloom.engine.nodes.role_node import RANGES, RoleNode, in_order, readings_of
from navloom.engine.streams import GoalPorts, LocalizerPorts, MapperPorts, RecoveryPorts
from navloom.messages import Command, PoseEstimate, RecoveryStep
from navloom.navigation.monitor_map import NO_SURFACES, surfaces_without_echo
from navloom.roles import Recovery, RecoveryInput

__all__ = ["RecoveryNode"]

TRAIL_STEP = 0.05
"""Distance between two points of the trail of past poses that recoveries receive, m."""
# 5 m: the gate lets a robot back into space where it was within the last 5 m.
TRAIL_LENGTH = 100
AROUND = 5.0
"""How far from the robot recoveries receive the surfaces of the map, m."""


class RecoveryNode(RoleNode[Recovery]):
    """Runs the recovery while the goal requests it; one attempt ends with `done` or `failed`."""

    role = "recovery"
    ticks = True
    answers_when_asked = True
    is_awaited = True
    request = Latest(GoalPorts.recovery, delayed=True)
    scans = Sensors(RANGES)
    readings = OtherSensors(RANGES)
    pose = Latest(LocalizerPorts.pose)
    known = Latest(MapperPorts.known)
    command = Output(RecoveryPorts.command)
    status = Output(RecoveryPorts.status)
    cause = pose

    def __init__(self, plugin: Recovery) -> None:
        self.plugin = plugin
        self.door = TwistDoor(plugin, RecoveryStep)
        self._attempt: object = None
        self._is_over = True
        self._trail: deque[tuple[float, float, float]] = deque(maxlen=TRAIL_LENGTH)

    def step(self, tick: Tick) -> None:
        request, estimate = self.request.value, self.pose.value
        # In every tick, not only during a recovery: the trail is what was driven before it.
        self._follow(estimate)
        if request is None or not request.active or estimate is None:
            return
        # By identity: requests are equal if the same reason comes twice.
        starts = request is not self._attempt
        if starts:
            self._attempt, self._is_over = request, False
        # The goal needs a tick to see that the attempt is over; the plugin must not run on meanwhile.
        if self._is_over:
            return
        # A robot that cannot see behind itself backs up along its own trail.
        trail = np.array(self._trail).reshape(-1, 3)
        # The plugin must not change what the next step gets.
        trail.flags.writeable = False
        scans, names = in_order(self.scans)
        seen = RecoveryInput(
            tick.time_ns,
            scans,
            estimate,
            request.attempt,
            request.reason,
            starts,
            trail,
            names,
            readings_of(self.readings),
            self.extra(),
            # A robot without room to turn finds its way along a wall by the map: it sees part of it only.
            self._surfaces(estimate),
        )
        answer = self.door.check(self.plugin.recover(seen))
        self._is_over = answer.state != "running"
        self.command.put(Command(answer.twist))
        self.status.put(answer)

    def _surfaces(self, estimate: PoseEstimate) -> NDArray[np.float64]:
        """(n, 2) points of the known map's surfaces, m, base frame; none while the localizer does not track."""
        known = self.known.value
        if known is None or estimate.state != "tracking":
            return NO_SURFACES
        # All surfaces, whether echoes show them or not: recoveries combine both themselves.
        return surfaces_without_echo(known, estimate.pose, AROUND, NO_SURFACES)

    def _follow(self, estimate: PoseEstimate | None) -> None:
        """Add the pose to the trail of where the robot has been."""
        if estimate is None:
            return
        if estimate.state != "tracking":
            self._trail.clear()  # its poses jump when the robot is found
            return
        pose = estimate.pose
        if not self._trail or math.dist((pose.x, pose.y), self._trail[-1][:2]) >= TRAIL_STEP:
            self._trail.append((pose.x, pose.y, pose.heading))
