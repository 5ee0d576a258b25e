"""Nodes around the roles: each builds the role's input from its ports, and publishes the plugin's answer."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from operator import itemgetter
from types import MappingProxyType
from typing import Any, Generic, TypeVar

import numpy as np

from navloom.engine.door import LocalizerDoor, MapperDoor, PlannerDoor, PlatformDoor, TwistDoor
from navloom.engine.node import Node, Tick
from navloom.engine.ports import ExtraInputs, Latest, New, News, OtherSensors, Output, SensorOutputs, Sensors, Track
from navloom.engine.streams import (
    AvoiderPorts,
    ControllerPorts,
    GatePorts,
    GoalPorts,
    LocalizerPorts,
    MapperPorts,
    PlannerPorts,
    PlatformPorts,
    RecoveryPorts,
    ReferencePorts,
)
from navloom.messages import (
    Avoidance,
    AvoiderStatus,
    Command,
    Message,
    Path,
    PoseEstimate,
    PoseTrack,
    RangeScan,
    RecoveryStep,
    Sweep,
    TrackingCommand,
    Twist2D,
)
from navloom.navigation.handover import NOWHERE, HandOverRule, own_way
from navloom.roles import (
    Avoider,
    AvoiderInput,
    Controller,
    ControllerInput,
    Localizer,
    LocalizerInput,
    Mapper,
    MapperInput,
    Planner,
    PlannerInput,
    Platform,
    PlatformInput,
    Recovery,
    RecoveryInput,
    Role,
)
from navloom.roles.extra import NO_EXTRAS, Extras, extras_of
from navloom.roles.readings import NO_READINGS, Readings

__all__ = ["AvoiderNode", "ControllerNode", "LocalizerNode", "MapperNode", "PlannerNode", "PlatformNode",
           "RecoveryNode", "in_order"]  # fmt: skip

RANGES = (RangeScan, Sweep)
"""Sensor messages that roles receive as scans and sweeps; those of all other sensors are readings."""

M = TypeVar("M", bound=Message)
P = TypeVar("P", bound=Role)
STILL = Twist2D(0.0, 0.0, 0.0)
BEFORE_DATA_NS = 500_000_000
"""How far a mapper's track of poses reaches back before its oldest data, ns."""
TRAIL_STEP = 0.05
"""Distance between two points of the trail of past poses that recoveries receive, m."""
TRAIL_LENGTH = 100


class PlatformNode(Node):
    """The robot itself."""

    role = "platform"
    ticks = True
    is_awaited = True
    command = Latest(GatePorts.command, delayed=True)
    sweep = New(GoalPorts.sweep, delayed=True)
    odometry = Output(PlatformPorts.odometry)
    scans = SensorOutputs()
    contact = Output(PlatformPorts.contact)
    truth = Output(PlatformPorts.truth)

    def __init__(self, plugin: Platform) -> None:
        self.plugin = plugin
        self.door = PlatformDoor(plugin)
        self.driven: Command | None = None

    def step(self, tick: Tick) -> None:
        command = self.driven or self.command.value
        sweeps = self.sweep.values
        twist = command.twist if command is not None else STILL
        seen = PlatformInput(twist, sweeps[-1] if sweeps else None, tick.time_ns)
        got = self.door.check(self.plugin.advance(seen), seen)
        self.odometry.put(got.odometry)
        self.contact.put(got.contact)
        for name, scan in got.scans.items():
            self.scans[name].put(scan)
        if got.truth is not None:
            self.truth.put(got.truth)


class RoleNode(Node, Generic[P]):
    """Base of nodes whose plugins may declare extra inputs."""

    extras = ExtraInputs()
    plugin: P

    def extra(self) -> Extras:
        """Current messages of the plugin's extra inputs."""
        if not self.extras:
            return NO_EXTRAS
        declared = extras_of(type(self.plugin))
        return Extras({declared[name]: held.value for name, held in self.extras.items()})


class LocalizerNode(RoleNode[Localizer]):
    """Turns odometry and scans into a pose in the map."""

    role = "localizer"
    is_awaited = True
    odometry = Latest(PlatformPorts.odometry, triggers=True)
    scans = Sensors(RANGES)
    readings = OtherSensors(RANGES)
    map = Latest(MapperPorts.map, delayed=True)
    pose = Output(LocalizerPorts.pose)
    cause = odometry

    def __init__(self, plugin: Localizer) -> None:
        self.plugin = plugin
        self.door = LocalizerDoor(plugin)

    def step(self, tick: Tick) -> None:
        odometry = self.odometry.value
        assert odometry is not None
        scans, names = in_order(self.scans)
        seen = LocalizerInput(odometry, scans, self.map.value, names, _read(self.readings), self.extra())
        self.pose.put(self.door.check(self.plugin.localize(seen), seen))


class MapperNode(RoleNode[Mapper]):
    """Turns range data and the poses of the same time into a map."""

    role = "mapper"
    patience = 1.0  # no node waits for a map, and on a slow link the poses of a sweep can arrive after it
    scans = Sensors(RANGES, triggers=True, otherwise=PlatformPorts.odometry)
    readings = OtherSensors(RANGES, triggers=True)
    track = Track(LocalizerPorts.pose)
    clear = New(GoalPorts.clear, delayed=True, triggers=True)
    map = Output(MapperPorts.map)
    cause = track

    def __init__(self, plugin: Mapper) -> None:
        self.plugin = plugin
        self.door = MapperDoor(plugin)

    def step(self, tick: Tick) -> None:
        data, names = in_order(self.scans)
        named = list(zip(data, names, strict=True))
        sweeps, sweep_sensors = _of_kind(Sweep, named)
        scans, sensors = _of_kind(RangeScan, named)
        track = _covering(self.track.values, min((message.stamp_ns for message in data), default=tick.time_ns))
        seen = MapperInput(
            tick.time_ns,
            sweeps,
            scans,
            track,
            bool(self.clear.values),
            sensors,
            sweep_sensors,
            _read(self.readings),
            self.extra(),
        )
        update = self.door.check(self.plugin.update(seen), seen)
        if update is not None:
            self.map.put(update)


class PlannerNode(RoleNode[Planner]):
    """Turns the newest request into a path, or the reason why there is none. `tolerance` is the goal's, m."""

    role = "planner"
    plan = New(GoalPorts.plan, triggers=True)
    map = Latest(MapperPorts.map)
    path = Output(PlannerPorts.path)
    failure = Output(PlannerPorts.failure)
    cause = plan

    def __init__(self, plugin: Planner, tolerance: float) -> None:
        self.plugin = plugin
        self.door = PlannerDoor(plugin, tolerance)

    def step(self, tick: Tick) -> None:
        known = self.map.value
        if known is None:
            return
        seen = PlannerInput(self.plan.values[-1], known, self.extra())
        answer = self.door.check(self.plugin.plan(seen), seen)
        if isinstance(answer, Path):
            self.path.put(answer)
        else:
            self.failure.put(answer)


class ControllerNode(RoleNode[Controller]):
    """Turns the reference into a velocity."""

    role = "controller"
    is_awaited = True
    reference = Latest(ReferencePorts.reference, triggers=True)
    trajectory = Latest(ReferencePorts.trajectory)
    pose = Latest(LocalizerPorts.pose)
    command = Output(ControllerPorts.command)
    cause = reference

    def __init__(self, plugin: Controller) -> None:
        self.plugin = plugin
        self.door = TwistDoor(plugin, TrackingCommand)

    def step(self, tick: Tick) -> None:
        trajectory, reference, pose = self.trajectory.value, self.reference.value, self.pose.value
        assert trajectory is not None and reference is not None and pose is not None
        seen = ControllerInput(tick.time_ns, trajectory, reference, pose, self.extra())
        self.command.put(self.door.check(self.plugin.control(seen)))


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
    gate = Latest(GatePorts.status, delayed=True)
    command = Output(AvoiderPorts.command)
    status = Output(AvoiderPorts.status)
    handover = Output(AvoiderPorts.handover)
    cause = pose

    def __init__(self, plugin: Avoider, rule: HandOverRule, look_ahead: float) -> None:
        self.plugin = plugin
        self.door = TwistDoor(plugin, Avoidance)
        self.rule = rule
        self.look_ahead = look_ahead

    def step(self, tick: Tick) -> None:
        estimate, reference, wanted = self.pose.value, self.reference.value, self.desired.value
        assert estimate is not None and reference is not None and wanted is not None
        scans, names = in_order(self.scans)
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
            1.0 if limit is None else limit.share,
            names,
            _read(self.readings),
            self.extra(),
        )
        answer = self.door.check(self.plugin.avoid(seen))
        own = own_way(estimate.pose, desired, self.look_ahead) if self.look_ahead > 0.0 else NOWHERE
        handover = self.rule.step(tick.time, scans, estimate.pose, reference.way, reference.corridor, own)
        self.command.put(Command(answer.twist))
        self.status.put(AvoiderStatus(answer.status, answer.diagnostics))
        self.handover.put(handover)


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
        self._follow(estimate)
        if request is None or not request.active or estimate is None:
            return
        starts = request is not self._attempt
        if starts:
            self._attempt, self._is_over = request, False
        if self._is_over:
            return
        trail = np.array(self._trail).reshape(-1, 3)
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
            _read(self.readings),
            self.extra(),
        )
        answer = self.door.check(self.plugin.recover(seen))
        self._is_over = answer.state != "running"
        self.command.put(Command(answer.twist))
        self.status.put(answer)

    def _follow(self, estimate: PoseEstimate | None) -> None:
        """Add the pose to the trail of where the robot has been."""
        if estimate is None:
            return
        pose = estimate.pose
        if not self._trail or math.dist((pose.x, pose.y), self._trail[-1][:2]) >= TRAIL_STEP:
            self._trail.append((pose.x, pose.y, pose.heading))


def in_order(sensors: Mapping[str, News[Any]]) -> tuple[tuple[Any, ...], tuple[str, ...]]:
    """New messages of a node's sensors, in order of time and then of port, with the sensor's name of each."""
    if not sensors:
        return (), ()
    if len(sensors) == 1:
        ((name, news),) = sensors.items()
        values = news.values
        return tuple(values), (name,) * len(values)
    found = sorted([(one.stamp_ns, one, name) for name, news in sensors.items() for one in news.values], key=_first)
    return tuple([one for _, one, _ in found]), tuple([name for _, _, name in found])


_first = itemgetter(0)


def _of_kind(kind: type[M], named: Sequence[tuple[Any, str]]) -> tuple[tuple[M, ...], tuple[str, ...]]:
    """The messages of one class, and the names of their sensors."""
    found = [(one, name) for one, name in named if isinstance(one, kind)]
    return tuple([one for one, _ in found]), tuple([name for _, name in found])


def _read(sensors: Mapping[str, News[Message]]) -> Readings:
    """New messages of sensors of other kinds, by the sensor's name."""
    if not sensors:
        return NO_READINGS
    return MappingProxyType({name: tuple(news.values) for name, news in sensors.items() if news.values})


def _covering(poses: Sequence[PoseEstimate], since_ns: int) -> PoseTrack:
    """The newest part of a track, from a little before the oldest data: a mapper does not need the older poses."""
    begin_ns = since_ns - BEFORE_DATA_NS
    kept: list[PoseEstimate] = []
    for pose in reversed(poses):
        kept.append(pose)
        if pose.stamp_ns <= begin_ns:
            break
    kept.reverse()
    numbers: list[float] = []
    for pose in kept:
        numbers += (pose.pose.x, pose.pose.y, pose.pose.heading)
    return PoseTrack(
        np.array([pose.stamp_ns for pose in kept], dtype=np.int64),
        np.array(numbers, dtype=np.float64).reshape(-1, 3),
    )


def _distance(pose: Any, point: Any) -> float:
    return float(((point.x - pose.x) ** 2 + (point.y - pose.y) ** 2) ** 0.5)
